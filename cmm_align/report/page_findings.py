"""Sections of the page for what not every map has: a comparison with an earlier measurement."""

from __future__ import annotations

from cmm_align.model import Change, DeviationMap
from cmm_align.report.page_section import Section, shown
from cmm_align.report.wording import as_percent, calm, two_digits


def changed(m: DeviationMap) -> Section:
    """Return what changed since an earlier measurement, and whether noise explains it."""
    if m.comparison is None:
        return Section("What changed", ())
    change: Change = m.comparison.change
    rows = [
        (
            shown(rung.removed),
            calm(rung.pv_um),
            calm(rung.rms_um),
            calm(rung.expected_rms_um),
            "noise" if rung.noise else "real",
        )
        for rung in change.rungs
    ]
    rows += [
        (
            band.name,
            "",
            calm(band.rms_um),
            calm(band.expected_rms_um),
            "real" if band.significant else "noise",
        )
        for band in change.bands
    ]
    told = (
        *change.words,
        f"Changed: {as_percent(change.share_changed)} of the area, better {as_percent(change.share_better)}, "
        f"worse {as_percent(change.share_worse)}; RMS {change.rms_change_um:+.3f} um "
        f"(u {two_digits(change.u_rms_change_um)})",
    )
    return Section(
        f"What changed since {change.earlier}",
        tuple(rows),
        ("after - before, without", "PV, µm", "RMS, µm", "of noise", ""),
        ". ".join(shown(text).rstrip(".") for text in told) + ".",
    )
