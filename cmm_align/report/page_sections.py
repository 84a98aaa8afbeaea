"""What the page says beside its map: sections of rows, each with a heading. Words only, no layout."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np

from cmm_align.model import Alignment, DeviationMap, Judgement, PointStatus
from cmm_align.model.low_orders import Kind
from cmm_align.model.removed_motion import words as removed_words
from cmm_align.report.alignment_summary import details_of_alignment, of_alignment, outliers_of
from cmm_align.report.canvas import signed, thin
from cmm_align.report.page_findings import causes, changed
from cmm_align.report.page_section import Row, Section, shown
from cmm_align.report.summary import details_of_map, of_map
from cmm_align.report.wording import as_chance, as_length, as_percent, calm, decimals, two_digits
from cmm_align.units import UM_PER_MM

_TOLD: Final = {"PV", "RMS", "PVr", "mean", "highest", "lowest", "highest point", "lowest point"} | {
    *("profile (ISO 1101)", "coverage", "form", "filter", "grid", "sign", "cause", "causes")
}
"""Rows of the summary that have a place of their own on the page."""


def sections(deviation_map: DeviationMap, probe: str) -> list[Section]:
    """Return the sections of a map in reading order; those with nothing to say are left out.

    Parameters
    ----------
    deviation_map : DeviationMap
    probe : str
        Which ball, on which side of the nominal.
    """
    alignment = deviation_map.alignment
    found = [
        numbers(deviation_map),
        judgements(deviation_map),
        causes(deviation_map),
        changed(deviation_map),
        ladder(deviation_map),
        form(deviation_map),
        coverage(deviation_map),
        outliers(alignment),
        hidden(alignment),
        pose(alignment),
        conventions(deviation_map, probe),
        further(deviation_map),
    ]
    return [section for section in found if section.rows or section.note]


def numbers(m: DeviationMap) -> Section:
    """Return the numbers of the map beside those of the single points."""
    both = (m.statistics, m.point_statistics)

    def row(label: str, *values: str) -> Row:
        return (label, *values)

    def um(name: str) -> tuple[str, ...]:
        return tuple(calm(getattr(s, name) * UM_PER_MM) for s in both)

    def plus(name: str) -> tuple[str, ...]:
        return tuple(_signed(getattr(s, name)) for s in both)

    def at(name: str) -> tuple[str, ...]:
        return tuple(f"({_place(getattr(s, name))})" for s in both)

    rows = [
        row("N", *(count(s.n) for s in both)),
        row("PV, µm", *um("pv_mm")),
        row("RMS, µm", *um("rms_mm")),
        row("u of the RMS, µm", two_digits(m.u_rms_mm * UM_PER_MM), ""),
        row("PVr, µm", calm(m.pvr_mm * UM_PER_MM) if math.isfinite(m.pvr_mm) else "–", ""),
        row("profile (ISO 1101), µm", *um("profile_mm")),
        row("mean, µm", *plus("mean_mm")),
        row("highest, µm", *plus("max_mm")),
        row("at x, y, mm", *at("max_at_mm")),
        row("lowest, µm", *plus("min_mm")),
        row("at x, y, mm", *at("min_at_mm")),
    ]
    filtered = "" if m.filter is None else f"Filter of the map: {m.filter.words}; points are not filtered."
    return Section("Numbers", tuple(rows), ("", "map", "single points"), filtered)


def judgements(m: DeviationMap) -> Section:
    """Return what was judged, against what, with which outcome."""
    if not m.verdict_lines:
        return Section("Tolerances", (), note="No tolerance given, so there is no verdict.")
    if m.conformance is None:
        return Section("Tolerances", (), note="; ".join(shown(line) for line in m.verdict_lines))
    told = {j.sentence for j in m.conformance.judgements}
    others = "".join(f"{shown(line)}. " for line in m.verdict_lines if line not in told)
    rows = tuple(
        (
            f"{'beyond the band' if j.quantity == 'band' else j.quantity}, {shown(j.unit)}",
            _number(j.measured),
            _number(j.value),
            two_digits(j.u),
            _limits(j),
            as_chance(j.probability),
        )
        for j in m.conformance.judgements
    )
    head = ("", "measured", "less noise", "u", "limits", "P within")
    guard = f"guard band of {m.conformance.guard_factor:g} u" if m.conformance.guard_factor else "as measured"
    return Section("Tolerances", rows, head, f"{others}Decided by: {guard}.")


def _limits(j: Judgement) -> str:
    """Return the limits of a judgement."""
    if j.lower is not None and j.upper is not None:
        return f"{j.lower:+g} … {j.upper:+g}".replace("-", "\N{MINUS SIGN}")
    if j.lower is None and j.upper is None:
        return "by point"
    return f"≤ {j.upper:g}" if j.upper is not None else f"≥ {j.lower:g}"


def ladder(m: DeviationMap) -> Section:
    """Return what is left after removing low orders, one after the other."""
    rows = tuple(
        (
            shown(rung.removed),
            calm(rung.pv_mm * UM_PER_MM),
            calm(rung.rms_mm * UM_PER_MM),
            calm(rung.pvr_mm * UM_PER_MM) if math.isfinite(rung.pvr_mm) else "–",
        )
        for rung in m.ladder
    )
    return Section("What is left without …", rows, ("removed", "PV, µm", "RMS, µm", "PVr, µm"))


def form(m: DeviationMap) -> Section:
    """Return what the form error consists of."""
    low = m.low_orders
    if low is None:
        return Section("Form", ())
    rows = tuple(
        (
            kind.name,
            f"{_number(kind.amplitude_um)} ± {two_digits(kind.u_um)}",
            "" if kind.angle_deg is None else _axis(kind),
            calm(kind.rms_um),
            as_percent(kind.share),
        )
        for kind in low.kinds
    )
    return Section(
        "Form",
        rows,
        ("kind", "PV, µm", "axis, °", "RMS, µm", "share"),
        shown(f"{low.words}. {low.basis}, {low.normalisation}; ± is the standard uncertainty."),
    )


def coverage(m: DeviationMap) -> Section:
    """Return how much of the part is known, and by what."""
    r = m.alignment.report
    ny, nx = m.deviation_mm.shape
    whole = r.report_region.removeprefix("the ") or "nominal"
    rows: list[Row] = []
    if math.isfinite(m.coverage):
        rows.append(("known", f"{as_percent(m.coverage)} of the {whole}"))
    rows.append(("grid", f"{count(m.statistics.n)} of {nx} × {ny} nodes, {as_length(m.spacing_mm)} apart"))
    rows += _labelled(row for row in of_alignment(m.alignment) if row[0] in {"points", "weights"})
    if m.filter is not None:
        rows.append(("filter", shown(m.filter.words)))
    return Section("Coverage", tuple(rows))


def outliers(alignment: Alignment) -> Section:
    """Return how many points were left out as outliers, and the worst."""
    found = int(np.count_nonzero(alignment.status == PointStatus.OUTLIER))
    if not found:
        return Section("Outliers", (), note="None.")
    worst = outliers_of(alignment)[0]
    at = ", ".join(signed(float(v), 2) for v in alignment.contact_part_mm[worst])
    told = f"{_signed(float(alignment.deviation_mm[worst]))} µm, point {alignment.ids[worst]} at ({at}) mm"
    return Section(
        "Outliers",
        (("left out", count(found)), ("worst", told)),
        note="Not in the map nor in its numbers; where they would break a tolerance the verdict is open.",
    )


def hidden(alignment: Alignment) -> Section:
    """Return what the best fit took away, held, or could not tell."""
    r = alignment.report
    rows: list[Row] = []
    if r.removed is not None:
        for line in removed_words(r.removed):
            first, _, rest = line.partition(" ")
            rows.append((first, shown(rest)) if r.removed.applies else (shown(line),))
    rows += [("cannot be told", shown(text)) for text in r.unobservable]
    wanted = {"locked", "weakly known", "criterion", "datum terms", "scale"}
    rows += _labelled(row for row in of_alignment(alignment) if row[0] in wanted)
    return Section("What the best fit hid", tuple(rows))


def pose(alignment: Alignment) -> Section:
    """Return where the part lay in the machine."""
    wanted = {"part_from_machine", "pose known to", "uncertainty (k=1)", "stopped", "two paths differ by"}
    told: dict[str, str] = {}
    for label, words in (*of_alignment(alignment), *details_of_alignment(alignment)):
        if label in wanted:
            told.setdefault(label, shown(words))
    rows: list[Row] = list(told.items())
    matrix = alignment.part_from_machine.matrix()
    for label, line in zip(("matrix", "", ""), matrix[:3], strict=True):
        rows.append((label, "  ".join(signed(float(v), 6) for v in line)))
    return Section("Pose", tuple(rows))


def conventions(m: DeviationMap, probe: str) -> Section:
    """Return what signs, frames and symbols mean."""
    n = m.alignment.nominal
    side = "+z" if n.side > 0 else "\N{MINUS SIGN}z"
    b = n.surface.bounds
    return Section(
        "Conventions",
        (
            ("sign", f"+ = excess material, along the outward normal on the {side} side"),
            ("frame", "x, y of the map: frame surface, the part seen along its projection direction"),
            ("u", "standard uncertainty, k = 1"),
            ("nominal", f"{n.kind}, {b.x_max - b.x_min:.2f} × {b.y_max - b.y_min:.2f} mm"),
            ("its digest", n.digest[:16]),
            ("probe", shown(probe)),
        ),
    )


def further(m: DeviationMap) -> Section:
    """Return what the summary on the screen says and no section before does."""
    rungs = {f"without {rung.removed.removeprefix('+ ')}" for rung in m.ladder}
    rungs |= {f"without {rung.removed}" for rung in m.ladder}
    rows: list[Row] = []
    last = ""
    for label, words in (*of_map(m), *details_of_map(m)):
        last = label or last
        if last not in _TOLD and last not in rungs:
            rows.append((label, shown(words)))
    return Section("More numbers, and how they were made", tuple(rows))


def headline_um(m: DeviationMap) -> list[tuple[str, float, str]]:
    """Return the three numbers of the head: label, value in um, and what stands beside it."""
    s, p = m.statistics, m.point_statistics
    points = f"single points {calm(p.pv_mm * UM_PER_MM)}, N = {count(p.n)}"
    u = two_digits(m.u_rms_mm * UM_PER_MM)
    pvr = ("PVr", m.pvr_mm * UM_PER_MM, "36 terms + 3 RMS of the rest")
    profile = ("profile", s.profile_mm * UM_PER_MM, "2 max |deviation|, ISO 1101")
    return [
        ("PV", s.pv_mm * UM_PER_MM, f"N = {count(s.n)} nodes; {points}"),
        ("RMS", s.rms_mm * UM_PER_MM, f"u = {u}; single points {calm(p.rms_mm * UM_PER_MM)}"),
        pvr if math.isfinite(m.pvr_mm) else profile,
    ]


def headline(m: DeviationMap) -> list[tuple[str, str, str]]:
    """Return the same with the values as text."""
    return [(label, calm(value), beside) for label, value, beside in headline_um(m)]


def count(number: int) -> str:
    """Return a whole number whose thousands stay together."""
    return thin(number).replace("\N{THIN SPACE}", "\N{NARROW NO-BREAK SPACE}")


def _labelled(rows: Iterable[tuple[str, str]]) -> list[Row]:
    return [(label, shown(words)) for label, words in rows]


def _signed(value_mm: float) -> str:
    um = value_mm * UM_PER_MM
    return signed(um, decimals(um))


def _number(value: float) -> str:
    """Return a number with three digits that count and a true minus, if it is below zero."""
    return ("\N{MINUS SIGN}" if value < 0.0 else "") + calm(abs(value))


def _axis(kind: Kind) -> str:
    """Return the direction of a kind with its uncertainty, degrees; nothing where it has none."""
    if kind.angle_deg is None or kind.u_angle_deg is None:
        return ""
    return f"{kind.angle_deg:.1f} ± {max(kind.u_angle_deg, 0.1):.1f}"


def _place(at_mm: tuple[float, float]) -> str:
    return f"{signed(at_mm[0], 2)}, {signed(at_mm[1], 2)}"
