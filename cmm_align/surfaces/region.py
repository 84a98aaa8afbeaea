"""A region of the projection plane: which points steer the fit, and which ones are reported.

Given as a short text, as a table with the keys of a prescription's aperture, or as the nominal's own
aperture less a margin all round (the clear aperture).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cmm_align.errors import MalformedInputError, UnitsError, UsageError
from cmm_align.surfaces.aperture import Aperture, aperture_from_table
from cmm_align.surfaces.margin import deep_inside
from cmm_align.surfaces.protocol import Array, Mask, Surface
from cmm_align.toml_table import did_you_mean
from cmm_align.units import parse_length_mm

FORMS: Final = {
    "circle": "circle:X,Y,R",
    "annulus": "annulus:X,Y,R1,R2",
    "rectangle": "rectangle:X,Y,W,H",
    "polygon": "polygon:X1,Y1,X2,Y2,X3,Y3...",
    "aperture": "aperture:-MARGIN",
}
"""How each kind of region is written."""

_AFTER_CENTRE: Final = {
    "circle": ("radius",),
    "annulus": ("inner_radius", "outer_radius"),
    "rectangle": ("width", "height"),
}
_FEWEST_CORNERS: Final = 3


@dataclass(frozen=True, slots=True)
class Region:
    """A region of the projection plane, frame `surface`.

    Attributes
    ----------
    words : str
        What it is, for the report: ``circle of radius 30 mm about (0, 0)``.
    text : str
        The same as `region_from_text` takes it, lengths in mm.
    inside : callable
        Says of places x, y of shape (n,), mm, whether they lie in it; the border belongs to it.
    """

    words: str
    text: str
    inside: Callable[[Array, Array], Mask]

    def contains(self, x_mm: Array, y_mm: Array) -> Mask:
        """Return, shape (n,), whether places lie inside or on the border.

        Parameters
        ----------
        x_mm, y_mm : ndarray, shape (n,), mm, frame `surface`
        """
        return self.inside(x_mm, y_mm)


def region_from_text(text: str, surface: Surface, where: str = "region") -> Region:
    """Return the region that a short text describes.

    Parameters
    ----------
    text : str
        One of `FORMS`; lengths take a unit, bare ones are mm. Widths and heights are full sizes.
    surface : Surface
        The nominal, whose own aperture `aperture:-2mm` makes narrower by 2 mm all round.
    where : str
        What the user wrote it as, for messages.

    Returns
    -------
    Region

    Raises
    ------
    UsageError
        If the text is none of `FORMS`, or describes nothing.
    """
    kind, _, rest = text.strip().partition(":")
    kind = kind.strip().lower()
    if kind not in FORMS:
        raise UsageError(
            f"{text!r} is no region",
            where=where,
            expected=f"one of {', '.join(FORMS.values())}, or a .toml file",
            remedy=did_you_mean(kind, FORMS),
        )
    lengths = _lengths(kind, rest, where)
    if kind == "aperture":
        return _inset(lengths, surface, where)
    table: dict[str, Any] = {"shape": kind}
    if kind == "polygon":
        table["corners"] = [lengths[k : k + 2] for k in range(0, len(lengths), 2)]
    else:
        table["centre"] = lengths[:2]
        table.update(zip(_AFTER_CENTRE[kind], lengths[2:], strict=True))
    try:
        return region_from_table(table, where=where)
    except MalformedInputError as error:
        raise UsageError(
            f"{text!r}: {error.what}", where=where, expected=error.expected or FORMS[kind]
        ) from None


def region_from_table(table: Mapping[str, Any] | None, mm_per_unit: float = 1.0, *, where: str) -> Region:
    """Return the region that a TOML table with the keys of a prescription's aperture describes.

    Parameters
    ----------
    table : mapping
        ``shape`` and what belongs to it.
    mm_per_unit : float
        Length of the table's unit, mm.
    where : str
        Name of the file and table, for messages.

    Raises
    ------
    MalformedInputError
        If a key, shape or number is wrong.
    """
    aperture = aperture_from_table(table, where=where)
    if aperture.corners and _area(aperture) == 0.0:
        raise MalformedInputError("the polygon has no area", where=where)
    return Region(
        _words(aperture, mm_per_unit),
        _text(aperture, mm_per_unit),
        lambda x, y: aperture.contains(x / mm_per_unit, y / mm_per_unit),
    )


def _lengths(kind: str, text: str, where: str) -> list[float]:
    """Return the numbers of a region, mm, as many as its kind needs."""
    parts = text.split(",") if text.strip() else []
    count = len(parts)
    if kind == "polygon":
        right = count >= 2 * _FEWEST_CORNERS and count % 2 == 0
    else:
        right = count == (1 if kind == "aperture" else 2 + len(_AFTER_CENTRE[kind]))
    if not right:
        raise UsageError(
            f"{count} number{'' if count == 1 else 's'} in {kind}:{text}", where=where, expected=FORMS[kind]
        )
    try:
        return [parse_length_mm(part) for part in parts]
    except UnitsError as error:
        raise UsageError(
            f"{kind}:{text}: {error.what}", where=where, expected=f"{FORMS[kind]}, such as 30 or 30mm"
        ) from None


def _inset(lengths: list[float], surface: Surface, where: str) -> Region:
    """Return the nominal's own aperture less a margin."""
    margin = -lengths[0]
    if margin < 0.0:
        raise UsageError(
            f"aperture:{lengths[0]:+g}mm is wider than the nominal",
            where=where,
            expected=f"aperture:-{-margin:g}mm, a margin inwards",
        )
    if margin == 0.0:
        return Region("the whole aperture", "aperture:0", surface.contains)
    inside = deep_inside(surface, margin)
    if inside is None:
        raise UsageError(
            f"a margin of {margin:g} mm leaves nothing of the aperture",
            where=where,
            expected="less than half its width",
        )
    return Region(f"the aperture less {margin:g} mm all round", f"aperture:{-margin!r}", inside)


def _words(aperture: Aperture, unit: float) -> str:
    about = f"about ({aperture.centre[0] * unit:g}, {aperture.centre[1] * unit:g})"
    inner, outer = (radius * unit for radius in aperture.radii)
    width, height = (2.0 * half * unit for half in aperture.half)
    return {
        "circle": f"circle of radius {outer:g} mm {about}",
        "annulus": f"annulus of radii {inner:g} and {outer:g} mm {about}",
        "rectangle": f"rectangle of {width:g} x {height:g} mm {about}",
        "polygon": f"polygon of {len(aperture.corners)} corners within {width:g} x {height:g} mm {about}",
    }[aperture.shape]


def _text(aperture: Aperture, unit: float) -> str:
    """Return a region as `region_from_text` takes it."""
    inner, outer = aperture.radii
    numbers = {
        "circle": [*aperture.centre, outer],
        "annulus": [*aperture.centre, inner, outer],
        "rectangle": [*aperture.centre, *(2.0 * half for half in aperture.half)],
        "polygon": [value for corner in aperture.corners for value in corner],
    }[aperture.shape]
    return f"{aperture.shape}:{','.join(repr(float(value * unit)) for value in numbers)}"


def _area(polygon: Aperture) -> float:
    """Return the signed area of a polygon, in its unit squared."""
    x, y = np.array(polygon.corners).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
