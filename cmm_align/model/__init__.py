"""The nouns that travel between stages: frozen, with read-only float64 arrays.

A datum walks one way: `PointSet` + `Nominal` -> `Alignment` -> `DeviationMap` -> `Correction`.
Frames: ``machine`` (as measured), ``part`` (as designed), ``surface`` (the part turned so that the
projection direction is +z; the same as ``part`` unless the nominal lies on its side).
"""

from __future__ import annotations

from cmm_align.model.bidirectional import Bidirectional
from cmm_align.model.comparison import Change, ChangeBand, ChangeRung, Comparison
from cmm_align.model.correction import (
    Correction,
    CorrectionBand,
    CorrectionLimits,
    CorrectionStatus,
    PassPrediction,
    PassResponse,
    ProcessTransfer,
)
from cmm_align.model.fit_report import FitReport, FitStep, FreeScale, PointStatus
from cmm_align.model.gate import GateCheck, GatedExport, GateReport
from cmm_align.model.judgement import Conformance, Judgement
from cmm_align.model.ledger import (
    BandRecord,
    BandResponse,
    Dressing,
    LearnedBand,
    LearnedTransfer,
    Ledger,
    LedgerPass,
    PassOutcome,
    WaveBand,
    WheelWear,
)
from cmm_align.model.low_orders import LowOrders
from cmm_align.model.map_numbers import Irregularity, MadeBy, MapNumbers, SlopeError
from cmm_align.model.monte_carlo import MonteCarlo, PointSpread, Spread
from cmm_align.model.nominal import (
    Equidistant,
    Nominal,
    NominalQuality,
)
from cmm_align.model.point_tables import Fiducials, PointLimits, PointWeights
from cmm_align.model.points import (
    MIN_POINTS,
    IntArray,
    PointKind,
    PointSet,
    frozen_array,
    joined,
)
from cmm_align.model.pose_knowledge import PoseKnowledge
from cmm_align.model.removed_motion import MotionLimits, RemovedMotion
from cmm_align.model.results import (
    Alignment,
    DeviationMap,
    LadderRung,
    MapFilter,
)
from cmm_align.model.root_causes import RootCauses
from cmm_align.model.seat import DoubtfulTouch, Seat
from cmm_align.model.spectrum import Band, Spectrum
from cmm_align.model.statistics import Statistics, Verdict

__all__ = [
    "MIN_POINTS",
    "Alignment",
    "Band",
    "BandRecord",
    "BandResponse",
    "Bidirectional",
    "Change",
    "ChangeBand",
    "ChangeRung",
    "Comparison",
    "Conformance",
    "Correction",
    "CorrectionBand",
    "CorrectionLimits",
    "CorrectionStatus",
    "DeviationMap",
    "DoubtfulTouch",
    "Dressing",
    "Equidistant",
    "Fiducials",
    "FitReport",
    "FitStep",
    "FreeScale",
    "GateCheck",
    "GateReport",
    "GatedExport",
    "IntArray",
    "Irregularity",
    "Judgement",
    "LadderRung",
    "LearnedBand",
    "LearnedTransfer",
    "Ledger",
    "LedgerPass",
    "LowOrders",
    "MadeBy",
    "MapFilter",
    "MapNumbers",
    "MonteCarlo",
    "MotionLimits",
    "Nominal",
    "NominalQuality",
    "PassOutcome",
    "PassPrediction",
    "PassResponse",
    "PointKind",
    "PointLimits",
    "PointSet",
    "PointSpread",
    "PointStatus",
    "PointWeights",
    "PoseKnowledge",
    "ProcessTransfer",
    "RemovedMotion",
    "RootCauses",
    "Seat",
    "SlopeError",
    "Spectrum",
    "Spread",
    "Statistics",
    "Verdict",
    "WaveBand",
    "WheelWear",
    "frozen_array",
    "joined",
]
