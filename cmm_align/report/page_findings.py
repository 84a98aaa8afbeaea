"""Sections of the page for what not every map has: a comparison with an earlier measurement."""

from __future__ import annotations

from cmm_align.model import Change, DeviationMap
from cmm_align.report.page_section import Section, shown
from cmm_align.report.wording import as_percent, calm


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
    told = "; ".join((*change.words, f"now nearer to the nominal on {as_percent(change.share_better)}"))
    return Section(
        f"What changed since {change.earlier}",
        tuple(rows),
        ("after less before, without", "PV, µm", "RMS, µm", "of noise", ""),
        shown(told),
    )
