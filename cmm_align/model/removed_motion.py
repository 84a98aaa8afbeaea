"""The motion that a best fit has taken away, in the words of a drawing.

A best fit hides how the surface lies in the part: a lens with wedge or off its axis fits its own form as well
as a good one. Signs are those of the surface as it lies in the datum frame, seen from the nominal.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from cmm_align.model.statistics import Verdict

Direction = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """What the drawing allows, absolute values; 0 is no limit."""

    wedge_arcmin: float = 0.0
    decentre_um: float = 0.0
    clocking_arcmin: float = 0.0
    thickness_um: float = 0.0


@dataclass(frozen=True, slots=True)
class Wedge:
    """Tilt about the axes across the projection direction; u as for all: standard uncertainty, inf if free.

    Attributes
    ----------
    angle_arcmin, u_arcmin : float
    etd_um, u_etd_um : float
        Edge thickness difference over the aperture in the direction of the wedge.
    towards : tuple of float
        Unit vector in frame `part`, to the edge where the surface stands proud; zeros without a wedge.
    limit_arcmin : float
    verdict : str
        A `Verdict`; ``none`` without a limit.
    """

    angle_arcmin: float
    u_arcmin: float
    etd_um: float
    u_etd_um: float
    towards: Direction
    limit_arcmin: float
    verdict: str


@dataclass(frozen=True, slots=True)
class Decentre:
    """Shift of the aperture's centre across the projection direction, `towards` in frame `part`."""

    shift_um: float
    u_um: float
    towards: Direction
    limit_um: float
    verdict: str


@dataclass(frozen=True, slots=True)
class Clocking:
    """Rotation about the projection direction (right-handed about its +), and how far it moves the edge."""

    angle_arcmin: float
    u_arcmin: float
    edge_um: float
    u_edge_um: float
    limit_arcmin: float
    verdict: str


@dataclass(frozen=True, slots=True)
class Thickness:
    """Shift of the aperture's centre along the projection direction, + = the surface stands proud."""

    change_um: float
    u_um: float
    limit_um: float
    verdict: str


@dataclass(frozen=True, slots=True)
class RemovedMotion:
    """What the best fit hid; the motions are None where `applies` is False.

    Attributes
    ----------
    applies : bool
        Whether the start was a datum frame.
    reason : str
        Why not; empty if it was.
    verdict : str
        The worst of the four; undecided where limits were given and the motion does not apply.
    """

    applies: bool
    reason: str
    verdict: str
    wedge: Wedge | None = None
    decentre: Decentre | None = None
    clocking: Clocking | None = None
    thickness: Thickness | None = None


def limited(limits: MotionLimits) -> bool:
    """Return whether any limit is given."""
    return any(getattr(limits, field.name) > 0.0 for field in fields(limits))


def words(removed: RemovedMotion) -> tuple[str, ...]:
    """Return what the best fit hid, a line for each motion.

    Parameters
    ----------
    removed : RemovedMotion
    """
    w, d, c, t = removed.wedge, removed.decentre, removed.clocking, removed.thickness
    if w is None or d is None or c is None or t is None:
        return (removed.reason,)
    return (
        f"wedge {w.angle_arcmin:.4g} arcmin (u {w.u_arcmin:.2g}), ETD {w.etd_um:.4g} um "
        f"(u {w.u_etd_um:.2g}), proud{_towards(w.towards)}{_judged(w.verdict, w.limit_arcmin, 'arcmin')}",
        f"decentre {d.shift_um:.4g} um (u {d.u_um:.2g}){_towards(d.towards)}"
        f"{_judged(d.verdict, d.limit_um, 'um')}",
        f"clocking {c.angle_arcmin:+.4g} arcmin (u {c.u_arcmin:.2g}), {c.edge_um:+.4g} um at the edge "
        f"(u {c.u_edge_um:.2g}){_judged(c.verdict, c.limit_arcmin, 'arcmin')}",
        f"thickness {t.change_um:+.4g} um (u {t.u_um:.2g}){_judged(t.verdict, t.limit_um, 'um')}",
    )


def _judged(verdict: str, limit: float, unit: str) -> str:
    """Write a verdict with its limit, where there is one."""
    return "" if verdict == Verdict.NONE else f", limit {limit:.4g} {unit}: {verdict}"


def _towards(direction: Direction) -> str:
    """Write a direction as an axis where it is one, else by its components."""
    largest = max(range(3), key=lambda k: abs(direction[k]))
    if direction[largest] == 0.0:
        return " nowhere"
    if abs(direction[largest]) > 1.0 - 1e-6:
        return f" towards {'+' if direction[largest] > 0.0 else '-'}{'xyz'[largest]}"
    return " towards ({:.3f}, {:.3f}, {:.3f})".format(*(value + 0.0 for value in direction))
