"""Sections of the page for what not every map has: root causes, a comparison with an earlier measurement."""

from __future__ import annotations

from cmm_align.model import Change, DeviationMap
from cmm_align.report.page_section import Section, shown
from cmm_align.report.wording import as_percent, calm, two_digits


def causes(m: DeviationMap) -> Section:
    """Return the settings and effects that would explain the deviations."""
    found = m.root_causes
    if found is None:
        return Section("Root causes", ())
    rows = [
        (
            cause.name,
            f"{minus(calm(cause.value))} ± {two_digits(cause.u)} {shown(cause.unit)}",
            as_percent(cause.share),
            calm(cause.rms_without_um),
        )
        for cause in found.causes
    ]
    told = [shown(found.words)]
    if found.hidden:
        told.append(f"the data say nothing about {', '.join(found.hidden)}")
    return Section(
        "Root causes",
        tuple(rows),
        ("cause", "value", "share", "RMS without, µm") if rows else (),
        f"{'; '.join(told)}.",
    )


def minus(number: str) -> str:
    """Return a number with a true minus."""
    return number.replace("-", "\N{MINUS SIGN}")


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
