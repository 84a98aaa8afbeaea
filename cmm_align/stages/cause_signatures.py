"""How single causes show in the deviations: a closed-form column for each, beyond any rigid motion.

With foot points p, outward normals n, tip centres m, all about their centroids, time t from -1/2 to 1/2
over the run (points are touched in the order of their rows), and rho the vector from the axis of rotation,
across it:

- A stylus radius entered too small by d puts every contact point d too high: ``e = d``. A wheel larger than
  the control believes by d takes off d too much: ``e = -d``. So the value of both is what to add to the
  setting, and no measurement of one part tells one from the other.
- A wheel that runs too far from the axis of rotation by d leaves ``e = d n . rho / |rho|`` (the "ogive");
  the value is -d, how much further out to move it. Wear over a spiral path, whose length grows with
  rho^2: ``e = d (rho / rho_max)^2``.
- A scale of the part, ``e = s p . n``, or of one of its axes, ``e = s x n_x``; axes out of square by g: ``e
  = g y n_x`` (or ``g x n_y``, which is the same beyond a rotation). The grinding machine makes them along
  the axes of the part, the measuring machine along its own, at the tip centre.
- Clamping with two and three lobes over the aperture: ``e = Re(a w^2)`` and ``Re(a w^3)``, w being x + i y
  about the centre, 1 at the furthest point.
- A probe with three lobes: ``e = Re(a (n_x + i n_y)^3)`` in the frame of the machine, the harmonic Y_33.
- Drift: ``e = d t n_x`` (or y, z) of the machine, ``d t`` of the probe.

Sources: P. Li et al., Chin. J. Mech. Eng. 2022 (setting errors of the wheel); ISO 230-1 (squareness); the
harmonic as in `numerics.machine_error`. Not here: errors of a rotary axis, wear on a raster, whatever has
no closed form.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.model import Alignment
from cmm_align.surfaces.protocol import Array
from cmm_align.units import ARCSEC_PER_RAD, PPM, UM_PER_MM

UM: Final = "um"
OVER_RUN: Final = "um over the run"
SET: Final = "set that first, then measure again"
_LONG: Final = "+ = measures too long"
_PAIRS: Final = (("x", "y", 0, 1), ("x", "z", 0, 2), ("y", "z", 1, 2))


class Signature(NamedTuple):
    """One cause, and what a unit of it does."""

    name: str
    unit: str
    columns: Array
    """Deviation in mm for one unit, shape (n, 1); for a cause with lobes shape (n, 2), mm for an amplitude of
    one um along cosine and sine."""
    lobes: int
    """0 where there is no direction."""
    sign: str
    remedy: str


class Sample(NamedTuple):
    """Points that causes are looked for at; frames as named, all of shape (n, 3) but the first and last."""

    deviation_mm: Array
    """Shape (n,)."""
    foot_surface_mm: Array
    normal_surface: Array
    foot_part_mm: Array
    normal_part: Array
    tip_machine_mm: Array
    normal_machine: Array
    time: Array
    """Shape (n,): -1/2 at the first row of the measurement, 1/2 at the last."""


def sample_of(alignment: Alignment, pick: NDArray[np.intp]) -> Sample:
    """Return the points of some rows of an alignment.

    Parameters
    ----------
    alignment : Alignment
    pick : ndarray of int, shape (n,)
        Rows with a deviation.
    """
    e, normals = alignment.deviation_mm[pick], alignment.normals[pick]
    foot = alignment.contact_part_mm[pick] - e[:, None] * normals
    turn = alignment.nominal.surface_from_part
    last = max(len(alignment.deviation_mm) - 1, 1)
    return Sample(
        e,
        turn.apply(foot),
        turn.rotate(normals),
        foot - foot.mean(axis=0),
        normals,
        alignment.tip_centre_machine_mm[pick] - alignment.tip_centre_machine_mm[pick].mean(axis=0),
        alignment.part_from_machine.inverse().rotate(normals),
        pick / last - 0.5,
    )


def signatures(
    sample: Sample, axis_mm: tuple[float, float], centre_mm: tuple[float, float]
) -> tuple[Signature, ...]:
    """Return the signatures of all causes, those that are set most often first.

    Parameters
    ----------
    sample : Sample
    axis_mm : tuple of float
        Axis of rotation, x and y, mm, frame `surface`.
    centre_mm : tuple of float
        Centre of the aperture, the same.

    Returns
    -------
    tuple of Signature
        Columns of shape (n, 1) or (n, 2), mm for a unit of the cause.
    """
    one = np.ones(len(sample.time))
    rho = sample.foot_surface_mm[:, :2] - axis_mm
    distance = np.hypot(*rho.T)
    outwards = rho / np.where(distance > 0.0, distance, 1.0)[:, None]
    ogive = np.sum(outwards * sample.normal_surface[:, :2], axis=1)
    worn = (distance / (distance.max() or 1.0)) ** 2
    expanded = np.sum(sample.foot_part_mm * sample.normal_part, axis=1)
    found = [
        _single("wheel radius", -one / UM_PER_MM, UM, "+ = add to the radius that the control knows"),
        _single(
            "stylus radius",
            one / UM_PER_MM,
            UM,
            "+ = add to the radius that was entered",
            "calibrate the stylus, then align again",
        ),
        _single(
            "thermal scale",
            expanded / PPM,
            "ppm",
            "+ = the part measures too large",
            "check temperatures, then measure again",
        ),
        _single(
            "wheel offset",
            -ogive / UM_PER_MM,
            UM,
            "+ = move the wheel that much further from the axis",
        ),
        _single(
            "wheel wear over a spiral",
            worn / UM_PER_MM,
            UM,
            "+ = more material at the furthest point than on the axis",
            "dress the wheel, then grind again",
        ),
        *_strains(sample.foot_part_mm, sample.normal_part, "", "of the part"),
        *_strains(sample.tip_machine_mm, sample.normal_machine, "measuring machine's ", "of the machine"),
    ]
    w = _complex(sample.foot_surface_mm[:, :2] - centre_mm)
    w = w / (np.abs(w).max() or 1.0)
    for lobes, word in ((2, "two"), (3, "three")):
        found.append(_lobed(f"clamping, {word} lobes", w**lobes, lobes, "clamp the part without strain"))
    touched = _complex(sample.normal_machine) ** 3
    found.append(_lobed("probe lobing, three lobes", touched, 3, "calibrate the probe, then measure again"))
    steady = "let the machine settle, then measure again"
    for k, axis in enumerate("xyz"):
        moving = sample.time * sample.normal_machine[:, k] / UM_PER_MM
        sign = f"+ = towards +{axis} of the machine, if rows are in the order of the touches"
        found.append(_single(f"drift along {axis}", moving, OVER_RUN, sign, steady))
    sign = "+ = rising along the normal, if rows are in the order of the touches"
    found.append(_single("drift of the probe", sample.time / UM_PER_MM, OVER_RUN, sign, steady))
    return tuple(found)


def _complex(vectors: Array) -> NDArray[np.complex128]:
    """Return x + i y."""
    return np.asarray(vectors[:, 0] + 1.0j * vectors[:, 1], dtype=np.complex128)


def _single(name: str, column: Array, unit: str, sign: str, remedy: str = SET) -> Signature:
    return Signature(name, unit, column[:, None], 0, sign, remedy)


def _lobed(name: str, shape: NDArray[np.complex128], lobes: int, remedy: str) -> Signature:
    """Return a cause with lobes: ``a cos + b sin``, a and b in um."""
    columns = np.stack([shape.real, shape.imag], axis=1) / UM_PER_MM
    return Signature(name, UM, columns, lobes, "PV over the points; the angle is that of a lobe", remedy)


def _strains(points_mm: Array, normals: Array, whose: str, of: str) -> list[Signature]:
    """Return scales and squareness along the axes of a frame."""
    remedy = "check the axes of the machine" if whose else SET
    found = [
        _single(f"{whose}scale of {axis}", points_mm[:, k] * normals[:, k] / PPM, "ppm", _LONG, remedy)
        for k, axis in enumerate("xyz")
    ]
    for first, second, i, j in _PAIRS:
        leaning = points_mm[:, j] * normals[:, i] / ARCSEC_PER_RAD
        sign = f"+ = the angle between +{first} and +{second} {of} measures less than 90 deg"
        found.append(_single(f"{whose}squareness of {first} and {second}", leaning, "arcsec", sign, remedy))
    return found
