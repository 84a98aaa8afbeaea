"""The rows of the one-screen summary of each stage: (label, value with unit), most telling first.

Pure text: the command line decides on layout and colour.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from cmm_align.model import (
    Alignment,
    Correction,
    DeviationMap,
    FitReport,
    LadderRung,
    Nominal,
    Statistics,
    Verdict,
)
from cmm_align.pose import Pose
from cmm_align.units import DEG_PER_RAD, UM_PER_MM

Rows = list[tuple[str, str]]


def of_nominal(nominal: Nominal) -> Rows:
    """Return the summary of `offset`."""
    b = nominal.surface.bounds
    rows = [
        ("nominal", f"{nominal.kind}, {b.x_max - b.x_min:.2f} x {b.y_max - b.y_min:.2f} mm"),
        ("tip radius", f"{nominal.tip_radius_mm:g} mm, probe on the {_side(nominal)} side"),
    ]
    q = nominal.quality
    if q is None:
        return rows
    dx, dy = q.spacing_mm
    rows.append(("points", f"{q.n_points}, spacing {_length(dx)} x {_length(dy)}"))
    rows.append(("steepest slope", f"{q.max_slope_deg:.2f} deg"))
    if q.min_concave_radius_mm is None:
        rows.append(("tightest bowl", "none: nowhere concave towards the probe"))
    else:
        at = "" if q.min_concave_at_mm is None else f" at {_place(q.min_concave_at_mm)}"
        rows.append(("tightest bowl", f"radius {_length(q.min_concave_radius_mm)}{at}"))
    rows.append(
        (
            "equidistant",
            "regular everywhere" if q.regular else "NOT regular: the ball does not fit everywhere",
        )
    )
    if q.n_not_reached:
        rows.append(("not reached", f"{q.n_not_reached} of {q.n_points} nodes"))
    if q.n_feature:
        rows.append(("feature regions", f"{q.n_feature} of {q.n_points} nodes"))
    how = "closed form" if q.degree == 0 else f"spline of degree {q.degree}"
    rows.append(
        (
            "surface error",
            f"{_nm(q.surface_error_pv_nm)} PV ({how}); flat facets {_nm(q.facet_error_pv_nm)} PV",
        )
    )
    return rows


def of_alignment(alignment: Alignment) -> Rows:
    """Return the summary of `align`."""
    r = alignment.report
    used = alignment.used
    e = alignment.deviation_mm[used]
    low, high = float(e.min()), float(e.max())
    rows = [
        ("points", f"{int(used.sum())} of {len(used)} used; {r.n_outside} outside, {r.n_outliers} outliers"),
        ("RMS", _um(math.sqrt(float((e**2).mean())))),
        ("PV", f"{_um(high - low)}  ({_extreme(low)} to {_extreme(high)})"),
        ("part_from_machine", _pose(alignment.part_from_machine)),
        ("uncertainty (k=1)", _pose_sigma(r.pose_sigma)),
    ]
    if r.unobservable:
        rows.append(("not observable", ", ".join(r.unobservable) + "; held at the start value"))
    return rows


def _criterion(report: FitReport) -> str:
    """Say what the fit made small, and how well that is proved."""
    if not report.certificate:
        return report.criterion
    proof = report.certificate
    return (
        f"{report.criterion}, {proof['zone_um']:.4g} um, proved by {proof['n_active']:.0f} points "
        f"to {proof['residual']:.0e}"
    )


def details_of_alignment(alignment: Alignment) -> Rows:
    """Return what `align` has to say beyond its summary."""
    r = alignment.report
    turn = alignment.part_from_machine.rotation_vector_rad()
    rows = [
        ("rotation vector", f"({_triple(turn * DEG_PER_RAD, 6)}) deg"),
        ("stopped", f"after {r.iterations} iterations: {r.stop_reason}"),
        ("distance", r.distance),
        ("two paths differ by", _nm(r.two_path_difference_nm)),
        ("criterion", _criterion(r)),
    ]
    if r.cost_history_mm2:
        steps = ", ".join(f"{math.sqrt(max(c, 0.0)) * UM_PER_MM:.4g}" for c in r.cost_history_mm2)
        rows.append(("RMS before each step", f"{steps} um"))
    return rows


def verdict_of(deviation_map: DeviationMap) -> tuple[str, tuple[str, ...]]:
    """Return the verdict in one word and a sentence for each tolerance; two empties without a tolerance."""
    m = deviation_map
    if m.verdict == Verdict.NONE:
        return "", ()
    extra = ("inside the guard band: neither within nor out",) if m.verdict == Verdict.UNDECIDED else ()
    return m.verdict.value.upper(), (*m.verdict_lines, *extra)


def of_map(deviation_map: DeviationMap) -> Rows:
    """Return the summary of `error-map`, without its verdict."""
    m, s = deviation_map, deviation_map.statistics
    ny, nx = m.deviation_mm.shape
    p = m.point_statistics
    rows = [
        ("PV", f"{_um(s.pv_mm)}   (single points {_um(p.pv_mm)})"),
        ("RMS", f"{_um(s.rms_mm)}   (single points {_um(p.rms_mm)}; u {_um(m.u_rms_mm)})"),
        ("highest", f"{_extreme(s.max_mm)} at {_place(s.max_at_mm)}"),
        ("lowest", f"{_extreme(s.min_mm)} at {_place(s.min_at_mm)}"),
    ]
    rows += [_rung(rung) for rung in m.ladder if rung.removed == "+ power"]
    if math.isfinite(m.coverage):
        rows.append(("coverage", f"{_percent(m.coverage)} of the nominal's area, by {p.n} points"))
    rows.append(("grid", f"{s.n} of {nx} x {ny} nodes, {_length(m.spacing_mm)} apart"))
    rows.append(("sign", _sign(m.alignment.nominal)))
    return rows


def details_of_map(deviation_map: DeviationMap) -> Rows:
    """Return what `error-map` has to say beyond its summary."""
    m, s, p = deviation_map, deviation_map.statistics, deviation_map.point_statistics
    return [
        ("mean", _extreme(s.mean_mm)),
        ("profile (ISO 1101)", _um(s.profile_mm)),
        ("PVr", _um(m.pvr_mm)),
        ("highest point", f"{_extreme(p.max_mm)} at {_place(p.max_at_mm)}"),
        ("lowest point", f"{_extreme(p.min_mm)} at {_place(p.min_at_mm)}"),
        *(_rung(rung) for rung in m.ladder[1:] if rung.removed != "+ power"),
    ]


def of_correction(correction: Correction) -> Rows:
    """Return the summary of `compensate`."""
    c = correction
    known = c.correction_mm[c.correction_mm == c.correction_mm]  # not NaN
    n_extended = int(c.extended.sum())
    return [
        ("pass", f"{c.pass_number}, gain {c.gain:g}"),
        ("correction", f"{_extreme(float(known.min()))} to {_extreme(float(known.max()))}"),
        ("", "- = take off, + = leave or raise, along the outward normal"),
        ("now", f"{_pv_rms(c.before)} of {c.before.n} points"),
        ("expected after", f"{_pv_rms(c.predicted)} of {c.predicted.n} points"),
        ("", "as far as the map resolves it; noise and repeatability of the machine come on top"),
        ("another pass", c.reason),
        (
            "grid",
            f"{len(c.x_mm)} x {len(c.y_mm)} nodes, {n_extended} of {known.size} continued from neighbours",
        ),
    ]


def details_of_correction(correction: Correction) -> Rows:
    """Return what `compensate` has to say beyond its summary."""
    c = correction
    total = c.total_correction_mm[c.total_correction_mm == c.total_correction_mm]  # not NaN
    low, high = float(total.min()), float(total.max())
    return [
        ("sum of all passes", f"{_extreme(low)} to {_extreme(high)}, relative to the nominal"),
        ("maps before this", str(len(c.applied_maps))),
        ("spacing", f"{_length(float(c.x_mm[1] - c.x_mm[0]))} x {_length(float(c.y_mm[1] - c.y_mm[0]))}"),
        ("highest after", f"{_extreme(c.predicted.max_mm)} at {_place(c.predicted.max_at_mm)}"),
        ("lowest after", f"{_extreme(c.predicted.min_mm)} at {_place(c.predicted.min_at_mm)}"),
    ]


def _rung(rung: LadderRung) -> tuple[str, str]:
    value = f"PV {_um(rung.pv_mm)}, RMS {_um(rung.rms_mm)}"
    if rung.removed == "+ power":
        return "without power", f"{value}   (nor piston and tilt)"
    return f"without {rung.removed}", value


def _side(nominal: Nominal) -> str:
    return "+z" if nominal.side > 0 else "-z"


def _sign(nominal: Nominal) -> str:
    return f"+ = excess material, along the normal on the {_side(nominal)} side"


def _pv_rms(s: Statistics) -> str:
    return f"PV {_um(s.pv_mm)}, RMS {_um(s.rms_mm)}"


def _um(value_mm: float) -> str:
    return f"{_calm(value_mm * UM_PER_MM)} um"


def _extreme(value_mm: float) -> str:
    um = value_mm * UM_PER_MM
    return f"{_signed(um, _decimals(um))} um"


def _calm(value: float) -> str:
    """Return a number with four digits that count, three decimals at most, and no exponent."""
    return f"{value:.{_decimals(value)}f}"


def _decimals(value: float) -> int:
    size = abs(value)
    return 3 if size < 10.0 else 2 if size < 100.0 else 1 if size < 1000.0 else 0


def _two(value: float) -> str:
    """Return a number with two digits that count and no exponent."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    power = math.floor(math.log10(abs(float(f"{value:.1e}"))))
    return f"{round(value, 1 - power):.{max(0, 1 - power)}f}"


def _length(value_mm: float) -> str:
    """Return a length with three digits that count in the unit that suits its size."""
    for unit, per_mm, least in (("m", 1e-3, 1e3), ("mm", 1.0, 1e-2), ("um", UM_PER_MM, 1e-5)):
        if abs(value_mm) >= least:
            value = value_mm * per_mm
            return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f} {unit}"
    return f"{value_mm:g} mm"


def _percent(share: float) -> str:
    """Return a share in whole percent, which says 100 only where nothing is missing to the first decimal."""
    percent = 100.0 * share
    return f"{percent:.1f} %" if 99.0 <= percent < 99.95 else f"{percent:.0f} %"


def _signed(value: float, digits: int = 3) -> str:
    text = f"{abs(value):.{digits}f}"
    return text if float(text) == 0.0 else ("+" if value > 0.0 else "-") + text


def _nm(value_nm: float) -> str:
    return f"{value_nm / UM_PER_MM:.3g} um" if abs(value_nm) >= UM_PER_MM else f"{value_nm:.3g} nm"


def _place(place_mm: tuple[float, float]) -> str:
    return f"({_signed(place_mm[0], 2)}, {_signed(place_mm[1], 2)}) mm"


def _triple(values: Iterable[float], digits: int) -> str:
    return ", ".join(_signed(float(v), digits) for v in values)


def _pose(pose: Pose) -> str:
    turn = pose.rotation_vector_rad()
    angle = math.sqrt(float((turn**2).sum())) * DEG_PER_RAD
    return f"shift ({_triple(pose.translation_mm, 4)}) mm, turned by {angle:.4f} deg"


def _pose_sigma(sigma: Mapping[str, float]) -> str:
    """Return the uncertainties of the motions, each in the unit that suits its size."""
    words = []
    for key, value in sigma.items():
        name, _, unit = key.rpartition("_")
        if not math.isfinite(value):
            words.append(f"{name} unknown")
            continue
        larger = {"um": "mm", "urad": "mrad"}.get(unit)
        if larger is not None and value >= UM_PER_MM:
            value, unit = value / UM_PER_MM, larger  # noqa: PLW2901 - the same value in another unit
        words.append(f"{name} {_two(value)} {unit}")
    return ", ".join(words)
