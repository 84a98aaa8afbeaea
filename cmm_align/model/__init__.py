"""The nouns that travel between stages: frozen, with read-only float64 arrays.

A datum walks one way: `PointSet` + `Nominal` -> `Alignment` -> `DeviationMap` -> `Correction`.
Frames: ``machine`` (as measured), ``part`` (as designed), ``surface`` (the part turned so that the
projection direction is +z; the same as ``part`` unless the nominal lies on its side).
"""

from __future__ import annotations

from cmm_align.model.nominal import (
    Equidistant,
    Nominal,
    NominalQuality,
)
from cmm_align.model.points import (
    MIN_POINTS,
    IntArray,
    PointKind,
    PointSet,
    frozen_array,
)
from cmm_align.model.results import (
    Alignment,
    Correction,
    DeviationMap,
    FitReport,
    LadderRung,
    Statistics,
    Verdict,
)

__all__ = [
    "MIN_POINTS",
    "Alignment",
    "Correction",
    "DeviationMap",
    "Equidistant",
    "FitReport",
    "IntArray",
    "LadderRung",
    "Nominal",
    "NominalQuality",
    "PointKind",
    "PointSet",
    "Statistics",
    "Verdict",
    "frozen_array",
]
