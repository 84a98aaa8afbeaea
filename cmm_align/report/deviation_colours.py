"""The colours of a deviation: blue is missing material, white is zero, red-brown is excess.

None of matplotlib's diverging maps is both even in perception and light in the middle (RdBu_r
steps unevenly; berlin, managua and vanimo are dark there, which prints badly). This one is made in the
Oklab space (B. Ottosson, "A perceptual color space for image processing", 2020): each half runs from
near-white through a saturated colour to a dark one, with steps of equal length and the same lightness
on both sides. Blue against orange-red is told apart under all common colour blindness, as the two
hues differ along the blue-yellow axis, and the size of a deviation can be read from lightness alone.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEGATIVE_HUE_DEG: Final = 252.0
POSITIVE_HUE_DEG: Final = 42.0

TAKE_OFF_HUE_DEG: Final = 130.0
LEAVE_HUE_DEG: Final = 305.0
"""Of a correction, in green and purple: it must not be taken for a deviation."""

_LIGHTNESS: Final = (0.975, 0.63, 0.33)
"""Control points (Bezier) of lightness from zero to the limit; the same on both sides."""

_CHROMA: Final = (0.0, 0.215, 0.095)

_LMS_FROM_OKLAB: Final = np.array(
    [
        [1.0, 0.3963377774, 0.2158037573],
        [1.0, -0.1055613458, -0.0638541728],
        [1.0, -0.0894841775, -1.2914855480],
    ]
)
_RGB_FROM_LMS: Final = np.array(
    [
        [4.0767416621, -3.3077115913, 0.2309699292],
        [-1.2684380046, 2.6097574011, -0.3413193965],
        [-0.0041960863, -0.7034186147, 1.7076147010],
    ]
)


def deviation_colours(
    n: int = 255, hues_deg: tuple[float, float] = (NEGATIVE_HUE_DEG, POSITIVE_HUE_DEG)
) -> Array:
    """Return the colours from the most negative to the most positive deviation.

    Parameters
    ----------
    n : int
        Odd, so that zero has a colour of its own.
    hues_deg : (float, float)
        Oklab hues of the negative and the positive half.

    Returns
    -------
    ndarray, shape (n, 3)
        sRGB, 0 to 1.
    """
    half = n // 2 + 1
    negative, positive = (_half(hue, half) for hue in hues_deg)
    return srgb_from_oklab(np.concatenate([negative[:0:-1], positive]))


def srgb_from_oklab(oklab: Array) -> Array:
    """Return sRGB colours, shape (n, 3), 0 to 1, of Oklab ones; what lies outside sRGB is clipped."""
    linear = np.clip((oklab @ _LMS_FROM_OKLAB.T) ** 3 @ _RGB_FROM_LMS.T, 0.0, 1.0)
    curved = 1.055 * linear ** (1.0 / 2.4) - 0.055
    result: Array = np.where(linear <= 0.0031308, 12.92 * linear, curved)
    return result


def _half(hue_deg: float, n: int) -> Array:
    """Return `n` Oklab colours in steps of equal length from zero to the limit, shape (n, 3)."""
    t = np.linspace(0.0, 1.0, 2001)
    weights = np.stack([(1.0 - t) ** 2, 2.0 * t * (1.0 - t), t**2], axis=1)
    lightness, chroma = weights @ np.array(_LIGHTNESS), weights @ np.array(_CHROMA)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(lightness), np.diff(chroma)))])
    even = np.linspace(0.0, length[-1], n)
    lightness, chroma = np.interp(even, length, lightness), np.interp(even, length, chroma)
    hue = np.deg2rad(hue_deg)
    return np.stack([lightness, chroma * np.cos(hue), chroma * np.sin(hue)], axis=1)
