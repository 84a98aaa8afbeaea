"""Numbers of a deviation map: each with its standard uncertainty where one can be had, and what made them.

Fields that begin with ``u_`` are standard uncertainties (k = 1) in the unit of what they stand beside; None
is "not known". Deviations are along the normal, positive = excess material; places are x and y in frame
`surface`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Irregularity:
    """Indications of ISO 10110-5, ``3/A(B/C) RMSt; RMSi; RMSa``, as deviations along the normal, um.

    The standard speaks of interference fringes on spheres. Here `t` is without the motions along z and about
    x and y; `i` without the best power too, which is the normal offset of a small change of curvature,
    ``n_z (x^2 + y^2)`` about the middle of the known nodes; `a` without the best shape that is
    rotationally symmetric about that middle. The RMS are without the share of noise, B is as it is.
    """

    a_um: float
    """A: PV of the power, + = the border stands higher than the middle."""
    u_a_um: float
    b_um: float
    """B: PV of the irregularity, what is left without power."""
    u_b_um: float | None
    c_um: float
    """C: PV of the rotationally symmetric part of the irregularity."""
    u_c_um: float
    rms_t_um: float
    u_rms_t_um: float
    rms_i_um: float
    u_rms_i_um: float
    rms_a_um: float
    u_rms_a_um: float


@dataclass(frozen=True, slots=True)
class SlopeError:
    """Slope of the deviation along the surface, mrad (which is um per mm)."""

    rms_mrad: float
    """Without the share of noise."""
    u_rms_mrad: float | None
    noise_mrad: float
    """RMS of the slopes that noise alone makes."""
    max_mrad: float
    """The largest, as it is on the map."""
    max_without_noise_mrad: float
    """The largest, less what noise adds to a largest value on average."""
    u_max_mrad: float | None
    max_at_mm: tuple[float, float]
    n_left_out: int
    """Nodes whose slope is known more than three times worse than that of most."""
    base_mm: float
    """Length over which a slope is taken: shorter waves are not in it."""
    method: str


@dataclass(frozen=True, slots=True)
class MadeBy:
    """What the numbers depend on beside the part."""

    criterion: str
    """What the fit made small."""
    distance: str
    method: str
    weights: str
    """Of the points in the fit."""
    node_weights: str
    """Of the nodes in mean, RMS and percentiles."""
    locked: tuple[str, ...]
    lock_frame: str
    scale: float
    filter: str
    """In words; empty where nothing was taken away."""
    fit_region: str
    report_region: str
    n_outliers: int
    """Points left out as outliers."""
    n_left_out: int
    """Points that do not count for all reasons together, outliers among them."""
    not_in_u: str
    """What the uncertainties do not hold."""


@dataclass(frozen=True, slots=True)
class MapNumbers:
    """Numbers of the nodes of a map, and of the points behind them.

    Noise adds to every RMS and to every extreme. A number *without noise* has that share taken out, and holds
    what single points show for certain beyond the map; its standard uncertainty stands beside it. A number
    as measured is uncertain by that and by the difference of the two.
    """

    n_nodes: int
    n_points: int
    noise_um: float
    """Standard deviation of a single touch, as nearest neighbours tell it."""
    scatter_um: float
    """Standard deviation of single points about the map: noise, and waves that the grid does not carry."""
    pv_um: float
    """As all numbers that say nothing else: of the nodes, as they are."""
    pv_without_noise_um: float
    u_pv_um: float
    rms_um: float
    rms_without_noise_um: float
    u_rms_um: float
    profile_um: float
    """Twice the largest absolute deviation (ISO 1101)."""
    profile_without_noise_um: float
    u_profile_um: float
    points_pv_um: float
    points_rms_um: float
    points_profile_um: float
    """Of the single points: noise and all."""
    pvr_um: float
    """PV of the 36-term fit and three times the RMS of the rest."""
    mean_um: float
    u_mean_um: float
    min_um: float
    min_without_noise_um: float
    u_min_um: float
    min_at_mm: tuple[float, float]
    max_um: float
    max_without_noise_um: float
    u_max_um: float
    max_at_mm: tuple[float, float]
    percentiles_um: Mapping[str, float]
    """Deviation below which so many percent of the area lie, by the percentage: "0.1" ... "99.9"."""
    width_99_6_um: float
    """P99.8 - P0.2: the PV of all but the outermost 0.4 % of the area."""
    band_um: tuple[float, float] | None
    """The band that the shares below are counted in; None where no tolerance says one, or it differs from
    point to point."""
    points_in_tolerance: float | None
    """Share of the single points, 0 to 1; None without a tolerance on single deviations."""
    area_in_tolerance: float | None
    """Share of the measured area by the nodes, 0 to 1."""
    slope: SlopeError | None
    irregularity: Irregularity | None
    made_by: MadeBy
