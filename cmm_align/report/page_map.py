"""The deviation map as data for the page: whole numbers of the last digit shown, packed small.

A deviation is stored as a count of the last digit that the read-out shows, so that what stands under the
pointer is the value of the file rounded once. Maps with more nodes than `MOST_NODES` are thinned to every
second, third ... node, and the page says so; the numbers beside the map are those of all nodes.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cmm_align.errors import GeometryError
from cmm_align.model import Alignment, DeviationMap, Nominal, Statistics
from cmm_align.report.canvas import limit_um, three_digits
from cmm_align.report.deviation_colours import deviation_colours
from cmm_align.surfaces.protocol import Array, Bounds, Mask
from cmm_align.surfaces.region import region_from_text
from cmm_align.units import UM_PER_MM

MOST_NODES: Final = 300_000
"""Nodes that a page carries; with 4 bytes for the deviation and 2 for u they take 2.4 MB as text."""

FINE_UM: Final = 3.2
"""Maps within this are shown with four decimals of um, others with three."""

_UNKNOWN_16: Final = -(2**15)
_UNKNOWN_32: Final = -(2**31)
_UNKNOWN_U: Final = 2**16 - 1
_OUTLINE_SAMPLES: Final = 700
_OUTLINE_DIGITS: Final = 4


def map_data(deviation_map: DeviationMap) -> dict[str, Any]:
    """Return the map for the script of the page, in JSON's own types.

    Returns
    -------
    dict
        ``x_mm``, ``y_mm``: places of the nodes; ``deviation``, ``u``: base64 of little-endian whole numbers,
        row by row, in steps of ``10**-digits`` and ``10**-u_digits`` um; ``outline_mm``: the rings of the
        aperture as x, y, x, y ...; ``regions``: the same of report and fit region; ``colours``: RRGGBB from
        the most negative to the most positive.

    Raises
    ------
    GeometryError
        If no node of the map is known.
    """
    m = deviation_map
    if not np.isfinite(m.deviation_mm).any():
        raise GeometryError("no node of the map is known", remedy="measure more of the part")
    every = thinning(m.deviation_mm.size)
    deviation_um = m.deviation_mm[::every, ::every] * UM_PER_MM
    u_um = m.sigma_mm[::every, ::every] * UM_PER_MM
    largest = max(abs(m.statistics.min_mm), abs(m.statistics.max_mm)) * UM_PER_MM
    digits = 4 if largest <= FINE_UM else 3
    text, bits = packed(deviation_um, digits)
    u_text, u_digits = packed_u(u_um, digits)
    rgb = np.round(255.0 * deviation_colours()).astype(np.uint8)
    return {
        "x_mm": [round(float(v), 6) for v in m.x_mm[::every]],
        "y_mm": [round(float(v), 6) for v in m.y_mm[::every]],
        "deviation": text,
        "bits": bits,
        "digits": digits,
        "u": u_text,
        "u_digits": u_digits,
        "limit_um": limit_um(m.deviation_mm),
        "outline_mm": outline(m.alignment.nominal),
        "regions": regions(m.alignment),
        "bounds_mm": [float(v) for v in m.alignment.nominal.surface.bounds],
        "colours": rgb.tobytes().hex(),
        "extremes": _extremes(m.statistics),
    }


def thinning(n_nodes: int) -> int:
    """Return which nodes along each axis go onto the page: 1 for all, 2 for every second, and so on."""
    return max(1, math.ceil(math.sqrt(n_nodes / MOST_NODES)))


def packed(values_um: Array, digits: int) -> tuple[str, int]:
    """Return deviations as base64 of signed whole numbers, and their bits: 16 where they fit, else 32.

    Parameters
    ----------
    values_um : ndarray, shape (ny, nx), um
        NaN where unknown, which becomes the least number of the type.
    digits : int
        Decimals of um that are kept.
    """
    known = np.isfinite(values_um)
    steps = np.round(np.where(known, values_um, 0.0) * 10.0**digits)
    small = float(np.abs(steps).max(initial=0.0)) < -_UNKNOWN_16
    kind, unknown, bits = ("<i2", _UNKNOWN_16, 16) if small else ("<i4", _UNKNOWN_32, 32)
    return _base64(np.where(known, steps, unknown).astype(kind)), bits


def packed_u(u_um: Array, digits: int) -> tuple[str, int]:
    """Return standard uncertainties as base64 of unsigned 16-bit numbers, and the decimals that fit them.

    Parameters
    ----------
    u_um : ndarray, shape (ny, nx), um
        NaN or infinite where unknown, which becomes the largest number of the type.
    digits : int
        Most decimals of um.
    """
    known = np.isfinite(u_um)
    largest = float(np.max(u_um, initial=0.0, where=known))
    while digits > -6 and round(largest * 10.0**digits) >= _UNKNOWN_U:
        digits -= 1
    steps = np.round(np.where(known, u_um, 0.0) * 10.0**digits)
    return _base64(np.where(known, steps, _UNKNOWN_U).clip(0, _UNKNOWN_U).astype("<u2")), digits


def outline(nominal: Nominal) -> list[list[float]]:
    """Return the border of the nominal, and of the holes in it, as rings of x, y, x, y ... in mm."""
    return _rings(nominal.surface.contains, nominal.surface.bounds)


def regions(alignment: Alignment) -> list[dict[str, Any]]:
    """Return the borders of report region and fit region, where there are any, as `outline` does."""
    surface, report = alignment.nominal.surface, alignment.report
    found = []
    for name, text in (("report region", report.report_region_text), ("fit region", report.fit_region_text)):
        rings = _rings(region_from_text(text, surface).contains, surface.bounds) if text else []
        if rings:
            found.append({"name": name, "outline_mm": rings})
    return found


def _rings(contains: Callable[[Array, Array], Mask], b: Bounds) -> list[list[float]]:
    """Return the border of a part of the plane, and of the holes in it."""
    step = max(b.x_max - b.x_min, b.y_max - b.y_min) / _OUTLINE_SAMPLES
    x = np.arange(b.x_min - 2.0 * step, b.x_max + 2.5 * step, step)
    y = np.arange(b.y_min - 2.0 * step, b.y_max + 2.5 * step, step)
    x_grid, y_grid = np.meshgrid(x, y)
    inside = contains(x_grid.ravel(), y_grid.ravel()).reshape(x_grid.shape)
    if not inside.any() or inside.all():
        return []
    paths = Figure().add_subplot().contour(x, y, inside.astype(np.float64), levels=[0.5]).get_paths()
    corners = [np.asarray(ring, np.float64) for path in paths for ring in path.to_polygons(closed_only=False)]
    rings = [_without_needless(ring) for ring in corners]
    return [[round(float(v), _OUTLINE_DIGITS) for v in ring.ravel()] for ring in rings if len(ring) > 2]


def _without_needless(ring: Array) -> Array:
    """Return a ring, shape (n, 2), without the corners that lie between their neighbours on a line."""
    ring = ring[:-1]
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    cross = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    size = np.hypot(*before.T) * np.hypot(*after.T)
    kept: Array = ring[cross > 1e-6 * size]
    return kept


def _extremes(s: Statistics) -> list[dict[str, Any]]:
    """Return what to mark on the map."""
    return [
        {"name": name, "x_mm": at[0], "y_mm": at[1], "um": three_digits(abs(value * UM_PER_MM)), "up": up}
        | {"sign": "+" if value > 0.0 else "\N{MINUS SIGN}" if value < 0.0 else ""}
        for name, value, at, up in (
            ("max", s.max_mm, s.max_at_mm, True),
            ("min", s.min_mm, s.min_at_mm, False),
        )
    ]


def _base64(values: NDArray[np.generic]) -> str:
    return base64.b64encode(values.tobytes()).decode("ascii")
