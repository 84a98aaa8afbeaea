"""The nouns that travel between stages: frozen, with read-only float64 arrays.

A datum walks one way: `PointSet` + `Nominal` -> `Alignment` -> `DeviationMap` -> `Correction`.
Frames: ``machine`` (as measured), ``part`` (as designed), ``surface`` (the part turned so that the
projection direction is +z; the same as ``part`` unless the nominal lies on its side).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmm_align.errors import MalformedInputError
from cmm_align.pose import Pose
from cmm_align.surfaces.protocol import Array, Mask, Surface

IntArray = NDArray[np.int64]

MIN_POINTS: Final = 6
"""A rigid motion has six unknowns."""


def frozen_array(values: ArrayLike, dtype: type = np.float64) -> Any:
    """Return `values` (any shape, any unit) as a read-only array of `dtype`; a view where it is one."""
    array: NDArray[Any] = np.asarray(values, dtype=dtype).view()
    array.flags.writeable = False
    return array


class PointKind(StrEnum):
    """What a measured point is."""

    TIP_CENTRE = "tip_centre"
    """Centre of the probe ball."""
    CONTACT = "contact"
    """Point on the part: the tip radius has been taken off already."""
    NOMINAL = "nominal"
    """Point of the design, not measured at all."""
    COMMANDED = "commanded"
    """Point of a surface to grind, written by `compensate`."""
    UNSTATED = "unstated"


@dataclass(frozen=True, slots=True)
class PointSet:
    """Points as read.

    Attributes
    ----------
    points_mm : ndarray, shape (N, 3), mm, frame `frame`
    kind : PointKind
    frame : str
        ``machine`` or ``part``.
    ids : ndarray of int64, shape (N,)
        Number of each point in its source, from 0 unless the file numbers them.
    source : str
        Where the points came from, for messages.
    sigma_mm : ndarray, shape (N,), mm, or None
        Standard uncertainty of each point where the source states it.
    """

    points_mm: Array
    kind: PointKind
    frame: str
    ids: IntArray
    source: str
    sigma_mm: Array | None = None

    @classmethod
    def of(
        cls,
        points_mm: ArrayLike,
        *,
        kind: PointKind = PointKind.UNSTATED,
        frame: str = "machine",
        ids: ArrayLike | None = None,
        source: str = "points",
        sigma_mm: ArrayLike | None = None,
    ) -> PointSet:
        """Return a checked set of points.

        Parameters
        ----------
        points_mm : array_like, shape (N, 3), mm, frame `frame`
            Copied only if it is not a contiguous float64 array.
        kind, frame, ids, source, sigma_mm
            As the attributes; `ids` of shape (N,) are 0, 1, 2 ... if left out.

        Raises
        ------
        MalformedInputError
            If the array is not (N, 3) or holds a value that is not finite.
        """
        points = np.ascontiguousarray(points_mm, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise MalformedInputError(
                f"array of shape {points.shape}", where=source, expected="(N, 3): x, y, z"
            )
        finite = np.isfinite(points).all(axis=1)
        if not finite.all():
            first = int(np.argmin(finite))
            raise MalformedInputError(
                f"point {first + 1} of {len(points)} is not finite ({points[first]})",
                where=source,
                expected="finite numbers",
                remedy="remove the point at its source",
            )
        numbers = np.arange(len(points)) if ids is None else ids
        return cls(
            frozen_array(points),
            kind,
            frame,
            frozen_array(numbers, np.int64),
            source,
            None if sigma_mm is None else frozen_array(sigma_mm),
        )

    def __len__(self) -> int:
        return len(self.points_mm)


@dataclass(frozen=True, slots=True)
class Equidistant:
    """The surface one tip radius out from the nominal: nodes, facets and a smooth surface.

    Attributes
    ----------
    nominal_points_mm : ndarray, shape (n, 3), mm, frame `part`
        Nodes on the nominal.
    normals : ndarray, shape (n, 3), frame `part`
        Unit normals towards the probe.
    slope, gaussian_curvature_per_mm2 : ndarray, shape (n,)
        Of the nominal over its projection plane.
    points_mm : ndarray, shape (n, 3), mm, frame `part`
        ``nominal + tip radius * normal``.
    triangles : ndarray of int32, shape (m, 3)
        Delaunay triangulation of the projection; counter-clockwise in frame `surface`.
    regular : ndarray of bool, shape (n,)
        Where ``tip radius * concave curvature < 1``.
    """

    nominal_points_mm: Array
    normals: Array
    slope: Array
    gaussian_curvature_per_mm2: Array
    points_mm: Array
    triangles: NDArray[np.int32]
    regular: Mask


@dataclass(frozen=True, slots=True)
class NominalQuality:
    """What `offset` found out about a nominal; lengths as their names say."""

    n_points: int
    max_slope_deg: float
    min_concave_radius_mm: float | None
    """Smallest radius of curvature towards the probe; None where the surface is nowhere concave."""
    min_concave_at_mm: tuple[float, float] | None
    regular: bool
    facet_error_pv_nm: float
    surface_error_pv_nm: float
    equidistant_error_pv_nm: float
    """Largest misfit of the smooth equidistant surface at its nodes."""
    spacing_mm: tuple[float, float]
    degree: int
    """Degree of the spline through the nominal points; 0 for a closed form."""


@dataclass(frozen=True, slots=True)
class Nominal:
    """A nominal surface with the ball that touches it.

    Attributes
    ----------
    surface : Surface
        Height field in frame `surface`.
    side : int
        +1 if the probe is on the +z side of frame `surface`, -1 if on the -z side.
    tip_radius_mm : float
        Effective tip radius, mm.
    surface_from_part : Pose
        Rotation that turns the projection direction to +z.
    digest : str
        SHA-256 of the definition of the surface and its side (hex).
    equidistant_surface : Surface or None
        Smooth surface fitted to the equidistant points, frame `surface`: the second path to a
        deviation. None in the copies that later stages carry.
    equidistant : Equidistant or None
        Nodes and facets; loaded only where they are needed.
    quality : NominalQuality or None
    """

    surface: Surface
    side: int
    tip_radius_mm: float
    surface_from_part: Pose
    digest: str
    equidistant_surface: Surface | None = None
    equidistant: Equidistant | None = None
    quality: NominalQuality | None = None

    @property
    def kind(self) -> str:
        """Kind of the surface: grid, scattered, mesh or prescription."""
        return self.surface.kind


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
