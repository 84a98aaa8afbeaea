"""The rows of the one-screen summary of each stage: (label, value with unit), most telling first.

Pure text: the command line decides on layout and colour.
"""

from __future__ import annotations

import math

from cmm_align.model import (
    Correction,
    DeviationMap,
    LadderRung,
    Nominal,
    RootCauses,
    Statistics,
    Verdict,
)
from cmm_align.report.gate_rows import gate_details, gate_rows, seat_rows
from cmm_align.report.number_rows import of_numbers
from cmm_align.report.wording import as_length, as_percent, at_place, extreme, in_nm, in_um
from cmm_align.units import MRAD_PER_RAD, UM_PER_MM

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
    rows.append(("points", f"{q.n_points}, spacing {as_length(dx)} x {as_length(dy)}"))
    rows.append(("steepest slope", f"{q.max_slope_deg:.2f} deg"))
    if q.min_concave_radius_mm is None:
        rows.append(("tightest bowl", "none: nowhere concave towards the probe"))
    else:
        at = "" if q.min_concave_at_mm is None else f" at {at_place(q.min_concave_at_mm)}"
        rows.append(("tightest bowl", f"radius {as_length(q.min_concave_radius_mm)}{at}"))
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
            f"{in_nm(q.surface_error_pv_nm)} PV ({how}); flat facets {in_nm(q.facet_error_pv_nm)} PV",
        )
    )
    return rows


def verdict_of(deviation_map: DeviationMap) -> tuple[str, tuple[str, ...]]:
    """Return the verdict in one word and a sentence for each tolerance; two empties without a tolerance."""
    m = deviation_map
    if m.verdict == Verdict.NONE:
        return "", ()
    inside = m.verdict == Verdict.UNDECIDED and (m.conformance is None or not m.conformance.kept)
    extra = ("inside the guard band: neither within nor out",) if inside else ()
    return m.verdict.value.upper(), (*m.verdict_lines, *extra)


def keeps(line: str) -> bool:
    """Return whether a sentence of a verdict says that its tolerance is kept."""
    return line.endswith(f": {Verdict.PASS.value}")


def verdict_in_one_line(deviation_map: DeviationMap, most_letters: int) -> str:
    """Return the sentences of a verdict, what decided it first, as far as there is room."""
    lines = sorted(deviation_map.verdict_lines, key=keeps)
    text = lines[0] if lines else ""
    for told, line in enumerate(lines[1:], start=1):
        if len(text) + len(line) + len("; ; 9 more") > most_letters:
            text += f"; {len(lines) - told} more"
            break
        text += f"; {line}"
    return text if len(text) <= most_letters else text[: most_letters - 1] + "\N{HORIZONTAL ELLIPSIS}"


def of_map(deviation_map: DeviationMap) -> Rows:
    """Return the summary of `error-map`, without its verdict."""
    m, s = deviation_map, deviation_map.statistics
    ny, nx = m.deviation_mm.shape
    p = m.point_statistics
    rows = [
        ("PV", f"{in_um(s.pv_mm)}   (single points {in_um(p.pv_mm)})"),
        ("RMS", f"{in_um(s.rms_mm)}   (single points {in_um(p.rms_mm)}; u {in_um(m.u_rms_mm)})"),
        ("PVr", f"{in_um(m.pvr_mm)}   (36 terms and three times the RMS of the rest)"),
        ("highest", f"{extreme(s.max_mm)} at {at_place(s.max_at_mm)}"),
        ("lowest", f"{extreme(s.min_mm)} at {at_place(s.min_at_mm)}"),
    ]
    rows += [_rung(rung) for rung in m.ladder if rung.removed == "+ power"]
    if math.isfinite(m.coverage):
        whole = m.alignment.report.report_region.removeprefix("the ") or "nominal"
        rows.append(("coverage", f"{as_percent(m.coverage)} of the {whole}, by {p.n} points"))
    if m.low_orders is not None:
        rows.append(("form", m.low_orders.words))
    if m.root_causes is not None:
        rows += [("cause", cause.words) for cause in m.root_causes.relevant]
    if m.filter is not None:
        rows.append(("filter", f"{m.filter.words}; single points are not filtered"))
    rows.append(("grid", f"{s.n} of {nx} x {ny} nodes, {as_length(m.spacing_mm)} apart"))
    rows.append(("sign", _sign(m.alignment.nominal)))
    return rows


def details_of_map(deviation_map: DeviationMap) -> Rows:
    """Return what `error-map` has to say beyond its summary."""
    m, s, p = deviation_map, deviation_map.statistics, deviation_map.point_statistics
    return [
        *(of_numbers(m.numbers) if m.numbers is not None else _few_numbers(s)),
        ("highest point", f"{extreme(p.max_mm)} at {at_place(p.max_at_mm)}"),
        ("lowest point", f"{extreme(p.min_mm)} at {at_place(p.min_at_mm)}"),
        *(_rung(rung) for rung in m.ladder[1:] if rung.removed != "+ power"),
        *_ways_of_map(m),
        *_causes(m.root_causes),
    ]


def _few_numbers(s: Statistics) -> Rows:
    """Return the numbers of a map that an older version wrote."""
    return [("mean", extreme(s.mean_mm)), ("profile (ISO 1101)", in_um(s.profile_mm))]


def _ways_of_map(m: DeviationMap) -> Rows:
    """Return how the map came of the points, of which, and what its uncertainty holds."""
    report = m.alignment.report
    rows = []
    if report.fit_region or report.report_region:
        whole = "the whole nominal"
        fit, told = report.fit_region or whole, report.report_region or whole
        rows.append(("regions", f"numbers and map of {told}; the pose was fitted on {fit}"))
    if m.method:
        rows.append(("method", m.method))
    holds = "scatter of the points, noise that nodes keep, and the pose"
    if report.monte_carlo is None:
        more = "nothing that neighbouring points have in common: align --monte-carlo adds it"
    else:
        more = "and what the machine's simulated errors have in common"
    rows.append(("u of the RMS", f"{holds}; {more}"))
    return rows


def _causes(found: RootCauses | None) -> Rows:
    """Return every cause with its numbers, and what was looked for."""
    if found is None:
        return []
    if not found.causes:
        return [("causes", found.words)]
    rows = []
    for cause in found.causes:
        angle = "" if cause.angle_deg is None else f", lobe at {cause.angle_deg:.0f} deg"
        shown = cause.words if cause not in found.relevant else cause.name
        rows.append(("cause", f"{shown}{angle}; RMS without it {cause.rms_without_um:.3g} um; {cause.sign}"))
        for m in cause.alternatives:
            value = f"{m.value:+.3g} {m.unit} (u {m.u:.2g})"
            less = f"{m.times_less_likely:.3g} times less likely"
            rows.append(("", f"or {m.name} {value}, {less}; {m.sign}"))
    rows.append(("without causes", f"RMS {found.rms_without_um:.3g} um of {found.rms_um:.3g} um"))
    if found.hidden:
        rows.append(("hidden", f"{', '.join(found.hidden)}: a rigid motion takes them away on this part"))
    return rows


def of_correction(correction: Correction) -> Rows:
    """Return the summary of `compensate`."""
    c = correction
    known = c.correction_mm[c.correction_mm == c.correction_mm]  # not NaN
    n_extended = int(c.extended.sum())
    return [
        ("pass", f"{c.pass_number}, {gain_words(c)}"),
        *([("band", c.band.words)] if c.band is not None else []),
        ("correction", f"{extreme(float(known.min()))} to {extreme(float(known.max()))}"),
        ("", "- = take off, + = leave or raise, along the outward normal"),
        ("now", f"{_pv_rms(c.before)} of {c.before.n} points"),
        ("expected after", f"{_pv_rms(c.predicted)} of {c.predicted.n} points"),
        *_expected(c),
        ("another pass", c.reason),
        *([("pass before", c.response.words)] if c.response is not None else []),
        (
            "grid",
            f"{len(c.x_mm)} x {len(c.y_mm)} nodes, {n_extended} of {known.size} continued from neighbours",
        ),
        *_left_out(c),
        *seat_rows(c.seat),
        *gate_rows(c.gate),
    ]


def gain_words(correction: Correction) -> str:
    """Return the gain as it is said."""
    if correction.gain_rule == "wiener":
        return f"gain by wavelength (Wiener), {correction.gain:.2f} on average"
    return f"gain {correction.gain:g}"


def _expected(c: Correction) -> Rows:
    """Return the interval of the prediction and what it takes for granted."""
    p = c.prediction
    if p is None:
        return []
    shares = sorted({round(share, 2) for share in p.transfer.share})
    share = f"a transfer of {' to '.join(f'{one:g}' for one in (shares[0], *shares[1:][-1:]))}"
    known = "" if p.transfer.known else " (not known)"
    return [
        (
            "",
            f"95 %: RMS {_um(p.rms_low_mm)} to {_um(p.rms_high_mm)}, PV {_um(p.pv_low_mm)} to "
            f"{_um(p.pv_high_mm)}",
        ),
        ("", f"with {share} +- {p.transfer.u:.2g}{known}, {_um(p.repeatability_mm)} from pass to pass"),
    ]


def _left_out(c: Correction) -> Rows:
    """Return the nodes that are not as the map says, by reason."""
    limits = c.limits
    if limits is None:
        return []
    counts = {
        "beyond the data": limits.n_beyond,
        "in holes": limits.n_bridged,
        "with too few points": limits.n_few_points,
        "clipped to the range of the data": limits.n_clipped,
        "outside the region": limits.n_outside_region,
    }
    words = ", ".join(f"{n} {where}" for where, n in counts.items() if n)
    return [("not as the map", words)] if words else []


def details_of_correction(correction: Correction) -> Rows:
    """Return what `compensate` has to say beyond its summary."""
    c = correction
    total = c.total_correction_mm[c.total_correction_mm == c.total_correction_mm]  # not NaN
    low, high = float(total.min()), float(total.max())
    return [
        ("sum of all passes", f"{extreme(low)} to {extreme(high)}, relative to the nominal"),
        *_sizes(c),
        *gate_details(c.gate),
        ("maps before this", str(len(c.applied_maps))),
        ("spacing", f"{as_length(float(c.x_mm[1] - c.x_mm[0]))} x {as_length(float(c.y_mm[1] - c.y_mm[0]))}"),
        ("highest after", f"{extreme(c.predicted.max_mm)} at {at_place(c.predicted.max_at_mm)}"),
        ("lowest after", f"{extreme(c.predicted.min_mm)} at {at_place(c.predicted.min_at_mm)}"),
    ]


def _um(value_mm: float) -> str:
    """Return a length of no great precision in um."""
    return f"{value_mm * UM_PER_MM:.3g} um"


def _sizes(c: Correction) -> Rows:
    """Return slope, depth and fading of a correction."""
    limits = c.limits
    if limits is None:
        return []
    return [
        (
            "steepest",
            f"{limits.max_slope_rad * MRAD_PER_RAD:.2g} mrad at {at_place(limits.max_slope_at_mm)}",
        ),
        ("takes off", f"{_um(limits.removal_mm)} this pass, {_um(limits.total_removal_mm)} in all"),
        ("fades out over", as_length(limits.taper_mm)),
    ]


def _rung(rung: LadderRung) -> tuple[str, str]:
    value = f"PV {in_um(rung.pv_mm)}, RMS {in_um(rung.rms_mm)}"
    if rung.removed == "+ power":
        return "without power", f"{value}   (nor the rigid motion)"
    return f"without {rung.removed}", value


def _side(nominal: Nominal) -> str:
    return "+z" if nominal.side > 0 else "-z"


def _sign(nominal: Nominal) -> str:
    return f"+ = excess material, along the normal on the {_side(nominal)} side"


def _pv_rms(s: Statistics) -> str:
    return f"PV {in_um(s.pv_mm)}, RMS {in_um(s.rms_mm)}"
