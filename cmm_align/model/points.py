"""Points as read, and what they are: what a measurement or a design starts as."""

from __future__ import annotations

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
        ``machine`` or ``part``.
    ids : ndarray of int64, shape (N,)
        Number of each point in its source, from 0 unless the file numbers them.
    source : str
        Where the points came from, for messages.
    sigma_mm : ndarray, shape (N,), mm, or None
        Standard uncertainty of each point where the source states it.
    """

    points_mm: Array
    kind: PointKind
    frame: str
    ids: IntArray
    source: str
    sigma_mm: Array | None = None

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
    ) -> PointSet:
        """Return a checked set of points.

        Parameters
        ----------
        points_mm : array_like, shape (N, 3), mm, frame `frame`
            Copied only if it is not a contiguous float64 array.
        kind, frame, ids, source, sigma_mm
            As the attributes; `ids` of shape (N,) are 0, 1, 2 ... if left out.

        Raises
        ------
        MalformedInputError
            If the array is not (N, 3) or holds a value that is not finite.
        """
        points = np.ascontiguousarray(points_mm, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise MalformedInputError(
                f"array of shape {points.shape}", where=source, expected="(N, 3): x, y, z"
            )
        finite = np.isfinite(points).all(axis=1)
        if not finite.all():
            first = int(np.argmin(finite))
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
            None if sigma_mm is None else frozen_array(sigma_mm),
        )

    def __len__(self) -> int:
        return len(self.points_mm)
