"""The rows of the one-screen summary of each stage: (label, value with unit), most telling first.

Pure text: the command line decides on layout and colour.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from cmm_align.model import Alignment, Correction, DeviationMap, Nominal, Statistics, Verdict
from cmm_align.pose import Pose
from cmm_align.units import DEG_PER_RAD, UM_PER_MM

Rows = list[tuple[str, str]]

_MINUS = "\N{MINUS SIGN}"
_VERDICT = {
    Verdict.PASS: "PASS",
    Verdict.FAIL: "FAIL",
    Verdict.UNDECIDED: "UNDECIDED (inside the guard band)",
    Verdict.NONE: "none: no tolerance given",
}


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
    rows.append(("points", f"{q.n_points}, spacing {dx:.4g} x {dy:.4g} mm"))
    rows.append(("steepest slope", f"{q.max_slope_deg:.2f} deg"))
    if q.min_concave_radius_mm is None:
        rows.append(("tightest bowl", "none: nowhere concave towards the probe"))
    else:
        at = "" if q.min_concave_at_mm is None else f" at {_place(q.min_concave_at_mm)}"
        rows.append(("tightest bowl", f"radius {q.min_concave_radius_mm:.4g} mm{at}"))
    rows.append(
        (
            "equidistant",
            "regular everywhere" if q.regular else "NOT regular: the ball does not fit everywhere",
        )
    )
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
    e = alignment.deviation_mm[used] * UM_PER_MM
    rows = [
        ("points", f"{int(used.sum())} of {len(used)} used; {r.n_outside} outside, {r.n_outliers} outliers"),
        ("RMS", f"{math.sqrt(float((e**2).mean())):.3f} um"),
        (
            "PV",
            f"{float(e.max() - e.min()):.3f} um  ({_signed(float(e.min()))} to {_signed(float(e.max()))})",
        ),
        ("part_from_machine", _pose(alignment.part_from_machine)),
        ("uncertainty (k=1)", _pose_sigma(r.pose_sigma)),
        ("stopped", f"after {r.iterations} iterations: {r.stop_reason}"),
        ("two paths differ by", _nm(r.two_path_difference_nm)),
    ]
    if r.unobservable:
        rows.append(("not observable", ", ".join(r.unobservable) + "; held at the start value"))
    return rows


def of_map(deviation_map: DeviationMap) -> Rows:
    """Return the summary of `error-map`."""
    m, s = deviation_map, deviation_map.statistics
    ny, nx = m.deviation_mm.shape
    p = m.point_statistics
    rows = [
        ("verdict", _VERDICT[m.verdict]),
        ("PV", _um(s.pv_mm)),
        ("RMS", f"{_um(s.rms_mm)}, u = {m.u_rms_mm * UM_PER_MM:.3f} um"),
        ("N", f"{s.n} of {nx} x {ny} nodes, {m.spacing_mm:.4g} mm apart"),
        ("highest", f"{_extreme(s.max_mm)} at {_place(s.max_at_mm)}"),
        ("lowest", f"{_extreme(s.min_mm)} at {_place(s.min_at_mm)}"),
        ("mean", _extreme(s.mean_mm)),
        ("profile (ISO 1101)", _um(s.profile_mm)),
        ("PVr", _um(m.pvr_mm)),
        ("single points", f"N {p.n}, PV {_um(p.pv_mm)}, RMS {_um(p.rms_mm)}"),
    ]
    rows += [
        (f"without {rung.removed}", f"PV {_um(rung.pv_mm)}, RMS {_um(rung.rms_mm)}") for rung in m.ladder[1:]
    ]
    rows.append(("sign", _sign(m.alignment.nominal)))
    return rows


def of_correction(correction: Correction) -> Rows:
    """Return the summary of `compensate`."""
    c = correction
    known = c.correction_mm[c.correction_mm == c.correction_mm]  # not NaN
    n_extended = int(c.extended.sum())
    return [
        ("pass", f"{c.pass_number}, gain {c.gain:g}"),
        (
            "correction",
            f"{_signed(float(known.min()) * UM_PER_MM)} to {_signed(float(known.max()) * UM_PER_MM)} um",
        ),
        ("now", _pv_rms(c.before)),
        ("expected after", _pv_rms(c.predicted)),
        ("another pass", c.reason),
        (
            "grid",
            f"{len(c.x_mm)} x {len(c.y_mm)} nodes, {n_extended} of {known.size} continued from neighbours",
        ),
        ("sign", f"{_MINUS} = take material off; {_sign(c.nominal)}"),
    ]


def _side(nominal: Nominal) -> str:
    return "+z" if nominal.side > 0 else "-z"


def _sign(nominal: Nominal) -> str:
    return f"deviation + = excess material, along the normal on the {_side(nominal)} side"


def _pv_rms(s: Statistics) -> str:
    return f"PV {_um(s.pv_mm)}, RMS {_um(s.rms_mm)} (N {s.n} points)"


def _um(value_mm: float) -> str:
    return f"{value_mm * UM_PER_MM:.3f} um"


def _extreme(value_mm: float) -> str:
    return f"{_signed(value_mm * UM_PER_MM)} um"


def _signed(value: float, digits: int = 3) -> str:
    text = f"{abs(value):.{digits}f}"
    return text if float(text) == 0.0 else ("+" if value > 0.0 else _MINUS) + text


def _nm(value_nm: float) -> str:
    return f"{value_nm / UM_PER_MM:.3g} um" if abs(value_nm) >= UM_PER_MM else f"{value_nm:.3g} nm"


def _place(place_mm: tuple[float, float]) -> str:
    return f"({_signed(place_mm[0], 2)}, {_signed(place_mm[1], 2)}) mm"


def _pose(pose: Pose) -> str:
    shift = ", ".join(_signed(float(v), 4) for v in pose.translation_mm)
    turn = ", ".join(_signed(float(v) * DEG_PER_RAD, 4) for v in pose.rotation_vector_rad())
    return f"shift ({shift}) mm, rotation vector ({turn}) deg"


def _pose_sigma(sigma: Mapping[str, float]) -> str:
    return ", ".join(
        f"{key.rpartition('_')[0]} {value:.2g} {key.rpartition('_')[2]}" for key, value in sigma.items()
    )
