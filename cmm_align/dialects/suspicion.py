"""What a raw dump looks like that is not as the profile says: parity, baud rate, dialect, lost bytes."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from itertools import islice
from typing import Final

from cmm_align.dialects.decoding import decoded
from cmm_align.dialects.events import Hit, Note
from cmm_align.dialects.profile import TERMINATORS, MachineProfile

_SAMPLE: Final = 65_536
_TEXT: Final = bytes([9, 10, 13, *range(32, 127)])
_SEVEN_BITS: Final = bytes(byte & 0x7F for byte in range(256))
_NEARLY_ALL: Final = 0.95
_GARBAGE: Final = 0.3
_HALF: Final = 0.5
_LARGE_COUNT: Final = 1000.0
_COORDINATE: Final = re.compile(rb"[+-]?\d+(?:\.(\d+))?")

CANDIDATES: Final = tuple(
    MachineProfile(dialect=dialect, columns=columns, decimal=decimal, hit_code="", worst_quality=100.0)
    for dialect, columns, decimal in (
        ("ipp", "", "."),
        ("ipp", "q,x,y,z", "."),
        ("gmserver", "", "."),
        ("xyz_letters", "x,y,z", "."),
        ("xyz_letters", "x,y,z,w", "."),
        ("xyz", "x,y,z", "."),
        ("xyz", "x,y,z", ","),
        ("xyz", "x,y,z,i,j,k", "."),
        ("xyz", "x,y,z,i,j,k", ","),
        ("xyz", "id,x,y,z,i,j,k", "."),
        ("xyz", "id,x,y,z", "."),
        ("xyz", "id,x,y,z", ","),
        ("xyz", "x,y,z,w", "."),
    )
)
"""What a dump is tried as; the first of those that fit equally well is named."""


def suspicions(raw: bytes, profile: MachineProfile) -> tuple[str, ...]:
    """Return what an operator should look at, most likely cause first; nothing if all looks well.

    Parameters
    ----------
    raw : bytes
        A dump as it came, or its beginning.
    profile : MachineProfile
        What it should be.
    """
    if not raw:
        return ()
    for look in (parity_suspicion, baud_suspicion):
        hint = look(raw, profile)
        if hint:
            return (hint,)
    hints = (
        look(raw, profile)
        for look in (terminator_suspicion, dialect_suspicion, counts_suspicion, decimals_suspicion)
    )
    return tuple(hint for hint in hints if hint)


def parity_suspicion(raw: bytes, profile: MachineProfile) -> str:
    """Return a hint if bytes have bit 7 set and are text without it; the parity is named if it is plain."""
    high = len(raw.translate(None, bytes(range(128))))
    if not high or len(raw.translate(_SEVEN_BITS).translate(None, _TEXT)) > (1.0 - _NEARLY_ALL) * len(raw):
        return ""
    odd = sum(byte.bit_count() & 1 for byte in raw[:_SAMPLE]) / len(raw[:_SAMPLE])
    parity = "E" if odd < 1.0 - _NEARLY_ALL else "O" if odd > _NEARLY_ALL else ""
    setting = (
        f'set bytesize = 7, parity = "{parity}"' if parity else 'try bytesize = 7 with parity = "E" or "O"'
    )
    return (
        f"{high} of {len(raw)} bytes have bit 7 set and are text without it: wrong parity? {setting} "
        f"(now {profile.bytesize}{profile.parity})"
    )


def baud_suspicion(raw: bytes, profile: MachineProfile) -> str:
    """Return a hint if much of a dump is no text, whatever bit 7 says."""
    garbage = len(raw.translate(None, _TEXT))
    if garbage <= _GARBAGE * len(raw):
        return ""
    return f"{garbage} of {len(raw)} bytes are no text: wrong baud rate? (now {profile.baud})"


def terminator_suspicion(raw: bytes, profile: MachineProfile) -> str:
    """Return a hint if the lines of a dump end in another way than stated, or not at all."""
    if profile.terminator == "any" or profile.terminator.encode("ascii") in raw:
        return ""
    stated = next(word for word, mark in TERMINATORS.items() if mark == profile.terminator)
    pairs = raw.count(b"\r\n")
    found = {"CRLF": pairs, "CR": raw.count(b"\r") - pairs, "LF": raw.count(b"\n") - pairs}
    word, count = max(found.items(), key=lambda item: item[1])
    if not count:
        return f"no line end in {len(raw)} bytes"
    return f'no {stated} but {count} {word} in it: set terminator = "{word}"'


def dialect_suspicion(raw: bytes, profile: MachineProfile) -> str:
    """Return a hint if few lines are points of the dialect stated and more are points of another."""
    points, share = _fit(raw, profile)
    if points and share >= _HALF:
        return ""
    best, count, best_share = best_fit(raw)
    if best is None or best_share < _HALF or best_share <= share:
        return (
            ""
            if points
            else f"nothing in it reads as a point of the dialect {profile.dialect}, or of another one"
        )
    settings = f'dialect = "{best.dialect}"' + (f', columns = "{best.columns}"' if best.columns else "")
    settings += ', decimal = ","' if best.decimal == "," else ""
    return f"{points} points as the profile says, {count} with {settings}"


def best_fit(raw: bytes) -> tuple[MachineProfile | None, int, float]:
    """Return the candidate as which most of a dump reads, its points, and their share of the lines."""
    found: MachineProfile | None = None
    most, best_share = 0, 0.0
    for candidate in CANDIDATES:
        points, share = _fit(raw, candidate)
        if points and share > best_share:
            found, most, best_share = candidate, points, share
    return found, most, best_share


def counts_suspicion(raw: bytes, profile: MachineProfile) -> str:
    """Return a hint if all coordinates are large whole numbers and are taken for lengths."""
    if (
        profile.scale != (1.0, 1.0, 1.0)
        or profile.units != "mm"
        or profile.dialect not in {"xyz", "xyz_letters"}
    ):
        return ""
    hits = [event for event in decoded([raw[:_SAMPLE]], profile) if isinstance(event, Hit)]
    lengths = [value for hit in hits for value in hit[:3]]
    if (
        not lengths
        or any(value != round(value) for value in lengths)
        or max(map(abs, lengths)) < _LARGE_COUNT
    ):
        return ""
    return (
        f"all coordinates are whole numbers, up to {max(map(abs, lengths)):.0f}: are they counts? set scale"
    )


def decimals_suspicion(raw: bytes, profile: MachineProfile) -> str:
    """Return a hint if nearly all points have the same decimals and some have fewer: so lost bytes look."""
    if profile.decimals >= 0 or profile.dialect not in {"xyz", "xyz_letters"} or profile.decimal != ".":
        return ""
    lines = [line for line in re.split(rb"\r\n|\r|\n", raw[:_SAMPLE])[:-1] if line.strip()]
    forms = [tuple(len(match[1] or b"") for match in _COORDINATE.finditer(line)) for line in lines]
    if not forms:
        return ""
    form, count = Counter(forms).most_common(1)[0]
    others = len(forms) - count
    if not others or count < _NEARLY_ALL * len(forms):
        return ""
    first = next(number for number, other in enumerate(forms) if other != form)
    return (
        f"{count} of {len(forms)} lines have {form} decimals, others as "
        f"{lines[first][:60].decode('latin-1')!r} have not: bytes may be lost; state decimals in the profile"
    )


def _fit(raw: bytes, profile: MachineProfile) -> tuple[int, float]:
    """Return the points in a sample of a dump, and their share of all lines but notes."""
    tried = replace(profile, terminator="any")
    sample = raw[:_SAMPLE]
    cut = max(sample.rfind(b"\r"), sample.rfind(b"\n")) + 1
    events = [
        event for event in islice(decoded([sample[:cut]], tried), _SAMPLE) if not isinstance(event, Note)
    ]
    points = sum(isinstance(event, Hit) for event in events)
    return points, points / len(events) if events else 0.0
