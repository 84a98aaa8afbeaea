"""Points as read, and what they are: what a measurement or a design starts as."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array

IntArray = NDArray[np.int64]

MIN_POINTS: Final = 6
"""A rigid motion has six unknowns."""


def frozen_array(values: ArrayLike, dtype: type = np.float64) -> Any:
    """Return `values` (any shape, any unit) as a read-only array of `dtype`; a view where it is one."""
    array: NDArray[Any] = np.asarray(values, dtype=dtype).view()
    array.flags.writeable = False
    return array


class PointKind(StrEnum):
    """What a measured point is."""

    TIP_CENTRE = "tip_centre"
    """Centre of the probe ball."""
    CONTACT = "contact"
    """Point on the part: the tip radius has been taken off already."""
    NOMINAL = "nominal"
    """Point of the design, not measured at all."""
    COMMANDED = "commanded"
    """Point of a surface to grind, written by `compensate`."""
    UNSTATED = "unstated"


@dataclass(frozen=True, slots=True)
class PointSet:
    """Points as read.

    Attributes
    ----------
    points_mm : ndarray, shape (N, 3), mm, frame `frame`
    kind : PointKind
    frame : str
        ``machine``, ``part``, or ``grinder`` for what was written for a part that was touched there.
    ids : ndarray of int64, shape (N,)
        Number of each point in its source, from 0 unless the file numbers them.
    source : str
        Where the points came from, for messages.
    sigma_mm : ndarray, shape (N,), mm, or None
        Standard uncertainty of each point where the source states it; above zero.
    weight : ndarray, shape (N,), dimensionless, or None
        How much each point counts in the fit where the source states it; not below zero, not all zero.
    passed_over : tuple of str
        A sentence for each measured row of the source that was left out by design, with its place, text and
        reason; of many only the first and how many more.
    """

    points_mm: Array
    kind: PointKind
    frame: str
    ids: IntArray
    source: str
    sigma_mm: Array | None = None
    weight: Array | None = None
    passed_over: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        points_mm: ArrayLike,
        *,
        kind: PointKind = PointKind.UNSTATED,
        frame: str = "machine",
        ids: ArrayLike | None = None,
        source: str = "points",
        sigma_mm: ArrayLike | None = None,
        weight: ArrayLike | None = None,
        passed_over: Sequence[str] = (),
    ) -> PointSet:
        """Return a checked set of points.

        Parameters
        ----------
        points_mm : array_like, shape (N, 3), mm, frame `frame`
            Copied only if it is not a contiguous float64 array.
        kind, frame, ids, source, sigma_mm, weight, passed_over
            As the attributes; `ids` of shape (N,) are 0, 1, 2 ... if left out.

        Raises
        ------
        MalformedInputError
            If the array is not (N, 3), holds a value that is not finite, or the uncertainties or weights are
            not as the attributes say.
        """
        points = np.ascontiguousarray(points_mm, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise MalformedInputError(
                f"array of shape {points.shape}", where=source, expected="(N, 3): x, y, z"
            )
        finite = np.isfinite(points)
        if not finite.all():
            first = int(np.argmin(finite.all(axis=1)))
            raise MalformedInputError(
                f"point {first + 1} of {len(points)} is not finite ({points[first]})",
                where=source,
                expected="finite numbers",
                remedy="remove the point at its source",
            )
        numbers = np.arange(len(points)) if ids is None else ids
        return cls(
            frozen_array(points),
            kind,
            frame,
            frozen_array(numbers, np.int64),
            source,
            None if sigma_mm is None else _steering("sigma", sigma_mm, len(points), source),
            None if weight is None else _steering("weight", weight, len(points), source),
            tuple(passed_over),
        )

    def __len__(self) -> int:
        return len(self.points_mm)

    @property
    def centroid_mm(self) -> Array:
        """Mean of the points, shape (3,), mm, frame `frame`."""
        mean: Array = np.ones(len(self)) @ self.points_mm / len(self)
        return mean


def joined(sets: Sequence[PointSet]) -> PointSet:
    """Return point sets of one kind and frame as one, in the order given.

    Parameters
    ----------
    sets : sequence of PointSet
        At least one; kind and frame are those of the first.

    Returns
    -------
    PointSet
        With the ids of the sets where no two sets share one; numbered anew from 0 otherwise, as if the files
        stood below each other.

    Raises
    ------
    MalformedInputError
        If some of the sets state uncertainties or weights and others do not.
    """
    if len(sets) == 1:
        return sets[0]
    ids = np.concatenate([points.ids for points in sets])
    shared = len(np.unique(ids)) < sum(len(np.unique(points.ids)) for points in sets)
    return PointSet.of(
        np.concatenate([points.points_mm for points in sets]),
        kind=sets[0].kind,
        frame=sets[0].frame,
        ids=None if shared else ids,
        source=", ".join(points.source for points in sets),
        sigma_mm=_column("sigma", [(points.source, points.sigma_mm) for points in sets]),
        weight=_column("weight", [(points.source, points.weight) for points in sets]),
        passed_over=[sentence for points in sets for sentence in points.passed_over],
    )


def _column(name: str, parts: Sequence[tuple[str, Array | None]]) -> Array | None:
    """Return the parts of a column below each other; None if no source has it."""
    there = [values for _, values in parts if values is not None]
    if not there:
        return None
    if len(there) < len(parts):
        with_it = next(source for source, values in parts if values is not None)
        without = next(source for source, values in parts if values is None)
        raise MalformedInputError(
            f"no column {name}",
            where=without,
            expected=f"one, as {with_it} has",
            remedy="state it in all files of a clamping, or in none",
        )
    return np.concatenate(there)


def _steering(name: str, values: ArrayLike, count: int, source: str) -> Array:
    """Return what says how much points count, checked: uncertainties above zero, weights not below it."""
    array: Array = frozen_array(values)
    if array.shape != (count,):
        raise MalformedInputError(
            f"{name} of shape {array.shape}", where=source, expected=f"one for each of {count} points"
        )
    right = np.isfinite(array) & ((array > 0.0) if name == "sigma" else (array >= 0.0))
    if not right.all():
        first = int(np.argmin(right))
        raise MalformedInputError(
            f"{name} {array[first]:.12g} of point {first + 1} of {count}",
            where=source,
            expected="above 0" if name == "sigma" else "0 or more",
        )
    if count and not array.any():
        raise MalformedInputError(f"all values of {name} are 0", where=source, expected="some above 0")
    return array
