"""What an alignment knows of its pose, and where more points would tell it more.

All numbers are standard uncertainties; infinite where the data cannot tell. Places are in frame `part`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class WeakMotion:
    """A motion that the data can tell, but badly.

    Attributes
    ----------
    words : str
        The motion, as the free ones are named.
    sigma_um : float
        How far it may displace a point at the edge of the part; the translation itself for a translation.
    sigma_urad : float
        The angle of a rotation or screw motion; 0 for a translation.
    times_worse : float
        How many times worse the deviations tell it than the motion that they tell best.
    """

    words: str
    sigma_um: float
    sigma_urad: float
    times_worse: float


@dataclass(frozen=True, slots=True)
class Correlation:
    """Two motions about the centroid that the data hardly tell apart.

    Attributes
    ----------
    first, second : str
        rx, ry, rz, tx, ty or tz.
    rho : float
        Their correlation coefficient, -1 to 1.
    words : str
        What that means.
    """

    first: str
    second: str
    rho: float
    words: str


@dataclass(frozen=True, slots=True)
class HelpfulPlace:
    """A place on the nominal where further points help.

    Attributes
    ----------
    at_mm : tuple of float
        x, y, z, mm, frame `part`.
    after_one_um : float
        Standard uncertainty of the motion to be helped, with one point more here and at each place before.
    after_many_um : float
        The same with `PoseKnowledge.points_each` points at each.
    """

    at_mm: tuple[float, float, float]
    after_one_um: float
    after_many_um: float


@dataclass(frozen=True, slots=True)
class PoseKnowledge:
    """How well a pose is known, in the words of the part.

    Attributes
    ----------
    weak : tuple of WeakMotion
        Weakest first; none on a part that holds all its motions well.
    edge_sigma_um : float
        Largest standard uncertainty, at the border of the nominal, of the deviation that the pose causes
        along the normal; NaN if no border was found.
    edge_at_mm : tuple of float
        Where that is.
    edge_shift_sigma_um : float
        How far a point at the border may be displaced, in the direction where that is most.
    edge_shift_at_mm : tuple of float
        Where that is.
    correlations : tuple of Correlation
    helped : str
        The weakest motion, in words: a free one if the nominal could tell it, else the weakest of the rest.
    helped_um : float
        Its standard uncertainty now, at the edge of the part.
    points_each : int
        Points that `HelpfulPlace.after_many_um` puts at each place: 1 % of those used.
    helpful : tuple of HelpfulPlace
        Up to three, most helpful first.
    """

    weak: tuple[WeakMotion, ...]
    edge_sigma_um: float
    edge_at_mm: tuple[float, float, float]
    edge_shift_sigma_um: float
    edge_shift_at_mm: tuple[float, float, float]
    correlations: tuple[Correlation, ...]
    helped: str
    helped_um: float
    points_each: int
    helpful: tuple[HelpfulPlace, ...]

    def words(self) -> tuple[str, ...]:
        """Return what an operator should read, a sentence each."""
        lines = [_weak(motion) for motion in self.weak]
        at, shift_at = _place(self.edge_at_mm), _place(self.edge_shift_at_mm)
        lines.append(
            f"edge of the part: {self.edge_sigma_um:.2g} um along the normal at ({at}) mm, "
            f"{self.edge_shift_sigma_um:.2g} um in any direction at ({shift_at}) mm"
        )
        lines += [f"{c.first} and {c.second}: {c.rho:.2f}; {c.words}" for c in self.correlations]
        if self.helpful:
            last = self.helpful[-1]
            places = ", ".join(f"({_place(h.at_mm)})" for h in self.helpful)
            lines.append(
                f"more points at {places} mm: {self.helped} from {self.helped_um:.3g} um to "
                f"{last.after_one_um:.3g} um with one each, to {last.after_many_um:.3g} um with "
                f"{self.points_each} each"
            )
        return tuple(lines)


def _weak(motion: WeakMotion) -> str:
    """Write a weak motion with its uncertainty."""
    turn = f"{motion.sigma_urad:.2g} urad, " if motion.sigma_urad else ""
    where = " at the edge" if motion.sigma_urad else ""
    worse = f"{motion.times_worse:.0f} times worse than the motion known best"
    return f"{motion.words}: {turn}{motion.sigma_um:.2g} um{where}, {worse}"


def _place(at_mm: tuple[float, float, float]) -> str:
    """Write a place with a sensible number of digits."""
    return ", ".join(f"{value:.4g}" for value in at_mm)
