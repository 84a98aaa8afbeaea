"""What the later stages found: pose and deviations, and their map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmm_align.model.comparison import Comparison
from cmm_align.model.fit_report import FitReport
from cmm_align.model.judgement import Conformance
from cmm_align.model.low_orders import LowOrders
from cmm_align.model.map_numbers import MapNumbers
from cmm_align.model.nominal import Nominal
from cmm_align.model.points import IntArray
from cmm_align.model.root_causes import RootCauses
from cmm_align.model.spectrum import Spectrum
from cmm_align.model.statistics import Statistics, Verdict
from cmm_align.pose import Pose
from cmm_align.surfaces.protocol import Array, Mask


@dataclass(frozen=True, slots=True)
class Alignment:
    """Measured points laid on the nominal.

    Attributes
    ----------
    nominal : Nominal
    part_from_machine : Pose
    covariance : ndarray, shape (6, 6), rad and mm
        Of a small motion (rx, ry, rz, tx, ty, tz) about `centroid_mm`, in frame `part`.
    tip_centre_machine_mm, tip_centre_part_mm : ndarray, shape (N, 3), mm
    contact_part_mm : ndarray, shape (N, 3), mm, frame `part`
        ``tip centre - tip radius * normal``.
    normals : ndarray, shape (N, 3), frame `part`
        Unit normals of the nominal at the foot points.
    deviation_mm : ndarray, shape (N,), mm
        Along the normal, positive = excess material.
    used : ndarray of bool, shape (N,)
        Points that steered the fit.
    judged : ndarray of bool, shape (N,)
        Points whose deviation counts in numbers and map: all that touched the nominal, within the report
        region where there is one.
    status : ndarray of uint8, shape (N,)
        `PointStatus`.
    ids : ndarray of int64, shape (N,)
    report : FitReport
    sigma_mm : ndarray, shape (N,), mm, or None
        Standard uncertainty of the single deviations: simulated where a Monte Carlo was asked for, else as
        the measurement states it.
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
    judged: Mask
    status: NDArray[np.uint8]
    ids: IntArray
    report: FitReport
    sigma_mm: Array | None = None

    @property
    def centroid_mm(self) -> Array:
        """Centroid of all tip centres, shape (3,), mm, frame `part`: what small motions turn about."""
        return np.asarray(self.tip_centre_part_mm.mean(axis=0), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class LadderRung:
    """What is left after removing some low-order terms."""

    removed: str
    pv_mm: float
    rms_mm: float
    pvr_mm: float = float("nan")
    """PV of the 36-term fit plus three times the RMS of the rest; NaN in files of older versions."""


@dataclass(frozen=True, slots=True)
class MapFilter:
    """Which waves a map has left; 0 is no cutoff. Half of a wave at a cutoff is kept."""

    kind: str
    low_pass_mm: float
    """Shorter waves were taken away."""
    high_pass_mm: float
    """Longer waves were taken away."""

    @property
    def words(self) -> str:
        """Return the filter in words."""
        if self.low_pass_mm and self.high_pass_mm:
            band = f"band pass {self.low_pass_mm:g} to {self.high_pass_mm:g} mm"
        elif self.low_pass_mm:
            band = f"low pass {self.low_pass_mm:g} mm"
        else:
            band = f"high pass {self.high_pass_mm:g} mm"
        return f"{self.kind}, {band}"


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
        Standard uncertainty of `deviation_mm` from the scatter of the points, and from their simulated
        uncertainty where the alignment carries it.
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
    method : str
        How nodes came of points, in words; empty in files of older versions.
    window_steps : float
        Half width of the window of the local regression, in grid steps; 0 in files of older versions.
    filter : MapFilter or None
        What was taken away from the nodes; single points are never filtered.
    low_orders : LowOrders or None
        What the form error consists of; None in files of older versions.
    comparison : Comparison or None
        What changed since an earlier measurement, where one was given.
    root_causes : RootCauses or None
        Single settings that explain it, of the points as they are; None in files of older versions.
    spectrum : Spectrum or None
        Which wavelengths it has, or why that cannot be told; None in files of older versions.
    numbers : MapNumbers or None
        All numbers of the map with their uncertainties; None in files of older versions.
    conformance : Conformance or None
        Each tolerance judged; None without a tolerance and in files of older versions.
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
    method: str = ""
    window_steps: float = 0.0
    filter: MapFilter | None = None
    low_orders: LowOrders | None = None
    comparison: Comparison | None = None
    root_causes: RootCauses | None = None
    spectrum: Spectrum | None = None
    numbers: MapNumbers | None = None
    conformance: Conformance | None = None
