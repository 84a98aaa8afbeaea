"""cmm-align: from CMM points to the surface to grind next.

The map of the house, in the order in which a measurement walks through it:

- `cmm_align.formats`, `cmm_align.io` read points, nominals and our own files; `cmm_align.files` finds
  out which is which.
- `cmm_align.dialects` knows what machines say on a wire, line by line, without a port or a file.
- `cmm_align.device` is the port: capture without loss, its journal, replay.
- `cmm_align.surfaces` answers height, slope and curvature of any nominal.
- `cmm_align.stages` holds the four steps: `offset` (equidistant surface), `align` (pose and deviations),
  `error_map` (gridded deviations) and `compensate` (the surface to command next). Pure functions.
- `cmm_align.posts` writes what grinding and figuring machines read, and reads it back.
- `cmm_align.numerics` is the mathematics below them: arrays in, arrays out.
- `cmm_align.selftest` holds cases whose answer is known beforehand, for the user's own machine.
- `cmm_align.report` draws; `cmm_align.cli` is the command line; `cmm_align.virtual` is a window, a CMM
  and a grinder whose truth is known.
- `cmm_align.model`, `pose`, `units`, `config`, `errors` and `provenance` are the words all of them share.

Lengths are mm and angles rad unless a name says otherwise. A deviation is positive where there is
too much material. The four stages, `read`, `write` and the nouns can be used straight from here;
nothing heavy is loaded before one of them is touched.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cmm_align.config import AlignConfig, CompensateConfig, Config, ErrorMapConfig, OffsetConfig
    from cmm_align.files import read, write
    from cmm_align.model import Alignment, Correction, DeviationMap, Nominal, PointKind, PointSet
    from cmm_align.pose import Pose
    from cmm_align.stages.align import align
    from cmm_align.stages.compensate import compensate
    from cmm_align.stages.error_map import error_map
    from cmm_align.stages.offset import offset

__version__ = "0.1.0"

_HOME = {
    "offset": "stages.offset",
    "align": "stages.align",
    "error_map": "stages.error_map",
    "compensate": "stages.compensate",
    "read": "files",
    "write": "files",
    "PointSet": "model",
    "PointKind": "model",
    "Nominal": "model",
    "Alignment": "model",
    "DeviationMap": "model",
    "Correction": "model",
    "Pose": "pose",
    "Config": "config",
    "OffsetConfig": "config",
    "AlignConfig": "config",
    "ErrorMapConfig": "config",
    "CompensateConfig": "config",
}

__all__ = [
    "AlignConfig",
    "Alignment",
    "CompensateConfig",
    "Config",
    "Correction",
    "DeviationMap",
    "ErrorMapConfig",
    "Nominal",
    "OffsetConfig",
    "PointKind",
    "PointSet",
    "Pose",
    "__version__",
    "align",
    "compensate",
    "error_map",
    "offset",
    "read",
    "write",
]


def __getattr__(name: str) -> Any:
    """Load a public name from its room when it is first used."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Name what can be used from here."""
    return sorted(__all__)
