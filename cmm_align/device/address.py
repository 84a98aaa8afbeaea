"""What a port may be called: a device, or a URL; and what stands in a `replay://` URL."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import parse_qsl, quote, unquote

from cmm_align.device.faults import NONE, Faults, faults_of
from cmm_align.errors import UsageError

REPLAY: Final = "replay"

_URL: Final = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://(.*)", re.DOTALL)
_WINDOWS_PORT: Final = re.compile(r"(\\\\\.\\)?COM\d{1,3}", re.IGNORECASE)
_WINDOWS_DRIVE: Final = re.compile(r"/[A-Za-z]:")
_OPTIONS: Final = ("speed", "chunk", "faults", "seed")


class Replay(NamedTuple):
    """A recording, and the way in which it is served.

    Attributes
    ----------
    path : Path
    speed : float
        1 is as it was, 10 ten times as fast; 0 is at once.
    chunk : int
        Most bytes that come in one piece; 0 is as they were.
    faults : Faults
    seed : int
        Of the faults.
    """

    path: Path
    speed: float = 0.0
    chunk: int = 0
    faults: Faults = NONE
    seed: int = 0


def scheme_of(text: str) -> str:
    """Return the scheme of a URL in small letters, or nothing for a name."""
    match = _URL.fullmatch(text)
    return match.group(1).lower() if match else ""


def is_port(text: str) -> bool:
    """Return whether a text names a port (a device or a URL) rather than a file.

    Examples
    --------
    >>> is_port("socket://10.0.0.7:4000"), is_port("part.csv")
    (True, False)
    """
    if scheme_of(text) or text.startswith("/dev/"):
        return True
    return _WINDOWS_PORT.fullmatch(text) is not None and not Path(text).is_file()


def replay_url(path: Path | str) -> str:
    """Return the URL that serves a recording at once."""
    return f"{REPLAY}://{quote(str(path), safe='/:')}"


def replay_of(url: str) -> Replay:
    """Return what a `replay://` URL says: ``replay://FILE?speed=1&chunk=7&faults=drop:3&seed=5``.

    Raises
    ------
    UsageError
        If it is none, names no file, or holds an option that is unknown or no number.
    """
    match = _URL.fullmatch(url)
    if match is None or match.group(1).lower() != REPLAY:
        raise UsageError("no replay:// URL", where=url, expected="replay://FILE")
    name, _, query = match.group(2).partition("?")
    if not name:
        raise UsageError("it names no file", where=url, expected="replay://FILE")
    name = unquote(name)
    options = dict(parse_qsl(query, keep_blank_values=True))
    for key in options:
        if key not in _OPTIONS:
            raise UsageError(f"unknown option {key!r}", where=url, expected=f"one of {', '.join(_OPTIONS)}")
    replay = Replay(
        Path(name[1:] if _WINDOWS_DRIVE.match(name) else name),
        _number(options, "speed", url),
        int(_number(options, "chunk", url)),
        faults_of(options.get("faults", ""), url),
        int(_number(options, "seed", url)),
    )
    if replay.faults.stall and not replay.speed:
        raise UsageError("a stall takes time, and at once there is none", where=url, remedy="add speed=1")
    return replay


def _number(options: dict[str, str], key: str, where: str) -> float:
    text = options.get(key, "0")
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    whole = key == "speed" or number.is_integer()
    if not (0.0 <= number < float("inf") and whole):
        expected = "a number above zero" if key == "speed" else "a whole number"
        raise UsageError(f"{key}={text}", where=where, expected=f"{key}= and {expected}")
    return number
