"""Other people's files: one reader per format, chosen by content.

A new format is one module with `recognises(head)` and `read(source, units)`, and one line in `registry`.
Nothing of it is loaded before it is needed: a file of ours needs none of these readers.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

from cmm_align.formats.source import NO_HINTS, Hints

if TYPE_CHECKING:
    from cmm_align.formats.codev_int import codev_int_text
    from cmm_align.formats.point_table import matched, read_fiducials, read_limits, read_weights
    from cmm_align.formats.points_text import text_blocks
    from cmm_align.formats.region_toml import read_region
    from cmm_align.formats.registry import (
        FORMATS,
        Format,
        NominalSource,
        read_nominal_source,
        read_points,
        sniff,
    )
    from cmm_align.formats.zemax_grid_sag import zemax_grid_sag_text

__all__ = [
    "FORMATS",
    "NO_HINTS",
    "Format",
    "Hints",
    "NominalSource",
    "codev_int_text",
    "matched",
    "read_fiducials",
    "read_limits",
    "read_nominal_source",
    "read_points",
    "read_region",
    "read_weights",
    "sniff",
    "text_blocks",
    "zemax_grid_sag_text",
]

_HOME: Final = {
    "FORMATS": "registry",
    "Format": "registry",
    "NominalSource": "registry",
    "codev_int_text": "codev_int",
    "matched": "point_table",
    "read_fiducials": "point_table",
    "read_limits": "point_table",
    "read_nominal_source": "registry",
    "read_points": "registry",
    "read_region": "region_toml",
    "read_weights": "point_table",
    "sniff": "registry",
    "text_blocks": "points_text",
    "zemax_grid_sag_text": "zemax_grid_sag",
}


def __getattr__(name: str) -> Any:
    """Load a name from its module when it is first used."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value
