"""A machine as its operator describes it: how its port is set, what a line means, what a point is.

One TOML file per machine; see the examples in ``configs/machines``. Every mistake is named with its place.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

from cmm_align.errors import MissingFileError, UsageError
from cmm_align.model import PointKind
from cmm_align.toml_table import check_keys, did_you_mean
from cmm_align.units import mm_per

DEFAULT_COLUMNS: Final = {
    "xyz": "x,y,z",
    "xyz_letters": "x,y,z",
    "gmserver": "x,y,z,w,i,j,k",
    "ipp": "x,y,z,q",
}
"""Columns of each dialect where the profile names none; its keys are the names of the dialects."""

COLUMN_WORDS: Final = {
    "xyz": {"x", "y", "z", "w", "i", "j", "k", "id", "name", "sigma", "q", "-"},
    "xyz_letters": {"x", "y", "z", "w"},
    "gmserver": {"x", "y", "z", "w", "i", "j", "k"},
    "ipp": {"x", "y", "z", "i", "j", "k", "q", "er", "-"},
}
"""What a column may mean: `w` rotary table, `q` quality from 0 (good) to 100 (bad), `er` effective tip
radius, `-` nothing to us."""


@dataclass(frozen=True, slots=True)
class MachineProfile:
    r"""One machine and its port. Nothing here is ever sent to it.

    Attributes
    ----------
    scale : tuple of 3 floats
        Units per number on the wire, for x, y and z: 0.001 for counts of a micrometre where `units` is mm.
    axis_map : str
        Where x, y and z come from: ``+y,-x,+z`` takes the machine's x from the number called y, its y from
        minus the number called x.
    terminator : str
        ``"\r"``, ``"\n"``, ``"\r\n"`` or ``"any"``; files say CR, LF, CRLF, any.
    decimals : int
        Digits after the decimal sign of every coordinate; 0 for whole numbers; -1 does not check. A line
        with another number of digits is rejected: so a number that has lost its end is seen.
    """

    name: str = "unnamed"
    dialect: str = "xyz"
    baud: int = 9600
    bytesize: int = 8
    parity: str = "N"
    stopbits: float = 1.0
    xonxoff: bool = False
    rtscts: bool = False
    dsrdtr: bool = False
    terminator: str = "any"
    end_marker: str = ""
    """The line, blanks at its ends apart, with which the machine ends a dump; empty if it has none."""
    start_command: str = ""
    """What an operator does to start the dump: shown to people, never sent."""
    header_lines: int = 0
    """So many lines at the start of a dump are its heading."""
    columns: str = ""
    """What the numbers of a line mean, in order; empty for the usual ones of the dialect."""
    separator: str = "any"
    """Between columns: comma, semicolon, tab, blank, or any: then the first point decides."""
    decimal: str = "."
    decimals: int = -1
    signed: bool = False
    """Whether x, y and z always begin with + or -: a number that has lost its front is then seen."""
    units: str = "mm"
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    axis_map: str = "+x,+y,+z"
    rotary_scale: float = 1.0
    """Degrees per number in the column w."""
    rotary_band_deg: float = 0.01
    """Points taken with the rotary table further than this from its first place are rejected."""
    hit_code: str = "HIT"
    """Word behind the numbers of a GMServer hit; empty takes any."""
    worst_quality: float = 99.0
    """Points of a worse quality (column q: 0 good, 100 bad) are rejected."""
    kind: PointKind = PointKind.UNSTATED
    tip_radius_mm: float = 0.0
    """0 if it is not known here."""
    idle_end_s: float = 3.0
    """A dump is over when nothing has come for so long."""
    first_data_timeout_s: float = 60.0
    max_bytes: int = 1_000_000_000

    @property
    def column_words(self) -> tuple[str, ...]:
        """The meaning of each column, in order."""
        return tuple(
            word.strip().lower() for word in (self.columns or DEFAULT_COLUMNS[self.dialect]).split(",")
        )


LIMITS: Final[dict[str, tuple[float, float]]] = {
    "baud": (50, 10_000_000),
    "bytesize": (7, 8),
    "stopbits": (1.0, 2.0),
    "header_lines": (0, 10_000),
    "decimals": (-1, 12),
    "scale": (1e-12, 1e6),
    "rotary_scale": (1e-12, 1e6),
    "rotary_band_deg": (0.0, 180.0),
    "worst_quality": (0.0, 100.0),
    "tip_radius_mm": (0.0, 1e3),
    "idle_end_s": (0.01, 86_400.0),
    "first_data_timeout_s": (0.01, 86_400.0),
    "max_bytes": (1, 1 << 40),
}
"""Least and largest value of each number; outside them a setting is a mistake."""

TERMINATORS: Final = {"any": "any", "CR": "\r", "LF": "\n", "CRLF": "\r\n"}

CHOICES: Final[dict[str, tuple[object, ...]]] = {
    "dialect": tuple(DEFAULT_COLUMNS),
    "parity": ("N", "E", "O", "M", "S"),
    "stopbits": (1.0, 1.5, 2.0),
    "terminator": tuple(TERMINATORS.values()),
    "separator": ("any", "comma", "semicolon", "tab", "blank"),
    "decimal": (".", ","),
    "kind": (PointKind.TIP_CENTRE, PointKind.CONTACT, PointKind.UNSTATED),
}
"""All values of the settings that have a few only."""


def read_profile(path: Path | str) -> MachineProfile:
    """Return the machine that a TOML file describes.

    Raises
    ------
    MissingFileError
        If it cannot be opened.
    UsageError
        If it is not TOML, or holds a key or a value that makes no sense; the nearest known key is named.
    """
    where = str(path)
    try:
        table = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise MissingFileError(f"cannot read it ({error.strerror})", where=where) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"not valid TOML: {error}", where=where) from None
    if "dialect" not in table:
        raise UsageError("dialect is missing", where=where, expected=f"one of {', '.join(DEFAULT_COLUMNS)}")
    return profile_of({"name": Path(path).stem, **table}, where=where)


def profile_of(table: Mapping[str, Any], *, where: str = "profile") -> MachineProfile:
    """Return the machine that a table of settings describes; what it leaves out has its default.

    Raises
    ------
    UsageError
        As `read_profile`.
    """
    defaults = MachineProfile()
    known = {field.name: getattr(defaults, field.name) for field in fields(MachineProfile)}
    check_keys(table, known, where=where, error=UsageError)
    profile = MachineProfile(**{key: _value(key, table[key], known[key], where) for key in table})
    _check_columns(profile, where)
    _check_meaning(profile, where)
    return profile


def _value(key: str, value: Any, default: object, where: str) -> Any:
    """Return a setting as its field holds it."""
    if key == "scale":
        found: Any = tuple(value) if isinstance(value, list | tuple) else (value,) * 3
    elif key == "terminator" and isinstance(value, str):
        found = TERMINATORS.get(value if value == "any" else value.upper(), value)
    elif isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        found = float(value)
    else:
        found = value
    alike = isinstance(found, str) if isinstance(default, str) else type(found) is type(default)
    if not alike or (isinstance(found, tuple) and len(found) != 3):
        raise UsageError(
            f"{key} = {value!r}", where=where, expected=f"a value like {_as_written(key, default)}"
        )
    if key in CHOICES and found not in CHOICES[key]:
        words = list(TERMINATORS) if key == "terminator" else [str(choice) for choice in CHOICES[key]]
        remedy = did_you_mean(found, words) if isinstance(found, str) else ""
        raise UsageError(
            f"{key} = {value!r}", where=where, expected=f"one of {', '.join(words)}", remedy=remedy
        )
    low, high = LIMITS.get(key, (0.0, 0.0))
    for part in found if isinstance(found, tuple) else (found,):
        number = isinstance(part, int | float) and not isinstance(part, bool)
        if key in LIMITS and not (number and low <= part <= high):
            raise UsageError(f"{key} = {value!r}", where=where, expected=f"{low:g} to {high:g}")
    if key == "scale" and isinstance(found, tuple):
        return tuple(float(part) for part in found)
    return PointKind(found) if key == "kind" and isinstance(found, str) else found


def _as_written(key: str, default: object) -> str:
    return (
        "0.001 or [0.001, 0.001, 0.001]"
        if key == "scale"
        else repr(str(default) if key == "kind" else default)
    )


def _check_columns(profile: MachineProfile, where: str) -> None:
    words, known = profile.column_words, COLUMN_WORDS[profile.dialect]
    for word in words:
        if word not in known:
            raise UsageError(f"column {word!r}", where=where, expected=f"some of {', '.join(sorted(known))}")
    twice = {word for word in words if word != "-" and words.count(word) > 1}
    if not {"x", "y", "z"} <= set(words) or twice or 0 < len({"i", "j", "k"} & set(words)) < 3:
        raise UsageError(
            f"columns = {profile.columns!r}", where=where, expected="x, y and z, i, j, k together, each once"
        )
    if profile.dialect == "gmserver" and ",".join(words) != DEFAULT_COLUMNS["gmserver"]:
        raise UsageError(
            f"columns = {profile.columns!r}",
            where=where,
            expected=f"none: a GMServer hit is always {DEFAULT_COLUMNS['gmserver']}",
        )
    signed = [part.strip() for part in profile.axis_map.split(",")]
    wrong = any(len(part) != 2 or part[0] not in "+-" for part in signed)
    if wrong or sorted(part[1] for part in signed) != ["x", "y", "z"]:
        raise UsageError(
            f"axis_map = {profile.axis_map!r}", where=where, expected="each axis once, as +y,-x,+z"
        )


def _check_meaning(profile: MachineProfile, where: str) -> None:
    mm_per(profile.units, where=where)
    if not (profile.end_marker.isascii() and profile.end_marker == profile.end_marker.strip()):
        raise UsageError(
            f"end_marker = {profile.end_marker!r}", where=where, expected="ASCII without blanks at its ends"
        )
    if profile.decimal == "," and profile.separator == "comma":
        raise UsageError(
            "commas both inside and between numbers", where=where, expected="another decimal or separator"
        )
    plain = MachineProfile()
    if profile.dialect == "ipp":
        for key in ("units", "scale", "decimal", "decimals", "signed"):
            if getattr(profile, key) != getattr(plain, key):
                raise UsageError(
                    f"{key} = {getattr(profile, key)!r}",
                    where=where,
                    expected="no such setting: I++ DME lays down mm and its numbers",
                )
