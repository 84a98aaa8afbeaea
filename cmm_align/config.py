"""Job settings: one small frozen class per stage, read from TOML; an unknown key is an error.

`configs/default.toml` documents every key and equals the defaults below (a test compares them).
Lengths are mm, angles degrees, as their names say.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final, TypeVar

from cmm_align.errors import MissingFileError, UsageError
from cmm_align.limits import LIMITS
from cmm_align.toml_table import check_keys

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class OffsetConfig:
    """Settings of `offset`."""

    side: str = "+z"
    """Side of the nominal the probe is on, along the projection direction: +z or -z."""
    degree: int = 0
    """Degree of the spline through gridded points: 3, 5, or 0 to choose by the error estimate."""
    nodes: int = 40_000
    """Nodes of the equidistant net of a nominal that is a formula."""
    grid_tolerance: float = 0.02
    """Largest jitter of gridded points, in steps of the grid, that still counts as a grid."""
    feature_curvature_per_mm: float = 0.05
    """Feature regions: principal curvatures that differ by more than this."""
    edge_proud_um: float = 10.0
    """An edge that stands proud by this much must not be touched before the nominal: the edge band."""
    plan_spacing_mm: float = 0.0
    """Spacing of the measuring plan; 0 chooses it from the two bounds below."""
    plan_facet_error_um: float = 1.0
    """Facets through the points of the plan shall lie this near to the surface, if `plan_points` allow."""
    plan_points: int = 5_000
    """Most points of the plan at its base spacing; feature regions come on top."""
    plan_speed_mm_s: float = 10.0
    """Speed between the points of the plan, for the estimate of the time."""
    plan_point_s: float = 1.0
    """Time of one touch, for the same."""


@dataclass(frozen=True, slots=True)
class AlignConfig:
    """Settings of `align`."""

    distance: str = "smooth"
    """smooth: orthogonal foot point; facet: the plane of the triangle (the paper's method)."""
    search: str = "auto"
    """Search all poses: auto (where the start may have led astray and none was given), always, never."""
    criterion: str = "least-squares"
    """least-squares; minimum-zone: smallest largest deviation; least-stock: no deviation below zero, the
    largest as small as can be (the least to take off so that the part cleans up everywhere);
    within-tolerance: is there any position in which every point keeps its limits?"""
    tolerance_lower_um: float = 0.0
    """For within-tolerance: least deviation; both limits 0 ask for a file of limits."""
    tolerance_upper_um: float = 0.0
    """For within-tolerance: largest deviation."""
    weights: str = "equal"
    """equal; sigma: one over the square of the stated uncertainty of each point; area: the surface that each
    point stands for, so that an uneven scan does not bias; stated: a column or file of weights."""
    lock: str = ""
    """Motions held at the start: any of rx, ry, rz, tx, ty, tz, with commas between."""
    lock_frame: str = "part"
    """Frame whose axes they are along: part or machine."""
    centre: str = ""
    """Centre of rotation for locked motions in that frame, "x, y, z"; its origin by default."""
    fit_region: str = ""
    """Only points there steer the fit: circle:X,Y,R rectangle:X,Y,W,H annulus:X,Y,R1,R2 polygon:X1,Y1,...
    aperture:-D."""
    report_region: str = ""
    """Only points there count in the numbers and in the map; the whole nominal by default."""
    edge_proud_um: float = 10.0
    """Points so near the border that an edge proud by this much is touched first do not steer the fit."""
    scale: str = "fixed"
    """fixed, or free: fit a scale of the measured cloud too."""
    temperature_c: float = 20.0
    """Temperature of the part when it was measured."""
    expansion_per_k: float = 0.0
    """Its coefficient of thermal expansion, relative to the scales of the machine."""
    outliers: str = "reject"
    """reject: points far from the surface and from their neighbours do not steer the fit, and are listed;
    keep: every point on the nominal counts."""
    trust_me: bool = False
    """Go on although the data look like a mistake: contact points, a diameter for a radius, wrong side."""
    method: str = "foot-point"
    """foot-point; or, to compare with: icp, point-to-plane, facet, xiong, estimated-normals."""
    monte_carlo: int = 0
    """Simulated repetitions of the measurement, for the uncertainty of pose, PV and RMS; 0 for none."""
    mpe: str = ""
    """Error of length measurement that the machine is specified with, in um, L in mm: "0.7+L/400"."""
    seed: int = 1
    """Of the simulated errors: the same seed gives the same numbers."""
    bidirectional: bool = False
    """Triangulate the measured cloud too, and measure the nominal against it."""
    max_wedge_arcmin: float = 0.0
    """What the drawing allows of the motion that the best fit takes away; 0 is no limit."""
    max_decentre_um: float = 0.0
    max_clocking_arcmin: float = 0.0
    max_thickness_um: float = 0.0
    max_iterations: int = 50
    coarse_points: int = 10_000
    """Points that carry the first iterations; the last ones use all."""
    max_rotation_step_deg: float = 30.0
    step_tolerance: float = 1e-12
    """Stop when the next step would move no point by more than this share of the part's size."""
    min_observability: float = 1e-8
    """A motion is unobservable below this share of the strongest one (scaled, dimensionless)."""


@dataclass(frozen=True, slots=True)
class ErrorMapConfig:
    """Settings of `error-map`."""

    spacing_mm: float = 0.0
    """Grid spacing; 0 chooses it from the density of the points."""
    window: float = 1.5
    """Half width of the window of the local regression, in grid steps."""
    max_nodes: int = 512
    """Most nodes along the longer side of the grid."""
    report_region: str = ""
    """Only points there count in numbers, map and verdict, as for `align`; that of `align` by default."""
    filter: str = "gaussian"
    """gaussian (regression of order 2), gaussian-order-0, gaussian-robust or spline; used with a cutoff."""
    low_pass_mm: float = 0.0
    """Take waves shorter than this away; 0 keeps them."""
    high_pass_mm: float = 0.0
    """Take waves longer than this away; 0 keeps them."""
    picture_scale_um: float = 0.0
    """Colours and axes of all pictures reach from minus to plus this; 0 for what each map needs."""
    cause_axis: str = ""
    """Axis of rotation of the grinding machine, "x, y" in the frame of the map, for root causes; the centre
    of the aperture by default."""
    tolerance_pv_um: float = 0.0
    """Tolerance on PV; 0 gives no verdict."""
    tolerance_rms_um: float = 0.0
    """Tolerance on RMS; 0 gives no verdict."""
    tolerance_profile_um: float = 0.0
    """Tolerance on the profile, 2 max|e| (ISO 1101: the width of the zone); 0 gives no verdict."""
    tolerance_slope_mrad: float = 0.0
    """Tolerance on the largest slope error, mrad (um per mm); 0 gives no verdict."""
    tolerance_band_lower_um: float = 0.0
    """Least deviation; both limits 0 give no verdict."""
    tolerance_band_upper_um: float = 0.0
    """Largest deviation."""
    decision: str = "guard-band"
    """guard-band: pass and fail only beyond the uncertainty (ISO 14253-1); simple: as measured."""
    guard_factor: float = 1.65
    """Guard band in standard uncertainties (ISO 14253-1, 95 % one-sided)."""


@dataclass(frozen=True, slots=True)
class CompensateConfig:
    """Settings of `compensate`."""

    gain: float = 1.0
    """Share of the deviation to take off in one pass."""
    gain_rule: str = "fixed"
    """fixed: this gain for all waves that are corrected; wiener: a gain for each wavelength, by how far the
    form stands out of the noise."""
    force_gain: bool = False
    """Allow a gain over 1.2, below 2."""
    low_pass_mm: float = 0.0
    """Correct no shorter waves than this; 0 leaves it to spacing, noise and wheel."""
    region: str = ""
    """Correct only there (circle:X,Y,R and so on), fading out around it; the whole nominal by default."""
    edge_taper_mm: float = 0.0
    """Width over which the correction fades where nothing was measured; 0 for that of the wheel's contact."""
    min_points_per_cell: int = 3
    """Do not correct by fewer points to a cell: a square of half the shortest corrected wave."""
    transfer: str = ""
    """Share of a commanded change that reaches the part: "0.9", or "0.95@30mm, 0.8@10mm"; 1 if not given."""
    u_transfer: float = 0.1
    """Its standard uncertainty."""
    repeatability_um: float = 0.5
    """RMS of what differs from pass to pass after a best fit."""
    repeatability_length_mm: float = 0.0
    """Its correlation length; 0 for a twelfth of the diagonal of the part."""
    trust_me: bool = False
    """Go on although the last pass was not ground, or made the part worse."""
    max_correction_um: float = 200.0
    """Refuse a larger correction."""
    warn_slope_mrad: float = 2.0
    """Warn of a steeper correction."""
    max_slope_mrad: float = 5.0
    """Refuse a steeper correction."""
    thickness_budget_um: float = 0.0
    """Most that all passes together may take off; 0 is no limit."""
    text_decimals: int = 6
    """Decimals, in mm, of the exported text."""
    wheel_radius_mm: float = 0.0
    """Radius of the grinding wheel where it is largest; 0 if it is not known."""
    wheel_tip_radius_mm: float = 0.0
    """Radius of the rounded rim of a toroidal wheel; 0 for a spherical one."""
    wheel_axis: str = "y"
    """Axis that a toroidal wheel turns about, in frame `part`: x, y, z, or a direction as "0, 0.6, 0.8"."""
    depth_of_cut_um: float = 0.0
    """Most that the pass takes off anywhere; 0 if it is not known."""
    depth_margin_um: float = 2.0
    """Least that it must take off everywhere, so that the wheel does not run in air."""
    ledger: str = ""
    """File of the passes of a family of parts, to learn from and to add to; none if empty."""
    machine: str = ""
    """Grinder of the ledger; a ledger of another one is refused."""
    wheel: str = ""
    """Wheel in it, in the same way."""


@dataclass(frozen=True, slots=True)
class ExportConfig:
    """Settings of what `compensate` writes for machines."""

    formats: str = "xyz"
    """Any of xyz, xyzijk, zemax, heidenhain, gcode-raster, gcode-spiral, template, dwell, with commas."""
    post: str = ""
    """File that describes the format `template`."""
    feed_mm_min: float = 200.0
    """Feed of the tool centre."""
    line_spacing_mm: float = 0.0
    """Most between the lines of a tool path; 0 takes every line of the grid."""
    point_spacing_mm: float = 0.0
    """Most between its points; 0 takes every node of the grid."""
    chord_um: float = 0.1
    """Most that straight moves between points may leave the path; points are put between nodes for it."""
    raster_along: str = "x"
    """Lines of a raster: along x or y of frame `surface`."""
    spiral_direction: str = "inwards"
    """inwards or outwards."""
    safe_height_mm: float = 10.0
    """Rapid moves stay this far above the highest point of the path."""
    max_lines: int = 0
    """Most lines that the control takes; 0 is no limit."""
    footprint_radius_mm: float = 0.0
    """Radius of the tool's footprint, by which a dwell grid reaches past the aperture."""


@dataclass(frozen=True, slots=True)
class Config:
    """All settings of a job."""

    offset: OffsetConfig = OffsetConfig()
    align: AlignConfig = AlignConfig()
    error_map: ErrorMapConfig = ErrorMapConfig()
    compensate: CompensateConfig = CompensateConfig()
    export: ExportConfig = ExportConfig()


ALIGN_CHOICES: Final[dict[str, tuple[str, ...]]] = {
    "distance": ("smooth", "facet"),
    "outliers": ("reject", "keep"),
    "search": ("auto", "always", "never"),
    "criterion": ("least-squares", "minimum-zone", "least-stock", "within-tolerance"),
    "weights": ("equal", "sigma", "area", "stated"),
    "lock_frame": ("part", "machine"),
    "scale": ("fixed", "free"),
    "method": ("foot-point", "icp", "point-to-plane", "facet", "xiong", "estimated-normals"),
}
"""What the settings of `align` that are names may be."""

GAIN_RULES: Final = ("fixed", "wiener")
"""What the rule of the gain may be."""

FILTERS: Final = ("gaussian", "gaussian-order-0", "gaussian-robust", "spline")
"""What the filter of `error-map` may be."""

EXPORTS: Final = (
    "xyz",
    "xyzijk",
    "zemax",
    "heidenhain",
    "gcode-raster",
    "gcode-spiral",
    "template",
    "dwell",
)
"""What `compensate` can write for machines."""

RASTERS: Final = ("x", "y")
"""What the lines of a raster may be along."""

SPIRALS: Final = ("inwards", "outwards")
"""How a spiral may run."""

DECISIONS: Final = ("guard-band", "simple")
"""Decision rules of `error-map`."""


def read_config(paths: Sequence[Path | str]) -> Config:
    """Return the defaults overlaid by TOML files, later ones winning.

    Raises
    ------
    MissingFileError
        If a file cannot be opened.
    UsageError
        If a file is not TOML, or holds a key that is not known or of another type.
    """
    config = Config()
    for path in paths:
        try:
            text = Path(path).read_text(encoding="utf-8")
        except OSError as error:
            raise MissingFileError(f"cannot read it ({error.strerror})", where=str(path)) from None
        try:
            table = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise UsageError(f"not valid TOML: {error}", where=str(path)) from None
        config = overlaid(config, table, where=str(path))
    return config


def overlaid(settings: T, table: Mapping[str, Any], *, where: str) -> T:
    """Return `settings` with the values of `table` put over them, section by section.

    Raises
    ------
    UsageError
        If a key is not known (the nearest known one is named) or a value has another type.
    """
    known = {f.name: getattr(settings, f.name) for f in fields(settings)}  # type: ignore[arg-type]
    changes: dict[str, Any] = {}
    check_keys({key.replace("-", "_"): None for key in table}, known, where=where, error=UsageError)
    for key, value in table.items():
        name = key.replace("-", "_")
        default = known[name]
        if isinstance(value, Mapping) and hasattr(default, "__dataclass_fields__"):
            changes[name] = overlaid(default, value, where=f"{where}:[{key}]")
        elif isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
            changes[name] = float(value)
        elif type(value) is not type(default):
            raise UsageError(f"{key} = {value!r}", where=where, expected=f"a value like {default!r}")
        else:
            changes[name] = value
        _check_limits(name, value, where=where)
    return replace(settings, **changes)  # type: ignore[type-var]


def checked(settings: T) -> T:
    """Return settings that were put together by hand, if every number is within `LIMITS`.

    Raises
    ------
    UsageError
        If one is not.
    """
    for field in fields(settings):  # type: ignore[arg-type]
        _check_limits(field.name, getattr(settings, field.name), where="")
    return settings


def _check_limits(name: str, value: object, *, where: str) -> None:
    """Refuse a number outside its limits."""
    low, high = LIMITS.get(name, (-float("inf"), float("inf")))
    if isinstance(value, int | float) and not low <= value <= high:
        raise UsageError(f"{name} = {value!r}", where=where, expected=f"{low:g} to {high:g}")
