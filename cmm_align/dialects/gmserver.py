r"""Hits as PC-DMIS's GMServer writes them on its own TCP port: ``"\n ( X Y Z W I J K ) HIT\r"``.

Seven numbers and a code of up to three characters are a hit; four numbers are the reply to a poll of the
position, which shares the line and is no point (Hexagon, online help, "Support for Generic CMM", 2021).
The closing bracket and the code show a line that lost its end; see `line` for what nothing shows.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from cmm_align.dialects.axes import Axes, axes_of, direction_of, is_within_reach, placed
from cmm_align.dialects.events import Dialect, Event, Hit, Note
from cmm_align.dialects.line import BLANKS, Fault, number_of, number_pattern, passed_over, rejected, shown
from cmm_align.dialects.profile import MachineProfile
from cmm_align.dialects.rotary import turned_away

_CODE: Final = r"(?: +([!-'*-~]{1,3}))"


class _Plan(NamedTuple):
    """What does not change from line to line."""

    profile: MachineProfile
    axes: Axes
    hit: re.Pattern[bytes]
    position: re.Pattern[bytes]


class GmserverState(NamedTuple):
    """What is known after some lines."""

    plan: _Plan
    line: int = 0
    hits: int = 0
    rotary_deg: float = 0.0


def begin(profile: MachineProfile) -> GmserverState:
    """Return the state before the first line."""
    length = f"({number_pattern(profile.decimal, profile.decimals, signed=profile.signed)})"
    number = f"({number_pattern(profile.decimal)})"
    hit = r"\( *" + " +".join([length] * 3 + [number] * 4) + r" *\)" + _CODE
    position = r"\( *" + " +".join([length] * 3 + [number]) + r" *\)" + f"{_CODE}?"
    plan = _Plan(
        profile, axes_of(profile), re.compile(hit.encode("ascii")), re.compile(position.encode("ascii"))
    )
    return GmserverState(plan)


def step(state: GmserverState, raw: bytes) -> tuple[GmserverState, tuple[Event, ...]]:
    """Return the state after one more line, and the hit in it or what it is instead."""
    plan, line, hits, first_deg = state
    line += 1
    state = GmserverState(plan, line, hits, first_deg)
    text = raw.strip(BLANKS)
    if not text:
        return state, ()
    match = plan.hit.fullmatch(text)
    if match is None:
        position = plan.position.fullmatch(text)
        if position is not None and position[5] != plan.profile.hit_code.encode("ascii"):
            return state, (Note(line, shown(text), "position, no hit"),)
        note = passed_over(plan.profile, text, line, before_points=hits == 0)
        return state, (note or rejected(line, raw, _fault(raw)),)
    x, y, z, w, i, j, k, code = match.groups()
    point_mm = placed(plan.axes, (number_of(x), number_of(y), number_of(z)))
    direction = direction_of(plan.axes, (number_of(i), number_of(j), number_of(k)))
    here_deg = number_of(w) * plan.profile.rotary_scale
    first_deg = first_deg if hits else here_deg
    group, why = _complaint(plan.profile, point_mm, direction, code.decode("ascii"))
    if not why:
        group, why = 4, turned_away(here_deg, first_deg, plan.profile.rotary_band_deg)
    if why or isinstance(direction, str):
        return state, (rejected(line, raw, Fault(raw.find(text) + match.start(group), why)),)
    return GmserverState(plan, line, hits + 1, first_deg), (Hit(*point_mm, direction),)


def end(state: GmserverState) -> tuple[Event, ...]:
    """Return nothing: no line depends on another one."""
    return ()


GMSERVER: Final = Dialect("gmserver", begin, step, end)


def _complaint(
    profile: MachineProfile,
    point_mm: tuple[float, float, float],
    direction: tuple[float, float, float] | str | None,
    code: str,
) -> tuple[int, str]:
    """Return the group that speaks against a hit, and why; empty if none does."""
    if not is_within_reach(point_mm):
        return 1, f"further away than any machine reaches: {point_mm} mm"
    if profile.hit_code not in {"", code}:
        return 8, f"the code {code!r} is not {profile.hit_code!r}; if it means a hit, set hit_code"
    return (5, direction) if isinstance(direction, str) else (0, "")


def _fault(raw: bytes) -> Fault:
    """Return what is wrong with the brackets or between them."""
    text = raw.decode("latin-1")
    opened, closed = text.find("("), text.rfind(")")
    if opened < 0 or closed < opened:
        return Fault(max(opened, 0), "not between brackets: bytes are lost, or this is another dialect")
    for field in re.finditer(r"[^ ]+", text[opened + 1 : closed]):
        if not re.fullmatch(number_pattern().encode("ascii"), field[0].encode("latin-1")):
            return Fault(opened + 1 + field.start(), f"{field[0][:40]!r} is not a number")
    count = len(text[opened + 1 : closed].split())
    return Fault(opened, f"{count} numbers, expected X Y Z W I J K and a code of three characters")
