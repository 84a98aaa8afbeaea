"""How an alignment ended, and all that it says beside the pose itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from cmm_align.model.bidirectional import Bidirectional
from cmm_align.model.monte_carlo import MonteCarlo
from cmm_align.model.pose_knowledge import PoseKnowledge
from cmm_align.model.removed_motion import RemovedMotion


class PointStatus(IntEnum):
    """Why a point steers the fit, or does not."""

    USED = 0
    OUTSIDE = 1
    """It does not lie on the nominal."""
    OUTLIER = 2
    """Far from the surface and from its neighbours."""
    EDGE = 3
    """So near the border that an edge that stands proud is touched first."""
    NOT_REACHED = 4
    """The ball does not reach the nominal there."""
    APART = 5
    """Outside the fit region, or turned down otherwise; its deviation is as good as any."""


@dataclass(frozen=True, slots=True)
class FitStep:
    """One line of the record of a fit."""

    phase: str
    """way (a few points, light net), sample (a few points, smooth), all, criterion or scale."""
    movement_mm: float
    """The most that the step has moved a point, mm; 0 for the start of a phase."""
    cost_mm2: float
    """Mean squared residual after it, weighted as the fit is, mm^2."""
    n_used: int


@dataclass(frozen=True, slots=True)
class FreeScale:
    """A scale of the measured cloud that was fitted on request."""

    sigma: float
    """Standard uncertainty of the scale, dimensionless."""
    correlation: Mapping[str, float]
    """With rx, ry, rz, tx, ty, tz and tip_radius: what it cannot be told from."""


@dataclass(frozen=True, slots=True)
class FitReport:
    """How an alignment ended."""

    iterations: int
    stop_reason: str
    converged: bool
    unobservable: tuple[str, ...]
    """Motions that the data cannot tell, in words; held at the start value."""
    pose_sigma: Mapping[str, float]
    """Standard uncertainties tx_um, ty_um, tz_um, rx_urad, ry_urad, rz_urad about the centroid."""
    two_path_difference_nm: float
    distance: str
    """smooth or facet."""
    n_outside: int
    n_outliers: int
    steps: tuple[FitStep, ...] = ()
    """The start of each phase and every step."""
    n_edge: int = 0
    """Points in the band along the border."""
    n_not_reached: int = 0
    n_apart: int = 0
    """Points outside the fit region."""
    warnings: tuple[str, ...] = ()
    """What the operator should know, a sentence each."""
    criterion: str = "least-squares"
    certificate: Mapping[str, float] = field(default_factory=dict)
    """Proof of a minimum zone or least stock: `zone_um` (the value reached), `residual` (how far the proof is
    from exact, dimensionless) and `n_active` (points that prove it); empty for least squares."""
    correlated: bool = False
    """Whether the covariance was raised because neighbouring points err alike (form error)."""
    weights: str = "equal"
    """equal, sigma, area or stated."""
    locked: tuple[str, ...] = ()
    """Motions held at the start on request."""
    lock_frame: str = "part"
    fit_region: str = ""
    """In words; empty where the whole nominal steers the fit."""
    fit_region_text: str | None = None
    """The same as the setting takes it, lengths in mm, frame `surface`; None in older files."""
    report_region: str = ""
    """In words; empty where every deviation counts in the numbers."""
    report_region_text: str = ""
    """The same as the setting takes it, lengths in mm, frame `surface`."""
    n_fiducials: int = 0
    """Datum terms beside the points."""
    scale: float = 1.0
    """What measured lengths were multiplied by: about the part's origin at the start where a temperature was
    given, about the centroid where it was fitted. ``part_from_machine`` takes points after that."""
    free_scale: FreeScale | None = None
    proof_ids: tuple[int, ...] = ()
    """Points that hold a minimum zone or a least stock, or prove that no position is within tolerance."""
    method: str = "foot-point"
    knowledge: PoseKnowledge | None = None
    removed: RemovedMotion | None = None
    monte_carlo: MonteCarlo | None = None
    bidirectional: Bidirectional | None = None

    @property
    def cost_history_mm2(self) -> tuple[float, ...]:
        """Mean squared residual at the start of each phase and after each step, mm^2."""
        return tuple(step.cost_mm2 for step in self.steps)
