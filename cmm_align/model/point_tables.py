"""What a job says of single points: limits of their deviations, weights, and datum points (fiducials)."""

from __future__ import annotations

from dataclasses import dataclass

from cmm_align.model.points import IntArray
from cmm_align.surfaces.protocol import Array


@dataclass(frozen=True, slots=True)
class PointLimits:
    """Limits of the deviation of single points.

    Attributes
    ----------
    ids : ndarray of int64, shape (n,)
        Each once.
    lower_mm, upper_mm : ndarray, shape (n,), mm
        Along the outward normal, ``lower <= deviation <= upper``; infinite where there is no limit.
    """

    ids: IntArray
    lower_mm: Array
    upper_mm: Array


@dataclass(frozen=True, slots=True)
class PointWeights:
    """How much single points count in the fit.

    Attributes
    ----------
    ids : ndarray of int64, shape (n,)
        Each once.
    weight : ndarray, shape (n,), dimensionless
        Not below zero, not all zero.
    """

    ids: IntArray
    weight: Array


@dataclass(frozen=True, slots=True)
class Fiducials:
    """Datum points: places measured on the machine whose place on the part is known.

    Attributes
    ----------
    names : tuple of str, length m
        Each once.
    measured_mm : ndarray, shape (m, 3), mm, frame `machine`
    nominal_mm : ndarray, shape (m, 3), mm, frame `part`
    sigma_mm : ndarray, shape (m, 3), mm
        Standard uncertainty of ``part_from_machine(measured) - nominal`` along the axes of frame `part`;
        above zero, infinite along axes that are not used.
    """

    names: tuple[str, ...]
    measured_mm: Array
    nominal_mm: Array
    sigma_mm: Array
