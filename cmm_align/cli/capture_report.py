"""A capture as a report, as JSON and as an exit code."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from cmm_align.errors import MalformedInputError

if TYPE_CHECKING:
    from cmm_align.device.capture import Captured

EXIT_DEVICE: Final = 7
EXIT_INTERRUPTED: Final = 130
MOST_LISTED: Final = 10


def refuse_rejected(captured: Captured) -> None:
    """Refuse a capture with rejected lines.

    Raises
    ------
    MalformedInputError
        At the first one.
    """
    if captured.rejected:
        first = captured.rejected[0]
        raise MalformedInputError(
            f"{count(len(captured.rejected), 'line')} should be points and are none; "
            f"the first is {first.text!r}: {first.why}",
            where=f"{captured.raw_log}:{first.line}:{first.column}",
            remedy="correct the profile or the dump; without --strict they are left out",
        )


def exit_code_of(captured: Captured, *, live: bool) -> int:
    """Return 0 for a complete capture, 130 for a live one that Ctrl-C ended, else 7."""
    if captured.complete:
        return 0
    return EXIT_INTERRUPTED if live and captured.end_reason == "interrupted" else EXIT_DEVICE


def warnings_of(captured: Captured) -> list[str]:
    """Return what to tell about a capture: what is missing, and the first lines that were left out."""
    found = [f"not complete: {text}" for text in captured.shortfalls]
    found += [
        f"{reader} had the port open too: two readers take bytes from each other"
        for reader in captured.other_readers
    ]
    found += captured.suspicions
    if captured.rejected:
        number = len(captured.rejected)
        more = f"; the first {MOST_LISTED} of them:" if number > MOST_LISTED else ":"
        found.append(f"{count(number, 'line')} should be points and are none, and were left out{more}")
        found += [
            f"{captured.raw_log}:{line.line}:{line.column}: {line.text!r}: {line.why}"
            for line in captured.rejected[:MOST_LISTED]
        ]
    return found


def result_of(captured: Captured, expect: int | None) -> dict[str, Any]:
    """Return the result of `capture`."""
    errors = captured.line_errors
    return {
        "n_points": len(captured.points),
        "n_bytes": captured.n_bytes,
        "n_rejected": len(captured.rejected),
        "complete": captured.complete,
        "end_reason": captured.end_reason.value,
        "raw_log": None if captured.raw_log is None else str(captured.raw_log),
        "n_expected": expect,
        "shortfalls": list(captured.shortfalls),
        "suspicions": list(captured.suspicions),
        "rejected": [line._asdict() for line in captured.rejected[:MOST_LISTED]],
        "n_notes": len(captured.notes),
        "line_errors": None if errors is None else errors._asdict(),
        "kind": captured.points.kind.value,
        "dialect": captured.profile.dialect,
        "profile": captured.profile.name,
    }


def rows_of(captured: Captured, url: str) -> list[tuple[str, str]]:
    """Return the rows of the report."""
    from cmm_align.model import PointKind

    radius_mm = captured.profile.tip_radius_mm
    kind = {
        PointKind.TIP_CENTRE: "tip centres",
        PointKind.CONTACT: "contact points",
    }.get(captured.points.kind, "nothing says whether tip centres or contact points")
    errors = captured.line_errors
    counted = "nobody counts" if errors is None else ("some" if errors.happened() else "none")
    ended = captured.end_reason.replace("_", " ")
    return [
        ("port", url),
        ("points", f"{len(captured.points)} ({kind}{f', radius {radius_mm:g} mm' if radius_mm else ''})"),
        ("rejected", count(len(captured.rejected), "line")),
        ("bytes", f"{captured.n_bytes}; line errors: {counted}"),
        ("ended", f"{ended}; {'complete' if captured.complete else 'NOT COMPLETE'}"),
        ("raw log", str(captured.raw_log)),
    ]


def count(number: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
