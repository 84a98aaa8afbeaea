"""How fine a grid scattered points can carry.

The number of points says little: three hits on each place, or scan lines far denser along than
across, hold fewer *distinct* places than points. What counts is the smallest box that almost
nowhere inside the cloud stays empty.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MIN_FILL: Final = 0.9
"""Share of the boxes inside the cloud that must hold a point."""

_STEPS: Final = 12
"""Halvings of the search, in the logarithm of the size."""


def fill(x: Array, y: Array, size: float) -> float:
    """Return the share of square boxes inside a cloud that hold a point.

    Parameters
    ----------
    x, y : ndarray, shape (N,)
        Places, any unit of length.
    size : float
        Side of a box, same unit.

    Returns
    -------
    float
        Taken over the boxes away from the cloud's border where there are such.
    """
    ix = ((x - x.min()) / size).astype(np.intp)
    iy = ((y - y.min()) / size).astype(np.intp)
    my, mx = int(iy.max()) // 2 + 1, int(ix.max()) // 2 + 1
    boxes = np.zeros((2 * my, 2 * mx), dtype=np.bool_)
    boxes[iy, ix] = True
    share = boxes.reshape(my, 2, mx, 2).mean(axis=(1, 3))
    block = np.zeros((my + 2, mx + 2), dtype=np.bool_)
    block[1:-1, 1:-1] = share > 0.0
    inner = np.ones((my, mx), dtype=np.bool_)
    for dy in range(3):
        for dx in range(3):
            inner &= block[dy : dy + my, dx : dx + mx]
    chosen = inner if inner.any() else share > 0.0
    return float(share[chosen].mean())


def filled_box(x: Array, y: Array, smallest: float, largest: float) -> float:
    """Return the smallest side of a box, within limits, at which the cloud is filled.

    Parameters
    ----------
    x, y : ndarray, shape (N,)
        Places, any unit of length.
    smallest, largest : float
        Limits of the search, same unit; `largest` is returned if no size is filled.

    Returns
    -------
    float
        For points at random this holds about 2.3 points; for scan lines it is their pitch.
    """
    if smallest >= largest or fill(x, y, smallest) >= MIN_FILL:
        return smallest
    low, high = np.log(smallest), np.log(largest)
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        if fill(x, y, float(np.exp(middle))) >= MIN_FILL:
            high = middle
        else:
            low = middle
    return float(np.exp(high))
