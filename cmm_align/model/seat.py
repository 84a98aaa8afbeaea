"""How a part sits on the grinder, from touches there."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DoubtfulTouch:
    """A touch that the others contradict.

    Attributes
    ----------
    number : int
        Counted from 1.
    off_mm : float
        How far it lies off the surface that the others tell, along the normal.
    """

    number: int
    off_mm: float


@dataclass(frozen=True, slots=True)
class Seat:
    """Pose of a part on the grinder.

    Attributes
    ----------
    grinder_from_part : tuple of tuple of float
        Matrix, four rows of four, mm.
    n : int
        Touches.
    rms_mm : float
        Of the touches after the fit, form error of the map taken off.
    u_edge_mm : float or None
        95 % uncertainty of the path along the normal, where it is largest; None if too few touches tell it.
    u_edge_at_mm : tuple of float
        Where that is, (x, y) in frame `surface`.
    held : tuple of str
        Motions that the touches cannot tell, in words: held as the axes of the grinder are.
    moved_by_held_mm : float
        RMS by which the corrections would change if the held motions moved the edge by 1 mm.
    doubtful : tuple of DoubtfulTouch
    n_without_form : int
        Touches where the map knows no form error to take off.
    notes : tuple of str
    """

    grinder_from_part: tuple[tuple[float, ...], ...]
    n: int
    rms_mm: float
    u_edge_mm: float | None
    u_edge_at_mm: tuple[float, float]
    held: tuple[str, ...]
    moved_by_held_mm: float
    doubtful: tuple[DoubtfulTouch, ...] = ()
    n_without_form: int = 0
    notes: tuple[str, ...] = ()
