"""From the user's choices to what steers a fit: locked motions, datum terms, weights, the temperature."""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.config import AlignConfig
from cmm_align.errors import GeometryError, UsageError
from cmm_align.model import Fiducials, Nominal, PointSet
from cmm_align.numerics.rotations import orthonormalised
from cmm_align.numerics.steering import AXES, DatumTerms, Lock, Placement
from cmm_align.pose import Pose
from cmm_align.surfaces.protocol import Array
from cmm_align.units import REFERENCE_C, UM_PER_MM, parse_length_mm

MIN_FOR_START: Final = 3
"""Fiducials that say where a part lies."""
SPREAD: Final = 1e-3
"""Fiducials whose spread across is below this share of that along lie on a line."""


def check_choices(config: AlignConfig, fiducials: Fiducials | None) -> None:
    """Refuse choices of which one would be passed over in silence.

    Raises
    ------
    UsageError
        If two of them exclude each other.
    """
    extra = [
        f"{name} {getattr(config, name)}"
        for name, plain in (("criterion", "least-squares"), ("scale", "fixed"))
        if getattr(config, name) != plain
    ]
    if config.max_iterations == 0:
        extra += ["search always"] if config.search == "always" else []
        extra += ["monte-carlo"] if config.monte_carlo else []
        if extra:
            raise UsageError(
                f"--iterations 0 with {', '.join(extra)}", expected="a pose to evaluate, no more"
            )
    if config.criterion != "least-squares" and (fiducials is not None or config.weights != "equal"):
        what = "fiducials" if fiducials is not None else f"weights {config.weights}"
        raise UsageError(
            f"criterion {config.criterion} with {what}", expected="least-squares: others know none"
        )
    if config.scale == "free" and any(axis.startswith("t") for axis in locked_motions(config)):
        raise UsageError("a free scale with locked translations", expected="one or the other")
    if config.monte_carlo and (fiducials is not None or config.scale == "free"):
        raise UsageError(
            "Monte Carlo with fiducials or a free scale", expected="the points alone, scale fixed"
        )


def limits_of_points(
    n: int, config: AlignConfig, tolerance: tuple[Array, Array] | None
) -> tuple[Array, Array]:
    """Return the limits of every point, from a table or the same for all.

    Parameters
    ----------
    n : int
        Points.
    config : AlignConfig
    tolerance : tuple of ndarray, each of shape (n,), mm, or None
        Least and largest deviation of each point.

    Raises
    ------
    UsageError
        If a tolerance is asked for and none is given.
    """
    if tolerance is not None or config.criterion != "within-tolerance":
        return tolerance or (np.empty(0), np.empty(0))
    lower, upper = config.tolerance_lower_um / UM_PER_MM, config.tolerance_upper_um / UM_PER_MM
    if lower >= upper:
        raise UsageError(
            f"a tolerance from {config.tolerance_lower_um:g} to {config.tolerance_upper_um:g} um",
            expected="--tolerance with a length, two lengths, or a file of limits",
        )
    return np.full(n, lower), np.full(n, upper)


def locked_motions(config: AlignConfig) -> tuple[str, ...]:
    """Return the locked motions, in the order rx, ry, rz, tx, ty, tz.

    Raises
    ------
    UsageError
        If a name is not known, or nothing is left to fit.
    """
    names = [name.strip().lower() for name in config.lock.split(",") if name.strip()]
    for name in names:
        if name not in AXES:
            raise UsageError(f"lock {name!r}", expected=", ".join(AXES))
    locked = tuple(axis for axis in AXES if axis in names)
    if len(locked) == len(AXES):
        raise UsageError(
            "all six motions are locked: nothing is left to fit", remedy="--iterations 0 evaluates a pose"
        )
    if locked and config.search == "always":
        raise UsageError(
            f"{', '.join(locked)} locked at the start, and a search over all poses asked for",
            expected="one or the other: a search has no start to hold",
        )
    return locked


def lock_of(
    config: AlignConfig, nominal: Nominal, start: Pose, placed: Placement, scale: float, centroid: Array
) -> Lock | None:
    """Return the lock that the settings ask for; None if they ask for none.

    Parameters
    ----------
    config : AlignConfig
    nominal : Nominal
    start : Pose
        ``part_from_machine`` that locked motions are held at.
    placed : Placement
        The same as a placement of the cloud, frame `surface`.
    scale : float
        Of the points about their centroid.
    centroid : ndarray, shape (3,), mm, frame `machine`
    """
    locked = locked_motions(config)
    if not locked:
        return None
    surface_from_part = nominal.surface_from_part
    centre = np.array(_centre(config.centre))
    if config.lock_frame == "machine":
        axes = (surface_from_part @ start).rotation
        about = placed.position_mm + placed.rotation @ (scale * (centre - centroid))
    else:
        axes = surface_from_part.rotation
        about = surface_from_part.apply(centre[None])[0]
    return Lock(placed, axes, about, np.array([axis in locked for axis in AXES]))


def _centre(text: str) -> tuple[float, ...]:
    """Return the centre of rotation, mm."""
    words = [word for word in text.replace(",", " ").split() if word]
    if not words:
        return (0.0, 0.0, 0.0)
    if len(words) != 3:
        raise UsageError(f"centre {text!r}", expected="three lengths: X,Y,Z")
    return tuple(parse_length_mm(word) for word in words)


def thermal_scale(config: AlignConfig) -> float:
    """Return what measured lengths are multiplied by to have those at 20 degrees C."""
    return 1.0 / (1.0 + config.expansion_per_k * (config.temperature_c - REFERENCE_C))


def stated_weights(measured: PointSet, config: AlignConfig) -> Array | None:
    """Return the weight of each point as the settings ask for, shape (N,); None where all are equal.

    Area weights come later: they need the feet.

    Raises
    ------
    UsageError
        If the points do not carry what is asked for.
    """
    if config.weights == "sigma":
        if measured.sigma_mm is None:
            raise UsageError(
                "weights by sigma, but the points have no standard uncertainties",
                where=measured.source,
                expected="a column sigma_mm",
            )
        return np.asarray((float(np.median(measured.sigma_mm)) / measured.sigma_mm) ** 2)
    if config.weights == "stated":
        if measured.weight is None:
            raise UsageError(
                "stated weights, but the points have none",
                where=measured.source,
                expected="a column weight, or --weights FILE",
            )
        return measured.weight
    return None


def datum_terms(
    fiducials: Fiducials, nominal: Nominal, centroid: Array, scale: float, sigma_mm: float
) -> DatumTerms:
    """Return the rows of fiducials, weighted against points of the surface.

    Parameters
    ----------
    fiducials : Fiducials
    nominal : Nominal
    centroid : ndarray, shape (3,), mm, frame `machine`
        Of the measured cloud.
    scale : float
        Of measured lengths about the centroid.
    sigma_mm : float
        What a deviation of the surface is worth: a fiducial with this uncertainty counts as much as a point.
    """
    used = np.isfinite(fiducials.sigma_mm)
    row, axis = np.nonzero(used)
    surface_from_part = nominal.surface_from_part
    return DatumTerms(
        scale * (fiducials.measured_mm[row] - centroid),
        surface_from_part.apply(fiducials.nominal_mm[row]),
        surface_from_part.rotation.T[axis],
        (sigma_mm / fiducials.sigma_mm[row, axis]) ** 2,
    )


def start_of(fiducials: Fiducials) -> Pose | None:
    """Return ``part_from_machine`` from the fiducials alone; None if they are too few or on a line.

    Source: Kabsch 1976, doi 10.1107/S0567739476001873.

    Raises
    ------
    GeometryError
        If they fit as their mirror image only.
    """
    whole = np.isfinite(fiducials.sigma_mm).all(axis=1)
    measured, nominal = fiducials.measured_mm[whole], fiducials.nominal_mm[whole]
    if len(measured) < MIN_FOR_START:
        return None
    here, there = measured.mean(axis=0), nominal.mean(axis=0)
    u, s, vt = np.linalg.svd((measured - here).T @ (nominal - there))
    if s[1] <= SPREAD * s[0]:
        return None
    flip = np.sign(np.linalg.det(u @ vt))
    if flip < 0.0 and s[2] > SPREAD * s[0]:
        raise GeometryError(
            "the fiducials are mirrored: they fit as their mirror image only",
            expected="right-handed coordinates, and the same names on both sides",
        )
    rotation = orthonormalised(vt.T @ np.diag([1.0, 1.0, flip]) @ u.T)
    return Pose(rotation, there - rotation @ here, "part", "machine")
