"""What the later stages found: pose and deviations, their map, the correction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from cmm_align.model.nominal import Nominal
from cmm_align.model.points import IntArray
from cmm_align.pose import Pose
from cmm_align.surfaces.protocol import Array, Mask


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
    cost_history_mm2: tuple[float, ...]
    """Mean squared residual before each step, mm^2."""
    distance: str
    """smooth or facet."""
    n_outside: int
    n_outliers: int
    warnings: tuple[str, ...] = ()
    """What the operator should know, a sentence each."""
    criterion: str = "least-squares"
    certificate: Mapping[str, float] = field(default_factory=dict)
    """Proof of a minimum zone or least stock: `zone_um` (the value reached), `residual` (how far the proof is
    from exact, dimensionless) and `n_active` (points that prove it); empty for least squares."""
    correlated: bool = False
    """Whether the covariance was raised because neighbouring points err alike (form error)."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """Measured points laid on the nominal.

    Attributes
    ----------
    nominal : Nominal
    part_from_machine : Pose
    covariance : ndarray, shape (6, 6), rad and mm
        Of a small motion (rx, ry, rz, tx, ty, tz) about the centroid of the used tip centres, in
        frame `part`.
    tip_centre_machine_mm, tip_centre_part_mm : ndarray, shape (N, 3), mm
    contact_part_mm : ndarray, shape (N, 3), mm, frame `part`
        ``tip centre - tip radius * normal``.
    normals : ndarray, shape (N, 3), frame `part`
        Unit normals of the nominal at the foot points.
    deviation_mm : ndarray, shape (N,), mm
        Along the normal, positive = excess material.
    used : ndarray of bool, shape (N,)
        Points that steered the fit.
    ids : ndarray of int64, shape (N,)
    report : FitReport
    """

    nominal: Nominal
    part_from_machine: Pose
    covariance: Array
    tip_centre_machine_mm: Array
    tip_centre_part_mm: Array
    contact_part_mm: Array
    normals: Array
    deviation_mm: Array
    used: Mask
    ids: IntArray
    report: FitReport


@dataclass(frozen=True, slots=True)
class Statistics:
    """Numbers of a set of deviations; the count stands beside them because PV grows with it."""

    n: int
    pv_mm: float
    rms_mm: float
    mean_mm: float
    min_mm: float
    max_mm: float
    min_at_mm: tuple[float, float]
    max_at_mm: tuple[float, float]

    @property
    def profile_mm(self) -> float:
        """Profile of a surface, ISO 1101: twice the largest absolute deviation, mm."""
        return 2.0 * max(abs(self.min_mm), abs(self.max_mm))


@dataclass(frozen=True, slots=True)
class LadderRung:
    """What is left after removing some low-order terms."""

    removed: str
    pv_mm: float
    rms_mm: float


class Verdict(StrEnum):
    """Outcome of a comparison with a tolerance."""

    PASS = "pass"
    FAIL = "fail"
    UNDECIDED = "undecided"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class DeviationMap:
    """Deviations on a grid, in frame `surface`.

    Attributes
    ----------
    alignment : Alignment
        The points behind the map.
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`
    deviation_mm : ndarray, shape (ny, nx), mm
        Along the normal, positive = excess material, NaN where unknown.
    sag_deviation_mm : ndarray, shape (ny, nx), mm
        The same along +z of frame `surface`: ``deviation / n_z``.
    sigma_mm : ndarray, shape (ny, nx), mm
        Standard uncertainty of `deviation_mm` from the scatter of the points.
    statistics : Statistics
        Of the nodes of the grid.
    point_statistics : Statistics
        Of the single points inside the nominal.
    pvr_mm : float
        PV of the 36-term fit plus three times the RMS of the rest.
    u_rms_mm : float
        Standard uncertainty of the RMS.
    ladder : tuple of LadderRung
    verdict : Verdict
    spacing_mm : float
    coverage : float
        Share of the nominal's area that the map knows, 0 to 1.
    verdict_lines : tuple of str
        One sentence a tolerance: what was judged, against what, with which outcome.
    """

    alignment: Alignment
    x_mm: Array
    y_mm: Array
    deviation_mm: Array
    sag_deviation_mm: Array
    sigma_mm: Array
    statistics: Statistics
    point_statistics: Statistics
    pvr_mm: float
    u_rms_mm: float
    ladder: tuple[LadderRung, ...]
    verdict: Verdict
    spacing_mm: float
    coverage: float = float("nan")
    verdict_lines: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Correction:
    """The surface to command next, on a grid in frame `surface`.

    Attributes
    ----------
    nominal : Nominal
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`
    correction_mm : ndarray, shape (ny, nx), mm
        Along the normal, ``-gain * deviation``: negative removes material.
    total_correction_mm : ndarray, shape (ny, nx), mm
        Sum over all passes, relative to the nominal, along the normal.
    commanded_z_mm : ndarray, shape (ny, nx), mm
        Height to command in frame `surface`.
    commanded_normal : ndarray, shape (ny, nx, 3), frame `surface`
        Unit normals of the commanded surface.
    extended : ndarray of bool, shape (ny, nx)
        Nodes without data of their own, continued from their neighbours.
    gain : float
    pass_number : int
        1 for the first compensation.
    predicted : Statistics
        Deviations of the points after the next pass, if the machine cuts what it is told.
    before : Statistics
        Deviations of the points now.
    worth_another_pass : bool
    reason : str
    map_digest : str
        SHA-256 of the map's deviations; a map is never applied twice.
    """

    nominal: Nominal
    x_mm: Array
    y_mm: Array
    correction_mm: Array
    total_correction_mm: Array
    commanded_z_mm: Array
    commanded_normal: Array
    extended: Mask
    gain: float
    pass_number: int
    predicted: Statistics
    before: Statistics
    worth_another_pass: bool
    reason: str
    map_digest: str
    applied_maps: tuple[str, ...] = field(default=())
    """Digests of the maps of all earlier passes, oldest first."""
