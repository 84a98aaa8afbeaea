"""The lines of I++ DME: commands, responses, and what data lines consist of.

Source: I++ DME Interface, release 1.4.3 (VDMA 8722), sections 5 and 6. A response is a tag, one of the
markers ``&`` (acknowledged), ``%`` (complete), ``#`` (data), ``!`` (error), and the rest. Tags E0000 to
E9999 belong to events. Recorders put a time and a direction in front of lines, and NIST's test suite a
line with two backslashes after each; both are taken off here.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from cmm_align.dialects.line import Fault

_NUMBER: Final = rb"[+-]?(?:\d++(?:\.\d*+)?+|\.\d++)(?:[eE][+-]?\d{1,3})?+"
_RECORDER: Final = re.compile(
    rb"(?:[CS]: *|\d\d:\d\d:\d\d_\d\d:\d\d:\d\d +(?:[Rr]eceived|[Ss]ent): *)?(?P<line>.*)", re.DOTALL
)
_RESPONSE: Final = re.compile(rb"(?P<tag>\d{5}|E\d{4}) (?P<marker>[&%#!])(?: (?P<body>[ -~]*))?")
_COMMAND: Final = re.compile(rb"(?P<tag>\d{5}|E\d{4}) (?P<name>[A-Za-z][\w.]*) *\((?P<arguments>[ -~]*)\) *")
_BODY: Final = 8
"""Offset of the body of a response, which has fixed columns."""
_VALUES: Final = rb" *[A-Za-z][\w.]* *\( *" + _NUMBER + rb" *(?:, *" + _NUMBER + rb" *)*+\) *"
_CLEAN: Final = re.compile(_VALUES + rb"(?:," + _VALUES + rb")*+")
_PAIR: Final = re.compile(rb"([A-Za-z][\w.]*) *\(([^)]*)\)")
_ITEM: Final = re.compile(rb" *([A-Za-z][\w.]*) *\(([^()\"]*)\) *(,|$)")
_REPORTED: Final = re.compile(r" *([A-Za-z][\w.]*) *(?:\([^()]*\))? *")
_ONE_NUMBER: Final = re.compile(rb" *" + _NUMBER + rb" *")
_NUMBERS: Final = re.compile(rb" *" + _NUMBER + rb"(?: *, *" + _NUMBER + rb")*+ *")
_ERROR: Final = re.compile(rb' *Error *\( *(\d) *, *(\d{4}) *, *"([^"]*)" *, *"([^"]*)" *\) *')

NULL_TAG: Final = b"00000"
"""No command may have it."""


POINT_NAMES: Final = {b"X": 1, b"Y": 1, b"Z": 1, b"IJK": 3, b"Q": 1, b"ER": 1}
"""Values of a point that mean something to us, and how many numbers each has."""


class Response(NamedTuple):
    """A line of the server."""

    tag: bytes
    marker: bytes
    body: bytes
    offset: int
    """Of the body in the line as it came, from 0."""


class Command(NamedTuple):
    """A line of the client."""

    tag: bytes
    name: str
    """Without the prefix of a private name space, as `CZ.`."""
    arguments: str


class Failure(NamedTuple):
    """An error of the server."""

    severity: int
    code: str
    method: str
    text: str


def unrecorded(raw: bytes) -> tuple[bytes, int]:
    r"""Return a line without what a recorder put around it, and where in `raw` it starts.

    Empty for what is no traffic at all: blank lines, ``\\``, and the ``:`` at the end of a log.
    """
    match = _RECORDER.match(raw)
    line, start = (raw, 0) if match is None else (match["line"], match.start("line"))
    line = line.rstrip(b" \t\r\n")
    return (b"", start) if line.strip() in {b"\\\\", b":"} else (line, start)


def response_of(line: bytes, start: int = 0) -> Response | None:
    """Return the response in a line, or None if it is none; `start` is added to the offset."""
    match = _RESPONSE.fullmatch(line)
    if match is None:
        return None
    tag, marker, body = match.groups()
    if tag == NULL_TAG:
        return None
    return Response(tag, marker, body or b"", start + _BODY)


def command_of(line: bytes) -> Command | None:
    """Return the command in a line, or None if it is none."""
    match = _COMMAND.fullmatch(line)
    if match is None or match["tag"] == NULL_TAG:
        return None
    name = match["name"].decode("ascii").rsplit(".", maxsplit=1)[-1]
    return Command(match["tag"], name, match["arguments"].decode("ascii"))


def reported_columns(arguments: str) -> tuple[str, ...]:
    """Return what a report such as ``X(),Y(),Z(),IJK(),Q()`` puts on a line, one word a number.

    What means nothing to us is ``-``.
    """
    words: list[str] = []
    for match in _REPORTED.finditer(arguments):
        name = match[1].lower()
        if name == "ijk":
            words += ["i", "j", "k"]
        else:
            words.append(name if name in {"x", "y", "z", "q", "er"} else "-")
    return tuple(words)


def named_numbers(body: bytes) -> dict[bytes, tuple[float, ...]] | Fault:
    """Return the values of ``ER(1.5), IJK(0,0,1), X(1.0), Y(2.0), Z(3.0)`` by name.

    The names may come in any order; values that are no numbers are left out. A fault is the first
    byte that is not as it should be.
    """
    if _CLEAN.fullmatch(body):
        pairs = _PAIR.findall(body)
        found = {name: tuple(map(float, values.split(b","))) for name, values in pairs}
        if len(found) == len(pairs):
            return found
    return _named_slowly(body)


def _named_slowly(body: bytes) -> dict[bytes, tuple[float, ...]] | Fault:
    found: dict[bytes, tuple[float, ...]] = {}
    at, more = 0, True
    while more:
        match = _ITEM.match(body, at)
        if match is None:
            return Fault(at, f"expected a value with its name, as X(1.0), found {_excerpt(body, at)}")
        if match[1] in found:
            return Fault(at, f"{match[1].decode('ascii')} is there twice")
        numbers = numbers_in(match[2], match.start(2))
        if not isinstance(numbers, Fault):
            found[match[1]] = numbers
        elif match[1] in POINT_NAMES:
            return numbers
        at, more = match.end(), match[3] == b","
    return found if at == len(body) else Fault(at, f"{_excerpt(body, at)} behind the last value")


def numbers_in(text: bytes, offset: int = 0) -> tuple[float, ...] | Fault:
    """Return numbers between commas, or the first that is none; `offset` is added to its place."""
    if _NUMBERS.fullmatch(text):
        return tuple(map(float, text.split(b",")))
    at = 0
    for part in text.split(b","):
        if not _ONE_NUMBER.fullmatch(part):
            break
        at += len(part) + 1
    return Fault(offset + min(at, len(text)), f"{_excerpt(text, at)} is not a number")


def failure_of(body: bytes) -> Failure | None:
    """Return the error in ``Error(2, 1006, "PtMeas", "Surface not found")``, or None."""
    match = _ERROR.fullmatch(body)
    if match is None:
        return None
    code, method, text = (match[k].decode("ascii") for k in (2, 3, 4))
    return Failure(int(match[1]), code, method, text)


def _excerpt(text: bytes, at: int) -> str:
    return repr(text[at:].split(b",")[0][:40].decode("latin-1").strip())
