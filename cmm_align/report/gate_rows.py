"""What the gate found, as rows: one line for the screen, every check with its number on request."""

from __future__ import annotations

from typing import Final

from cmm_align.model import GateCheck, GatedExport, GateReport, Seat
from cmm_align.units import UM_PER_MM

Rows = list[tuple[str, str]]

_NUMBERED: Final = {"rounding": ".2g", "normals": ".2g"}
"""Checks whose number stands in the line; the format of it."""


def gate_rows(gate: GateReport | None) -> Rows:
    """Return the line of the gate, and what was measured again; none where it was not there yet."""
    if gate is None:
        return []
    if gate.skipped:
        return [("GATE", "SKIPPED (--no-gate): sign, frame and rounding of the exports are unchecked")]
    passed = all(one.passed for one in gate.exports)
    rows = [("gate", f"{'passed' if passed else 'FAILED'} ({', '.join(_worst_of(gate))})")]
    if gate.exports and gate.exports[0].rms_mm is not None and gate.exports[0].pv_mm is not None:
        rows.append(("", _again(gate.exports[0], gate.exports[0].rms_mm, gate.exports[0].pv_mm)))
    harmless = [
        check.words
        for one in gate.exports
        for check in one.checks
        if check.passed and "harmless" in check.words
    ]
    return [*rows, *(("", words) for words in harmless)]


def gate_details(gate: GateReport | None) -> Rows:
    """Return every check of every file as a sentence."""
    if gate is None:
        return []
    rows: Rows = []
    for one in gate.exports:
        rows.append(("gate in full", f"{one.kind}, {one.n} points read back"))
        rows += [("", f"{check.name}: {check.words}") for check in one.checks]
    return rows


def _again(one: GatedExport, rms_mm: float, pv_mm: float) -> str:
    return (
        f"read back and measured again on paper: RMS {one.rms_before_mm * UM_PER_MM:.2f} -> "
        f"{rms_mm * UM_PER_MM:.2f} um, PV {one.pv_before_mm * UM_PER_MM:.1f} -> {pv_mm * UM_PER_MM:.1f} um, "
        "if the machine does as it is told"
    )


def _worst_of(gate: GateReport) -> list[str]:
    """Return the names of all checks in their order, with the largest number of any file."""
    largest: dict[str, GateCheck] = {}
    for check in (check for one in gate.exports for check in one.checks):
        there = largest.get(check.name)
        if there is None or (check.value or 0.0) > (there.value or 0.0):
            largest[check.name] = check
    return [
        f"{name} {check.value:{_NUMBERED[name]}} {check.unit}"
        if name in _NUMBERED and check.value is not None
        else name
        for name, check in largest.items()
    ]


def seat_rows(seat: Seat | None) -> Rows:
    """Return where the part sits on the grinder, and how well that is known."""
    if seat is None:
        return []
    x, y, z = (row[3] for row in seat.grinder_from_part[:3])
    known = "not known: touch more places"
    if seat.u_edge_mm is not None:
        u, v = seat.u_edge_at_mm
        known = f"known to {seat.u_edge_mm * UM_PER_MM:.2g} um (95 %) at the edge, at ({u:+.1f}, {v:+.1f}) mm"
    rows = [
        (
            "on the grinder",
            f"{seat.n} touches, RMS {seat.rms_mm * UM_PER_MM:.2g} um without the form error; the exports "
            "are in the frame of the grinder",
        ),
        ("", f"origin of the part at ({x:.4f}, {y:.4f}, {z:.4f}) mm; the path is {known}"),
    ]
    if seat.held:
        rows.append(("", f"held as the axes of the grinder are: {', '.join(seat.held)}"))
    return rows
