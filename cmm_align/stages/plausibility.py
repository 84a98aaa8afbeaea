"""What can be seen to be wrong before a fit: too few points, a line, wrong units, the nominal itself.

A wrong number makes scrap, so each of these stops the run with what the data look like.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.errors import GeometryError, UnitsError, WrongStageError
from cmm_align.model import MIN_POINTS, Nominal, PointKind, PointSet
from cmm_align.surfaces.protocol import Array
from cmm_align.units import MM_PER

LINE: Final = 1e-5
"""Points whose width is below this share of their length lie on a line, as printed to 5 decimals."""
LARGEST_RATIO: Final = 1.6
"""A cloud this many times larger than the nominal is not a measurement of it."""

_UNIT_WINDOW: Final = 1.25
_SAMPLE: Final = 2000
_ITSELF: Final = 1e-9


def check_measured(measured: PointSet, nominal: Nominal) -> None:
    """Refuse points that cannot be a measurement of this nominal.

    Raises
    ------
    WrongStageError
        If the points are nominal or commanded ones, or lie on the nominal itself.
    GeometryError
        If there are fewer than six, or they lie on a line.
    UnitsError
        If the cloud is larger or smaller than the nominal by the ratio of two units.
    """
    where = measured.source
    if measured.kind in (PointKind.NOMINAL, PointKind.COMMANDED):
        raise WrongStageError(
            f"these points are {measured.kind}, not measured",
            where=where,
            expected="tip centres: align MEASURED NOMINAL",
        )
    if len(measured) < MIN_POINTS:
        raise GeometryError(
            f"{len(measured)} points",
            where=where,
            expected=f"at least {MIN_POINTS}: a rigid motion has six unknowns",
        )
    points, middle = measured.points_mm, measured.centroid_mm
    few = points[:: max(1, len(points) // _SAMPLE)] - middle
    if _on_a_line(few) and _on_a_line(points - middle):
        raise GeometryError(
            "all points lie on a line" if np.ptp(points, axis=0).any() else "all points are the same",
            where=where,
            expected="points spread over the surface",
        )
    _check_size(_radius(few), _nominal_radius(nominal), where)
    _check_not_nominal(measured, nominal)


def _on_a_line(centred_mm: Array) -> bool:
    """Return whether points about their centroid are no wider than rounding."""
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(centred_mm.T @ centred_mm)[::-1], 0.0))
    return bool(spread[1] <= LINE * max(float(spread[0]), 1e-300))


def _radius(centred_mm: Array) -> float:
    """Return the radius that holds nearly all points; a few stray ones do not count."""
    return float(np.quantile(np.linalg.norm(centred_mm, axis=1), 0.98))


def _nominal_radius(nominal: Nominal) -> float:
    """Return the same radius for the nominal, from a raster over it."""
    b = nominal.surface.bounds
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(*b[:2], 41), np.linspace(*b[2:], 41)))
    z = nominal.surface.jet(x, y).z
    known = nominal.surface.contains(x, y) & np.isfinite(z)
    points = np.stack([x, y, z], axis=1)[known]
    return _radius(points - points.mean(axis=0))


def _check_size(measured_mm: float, nominal_mm: float, where: str) -> None:
    """Compare sizes; name the unit that would explain a ratio."""
    ratio = measured_mm / nominal_mm
    unlike = [(unit, MM_PER[unit]) for unit in ("inch", "um", "m")]
    looks = [(1.0 / per, f"as if the points were {unit} and the nominal mm") for unit, per in unlike]
    looks += [(per, f"as if the nominal were {unit} and the points mm") for unit, per in unlike]
    for expected, words in looks:
        if expected / _UNIT_WINDOW < ratio < expected * _UNIT_WINDOW:
            raise UnitsError(
                f"the cloud is {ratio:.4g} times the size of the nominal, {words}",
                where=where,
                expected="the right unit for both",
                remedy="check --units of this command and of offset",
            )
    if ratio > LARGEST_RATIO:
        raise GeometryError(
            f"the cloud is {ratio:.3g} times the size of the nominal",
            where=where,
            expected="a measurement of this nominal",
            remedy="check the files and their units",
        )


def _check_not_nominal(measured: PointSet, nominal: Nominal) -> None:
    """Refuse points that lie on the nominal to within rounding: that is the design, not a part."""
    if measured.kind is PointKind.CONTACT:
        return
    points = measured.points_mm[:: max(1, len(measured) // _SAMPLE)]
    local = nominal.surface_from_part.apply(points)
    z = nominal.surface.jet(local[:, 0], local[:, 1]).z
    known = nominal.surface.contains(local[:, 0], local[:, 1])
    if np.count_nonzero(known) < 0.9 * len(local):
        return
    off = np.abs(local[known, 2] - z[known])
    if float(np.quantile(off, 0.9)) <= _ITSELF * nominal.surface.bounds.diagonal_mm:
        raise WrongStageError(
            "the points lie on the nominal itself",
            where=measured.source,
            expected="measured tip centres",
            remedy="give the measured file first, or --contact-points if these are contact points",
        )
