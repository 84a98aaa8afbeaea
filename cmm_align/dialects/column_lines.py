"""Points as lines of columns: bare numbers, or numbers behind the letters X, Y, Z and W.

The eight line shapes that PC-DMIS's GMServer accepts of a "Generic CMM" (Hexagon, online help, "Support for
Generic CMM", 2021) are these, with the settings of a profile that tell them apart:

====================================  ===============  ============  ========================
shape                                 dialect          columns       scale, decimals
====================================  ===============  ============  ========================
1  ``100.000,200.000,300.000``        ``xyz``          ``x,y,z``     1, 3
2  ``100000,200000,300000``           ``xyz``          ``x,y,z``     0.001 (say), 0
3  ``X100.000,Y200.000,Z300.000``     ``xyz_letters``  ``x,y,z``     1, 3
4  ``X100000,Y200000,Z300000``        ``xyz_letters``  ``x,y,z``     0.001, 0
5  as 1, then ``,245.5``              ``xyz``          ``x,y,z,w``   1, -1
6  as 2, then ``,2455``               ``xyz``          ``x,y,z,w``   0.001, 0; rotary_scale 0.1
7  as 3, then ``,W245.5``             ``xyz_letters``  ``x,y,z,w``   1, -1
8  as 4, then ``,W2455``              ``xyz_letters``  ``x,y,z,w``   0.001, 0; rotary_scale 0.1
====================================  ===============  ============  ========================

`decimals` holds for x, y, z. Readouts with blanks, tabs or semicolons, point numbers, directions and the
like are the dialect ``xyz`` with other columns.

Of a line that lost or gained bytes, what is left may be a point as good as any: counts have no decimals
that could be missing, so their profile should state the terminator (see `framing`) and the dump should be
captured with its expected count. See `line` for the rest.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from cmm_align.dialects.axes import Axes, axes_of, direction_of, is_within_reach, placed
from cmm_align.dialects.events import Dialect, Event, Hit
from cmm_align.dialects.framing import LONGEST_LINE
from cmm_align.dialects.line import BLANKS, Fault, number_of, number_pattern, passed_over, rejected
from cmm_align.dialects.profile import MachineProfile
from cmm_align.dialects.rotary import turned_away

_SEPARATORS: Final = {
    "comma": r"[ \t]*+,[ \t]*+",
    "semicolon": r"[ \t]*+;[ \t]*+",
    "tab": r" *+\t *+",
    "blank": r"[ \t]++",
}
_SIGNS: Final = {"comma": b",", "semicolon": b";", "tab": rb"\t", "blank": rb"[ \t]+"}
_ANY_TEXT: Final = {"comma": r"[ -+\--~]*+", "semicolon": "[ -:<-~]*+", "tab": "[ -~]*+", "blank": "[!-~]++"}


class _Layout(NamedTuple):
    """Lines of one separator: the whole line, and its columns one by one."""

    line: re.Pattern[bytes]
    columns: tuple[re.Pattern[bytes], ...]
    separator: re.Pattern[bytes]


class _Plan(NamedTuple):
    """What does not change from line to line."""

    profile: MachineProfile
    axes: Axes
    words: tuple[str, ...]
    layouts: tuple[_Layout, ...]
    xyz: tuple[int, int, int]
    """Numbers of the groups of x, y, z, from 0."""
    ijk: tuple[int, int, int] | None
    others: dict[str, int]
    """Numbers of the groups of what is neither."""


class LineState(NamedTuple):
    """What is known after some lines."""

    plan: _Plan
    line: int = 0
    layout: _Layout | None = None
    """As the first point showed it."""
    rotary_deg: float | None = None
    """Place of the rotary table at the first point."""


def begin_bare(profile: MachineProfile) -> LineState:
    """Return the state before the first line of bare numbers."""
    return _begin(profile, lettered=False)


def begin_lettered(profile: MachineProfile) -> LineState:
    """Return the state before the first line of numbers behind letters."""
    return _begin(profile, lettered=True)


def step(state: LineState, raw: bytes) -> tuple[LineState, tuple[Event, ...]]:
    """Return the state after one more line, and the point in it or what it is instead."""
    plan, line, layout, rotary_deg = state
    line += 1
    text = raw.strip(BLANKS)
    if not text:
        return LineState(plan, line, layout, rotary_deg), ()
    match, seen = _matched(plan.layouts if layout is None else (layout,), text)
    if match is None or len(raw) > LONGEST_LINE:
        state = LineState(plan, line, layout, rotary_deg)
        note = passed_over(plan.profile, text, line, before_points=layout is None)
        return state, (note or rejected(line, raw, _fault(state, raw)),)
    fields, (x, y, z) = match.groups(), plan.xyz
    point_mm = placed(plan.axes, (number_of(fields[x]), number_of(fields[y]), number_of(fields[z])))
    if not is_within_reach(point_mm):
        fault = Fault(raw.find(text), f"further away than any machine reaches: {point_mm} mm")
        return LineState(plan, line, layout, rotary_deg), (rejected(line, raw, fault),)
    if len(fields) == 3:
        return LineState(plan, line, seen, rotary_deg), (Hit(*point_mm),)
    found, rotary_deg = _with_more(plan, fields, point_mm, rotary_deg)
    if isinstance(found, Hit):
        return LineState(plan, line, seen, rotary_deg), (found,)
    group, why = found
    fault = Fault(raw.find(text) + match.start(group + 1), why)
    return LineState(plan, line, layout, state.rotary_deg), (rejected(line, raw, fault),)


def end(state: LineState) -> tuple[Event, ...]:
    """Return nothing: no line depends on another one."""
    return ()


XYZ: Final = Dialect("xyz", begin_bare, step, end)
XYZ_LETTERS: Final = Dialect("xyz_letters", begin_lettered, step, end)


def _begin(profile: MachineProfile, *, lettered: bool) -> LineState:
    words = profile.column_words
    kinds = tuple(_SEPARATORS) if profile.separator == "any" else (profile.separator,)
    layouts = []
    for kind in kinds:
        if kind == "comma" and profile.decimal == ",":
            continue
        columns = [_column(word, kind, profile, lettered=lettered) for word in words]
        between = _SEPARATORS[kind]
        layouts.append(
            _Layout(
                re.compile(between.join(columns).encode("ascii")),
                tuple(re.compile(column.encode("ascii")) for column in columns),
                re.compile(_SIGNS[kind]),
            )
        )
    named = [word for word in words if word != "-"]
    place = {word: number for number, word in enumerate(named)}
    x, y, z = (place.pop(word) for word in "xyz")
    ijk = (place.pop("i"), place.pop("j"), place.pop("k")) if "i" in place else None
    return LineState(_Plan(profile, axes_of(profile), words, tuple(layouts), (x, y, z), ijk, place))


def _column(word: str, kind: str, profile: MachineProfile, *, lettered: bool) -> str:
    """Return the regular expression of one column; what means nothing to us has no group."""
    if word == "-":
        return _ANY_TEXT[kind]
    if word == "id":
        return r"(\d{1,15})"
    if word == "name":
        return f"({_ANY_TEXT[kind].replace('*', '+')})"
    length = word in {"x", "y", "z"}
    number = number_pattern(
        profile.decimal, profile.decimals if length else -1, signed=length and profile.signed
    )
    return rf"{word.upper()} *+({number})" if lettered else f"({number})"


def _matched(layouts: tuple[_Layout, ...], text: bytes) -> tuple[re.Match[bytes] | None, _Layout]:
    """Return how a line reads in the first layout it fits."""
    for layout in layouts:
        match = layout.line.fullmatch(text)
        if match is not None:
            return match, layout
    return None, layouts[0]


def _with_more(
    plan: _Plan, fields: tuple[bytes, ...], point_mm: tuple[float, float, float], rotary_deg: float | None
) -> tuple[Hit | tuple[int, str], float | None]:
    """Return a point with more than three columns, or the group that speaks against it and why.

    With it comes the place of the rotary table at the first point.
    """
    others, axes = plan.others, plan.axes
    direction = None
    if plan.ijk is not None:
        i, j, k = plan.ijk
        found = direction_of(axes, (number_of(fields[i]), number_of(fields[j]), number_of(fields[k])))
        if isinstance(found, str):
            return (i, found), rotary_deg
        direction = found
    if not others:
        return Hit(*point_mm, direction), rotary_deg
    if "w" in others:
        here_deg = number_of(fields[others["w"]]) * plan.profile.rotary_scale
        rotary_deg = here_deg if rotary_deg is None else rotary_deg
        why = turned_away(here_deg, rotary_deg, plan.profile.rotary_band_deg)
        if why:
            return (others["w"], why), rotary_deg
    if "q" in others:
        quality = number_of(fields[others["q"]])
        if not 0.0 <= quality <= plan.profile.worst_quality:
            why = f"quality {quality:g}: the machine itself calls this point bad"
            return (others["q"], why), rotary_deg
    sigma_mm = None
    if "sigma" in others:
        sigma_mm = number_of(fields[others["sigma"]]) * abs(axes.multiply[0]) / axes.divide[0]
        if sigma_mm < 0.0:
            return (others["sigma"], "a standard uncertainty below zero"), rotary_deg
    number = int(fields[others["id"]]) if "id" in others else None
    name = fields[others["name"]].decode("ascii").strip() if "name" in others else ""
    return Hit(*point_mm, direction, number, name, sigma_mm), rotary_deg


def _fault(state: LineState, raw: bytes) -> Fault:
    """Return where a line of text goes wrong as a point, and what would be right there."""
    plan = state.plan
    start = len(raw) - len(raw.lstrip(BLANKS))
    text = raw.strip(BLANKS)
    layouts = plan.layouts if state.layout is None else (state.layout,)
    parts = [list(layout.separator.finditer(text)) for layout in layouts]
    best = min(range(len(layouts)), key=lambda k: abs(len(parts[k]) + 1 - len(plan.words)))
    layout, cuts = layouts[best], parts[best]
    ends = [*(cut.start() for cut in cuts), len(text)]
    starts = [0, *(cut.end() for cut in cuts)]
    wanted = ",".join(plan.words)
    for word, pattern, begin, last in zip(plan.words, layout.columns, starts, ends, strict=False):
        field = text[begin:last].strip(BLANKS)
        if not pattern.fullmatch(field):
            at = start + begin + text[begin:last].find(field)
            word_there = field[:40].decode("latin-1")
            why = f"{word_there!r} is no {word} of a point {wanted}{_reason(plan, word, word_there)}"
            return Fault(at, why)
    offset = starts[len(plan.words)] if len(starts) > len(plan.words) else len(text)
    return Fault(start + offset, f"{len(starts)} columns, expected {len(plan.words)}: {wanted}")


def _reason(plan: _Plan, word: str, field: str) -> str:
    decimals = plan.profile.decimals
    if word in {"x", "y", "z"} and decimals >= 0 and re.fullmatch(r"[A-Z]?[+-]?[\d.,]+", field):
        return f" with {decimals} decimals: bytes may be lost"
    if plan.profile.end_marker == "" and field.isalpha():
        return f"; if it ends the dump, set end_marker = {field!r}"
    return ""
