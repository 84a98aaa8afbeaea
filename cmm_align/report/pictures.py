"""The pictures of a deviation map by name: what each shows, and which function draws it.

Nothing of matplotlib is loaded before one of them is drawn.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from cmm_align.report.wishes import Wishes

if TYPE_CHECKING:
    from cmm_align.model import DeviationMap

PLAIN: Final = Wishes()
FORMATS: Final = ("png", "svg")


class Picture(NamedTuple):
    """One picture: ``cmm_align.report.<name>_picture.draw_<name>``."""

    sentence: str
    """What it shows."""
    takes: tuple[str, ...] = ()
    """What of `Wishes` it takes beside title and source."""


PICTURES: Final[dict[str, Picture]] = {
    "map": Picture("deviations in colour, with the lowest and the highest place", ("scale_um",)),
    "bands": Picture("the map in the colours of its tolerance: within, below, above", ("limits",)),
    "histogram": Picture("distribution of nodes and points, with percentiles", ("scale_um", "limits")),
    "sections": Picture(
        "deviation with its uncertainty along chosen lines", ("scale_um", "limits", "sections")
    ),
    "ladder": Picture("PV and RMS of what is left without the low orders"),
    "causes": Picture("what single settings explain, with intervals"),
    "psd": Picture("spectral density over wavelengths, with the noise of the points"),
    "relief": Picture("deviations as heights, seen from one side", ("scale_um",)),
    "outliers": Picture("where the points are that did not steer the fit, and why"),
}
"""In the order in which they are drawn and told."""


def draw(name: str, deviation_map: DeviationMap, path: Path | str, wishes: Wishes = PLAIN) -> None:
    """Write one picture.

    Parameters
    ----------
    name : str
        One of `PICTURES`.
    deviation_map : DeviationMap
    path : path
        Written as SVG where its suffix says so, else as PNG.
    wishes : Wishes

    Raises
    ------
    GeometryError
        If the map has nothing to show there: no spectrum, no limits.
    """
    function = getattr(importlib.import_module(f"cmm_align.report.{name}_picture"), f"draw_{name}")
    taken = {key: getattr(wishes, key) for key in PICTURES[name].takes}
    function(deviation_map, path, wishes.title, wishes.source, **taken)
