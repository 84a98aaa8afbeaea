"""The region of the plane where a prescription holds: rectangle, circle, annulus or polygon."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cmm_align.errors import MalformedInputError
from cmm_align.surfaces.protocol import Array, Bounds, Mask
from cmm_align.toml_table import check_keys, did_you_mean, number, numbers

SLACK: Final = 1e-9
"""A place this share of the size outside still counts as inside: rounding moves it there."""


@dataclass(frozen=True, slots=True)
class Aperture:
    """A region of the plane, in the unit of the prescription.

    Attributes
    ----------
    shape : str
        rectangle, circle, annulus or polygon.
    centre : tuple of float
    half : tuple of float
        Half width and half height of the rectangle around it.
    radii : tuple of float
        Inner and outer radius of a circle or annulus.
    corners : tuple of (float, float)
        Of a polygon, absolute.
    """

    shape: str
    centre: tuple[float, float]
    half: tuple[float, float]
    radii: tuple[float, float] = (0.0, 0.0)
    corners: tuple[tuple[float, float], ...] = ()

    @property
    def bounds(self) -> Bounds:
        """Rectangle around the aperture, in the unit of the prescription."""
        (cx, cy), (hx, hy) = self.centre, self.half
        return Bounds(cx - hx, cx + hx, cy - hy, cy + hy)

    def contains(self, x: Array, y: Array) -> Mask:
        """Return, shape (n,), whether places of shape (n,) lie inside or on the border."""
        u, v = x - self.centre[0], y - self.centre[1]
        slack = 1.0 + SLACK
        inside: Mask = (np.abs(u) <= self.half[0] * slack) & (np.abs(v) <= self.half[1] * slack)
        if self.radii[1] > 0.0:
            r = np.hypot(u, v)
            inside = inside & (r <= self.radii[1] * slack) & (r >= self.radii[0] / slack)
        if self.corners:
            inside = inside & self._in_polygon(x, y)
        return inside

    def _in_polygon(self, x: Array, y: Array) -> Mask:
        """Count the edges that a ray to +x crosses; places on an edge count as inside."""
        crossings = np.zeros(np.shape(x), dtype=bool)
        on_edge = np.zeros(np.shape(x), dtype=bool)
        size = max(self.half)
        for (ax, ay), (bx, by) in zip(self.corners, self.corners[1:] + self.corners[:1], strict=True):
            ex, ey = bx - ax, by - ay
            along = np.clip(((x - ax) * ex + (y - ay) * ey) / max(ex * ex + ey * ey, 1e-300), 0.0, 1.0)
            on_edge |= np.hypot(x - ax - along * ex, y - ay - along * ey) <= SLACK * size
            if ey == 0.0:
                continue
            spans = (ay > y) != (by > y)
            crossings ^= spans & (x < ax + (y - ay) / ey * ex)
        return crossings | on_edge


def aperture_from_table(table: Mapping[str, Any] | None, *, where: str) -> Aperture:
    """Return the aperture that a TOML table describes.

    Raises
    ------
    MalformedInputError
        If the table is missing, or a key, shape or number is wrong.
    """
    if not isinstance(table, Mapping):
        raise MalformedInputError(
            "no [aperture]", where=where, expected='shape = "rectangle" or "circle" ...'
        )
    readers = {"rectangle": _rectangle, "circle": _circle, "annulus": _annulus, "polygon": _polygon}
    shape = str(table.get("shape"))
    if shape not in readers:
        raise MalformedInputError(
            f"unknown shape {shape!r}", where=where, remedy=did_you_mean(shape, readers)
        )
    return readers[shape](table, where)


def _centre(table: Mapping[str, Any], where: str) -> tuple[float, float]:
    """Return the optional centre."""
    if "centre" not in table:
        return 0.0, 0.0
    x, y = numbers(table, "centre", where=where, count=2)
    return x, y


def _positive(table: Mapping[str, Any], key: str, where: str) -> float:
    """Return a number that must be above zero."""
    value = number(table, key, where=where)
    if value <= 0.0:
        raise MalformedInputError(f"{key} = {value}", where=where, expected=f"{key} > 0")
    return value


def _rectangle(table: Mapping[str, Any], where: str) -> Aperture:
    check_keys(table, {"shape", "centre", "width", "height"}, where=where)
    half = (0.5 * _positive(table, "width", where), 0.5 * _positive(table, "height", where))
    return Aperture("rectangle", _centre(table, where), half)


def _circle(table: Mapping[str, Any], where: str) -> Aperture:
    check_keys(table, {"shape", "centre", "radius"}, where=where)
    r = _positive(table, "radius", where)
    return Aperture("circle", _centre(table, where), (r, r), (0.0, r))


def _annulus(table: Mapping[str, Any], where: str) -> Aperture:
    check_keys(table, {"shape", "centre", "inner_radius", "outer_radius"}, where=where)
    inner, outer = _positive(table, "inner_radius", where), _positive(table, "outer_radius", where)
    if inner >= outer:
        raise MalformedInputError(f"inner_radius = {inner}", where=where, expected="less than outer_radius")
    return Aperture("annulus", _centre(table, where), (outer, outer), (inner, outer))


def _polygon(table: Mapping[str, Any], where: str) -> Aperture:
    check_keys(table, {"shape", "corners"}, where=where)
    corners = table.get("corners")
    if not isinstance(corners, list) or len(corners) < 3:
        raise MalformedInputError("corners are missing", where=where, expected="at least 3 [x, y] pairs")
    pairs = [
        numbers({"corner": c}, "corner", where=f"{where}:corners[{k}]", count=2)
        for k, c in enumerate(corners)
    ]
    xs, ys = [p[0] for p in pairs], [p[1] for p in pairs]
    half = (0.5 * (max(xs) - min(xs)), 0.5 * (max(ys) - min(ys)))
    if min(half) <= 0.0:
        raise MalformedInputError("the polygon has no area", where=where)
    centre = (0.5 * (max(xs) + min(xs)), 0.5 * (max(ys) + min(ys)))
    return Aperture("polygon", centre, half, corners=tuple((p[0], p[1]) for p in pairs))
