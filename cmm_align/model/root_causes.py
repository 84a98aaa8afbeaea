"""Single settings and effects that would explain the deviations of a part: what to put right before a map.

A value is what the cause would have to be; `Cause.sign` says what a positive one means. Radii and offsets are
what to add to the setting; all others are errors as the measurement shows them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

RELEVANT: Final = 0.2
"""Share of the mean square from which on a cause is worth a line beside the numbers of the map."""
DOMINANT: Final = 0.5
"""Share from which on it must be put right before anything is compensated."""


CANNOT_TELL: Final = 20.0
"""Odds up to which the data cannot tell two causes apart."""
MOST_NAMES: Final = 4
"""Causes that a sentence names for one contribution."""


@dataclass(frozen=True, slots=True)
class Member:
    """A cause that would explain the same.

    Attributes
    ----------
    name : str
    value, u : float
        If it alone were the cause; standard uncertainty.
    unit : str
        um, ppm, arcsec, or um over the run.
    angle_deg : float or None
        Direction of one lobe, as in `Cause`.
    sign : str
        What a positive value means.
    times_less_likely : float
        The odds against it, beside the cause that is named first; capped at 1e12. Up to `CANNOT_TELL` the
        data cannot tell; beyond, it looks nearly the same on this part and any further error may feign it.
    """

    name: str
    value: float
    u: float
    unit: str
    angle_deg: float | None
    sign: str
    times_less_likely: float


@dataclass(frozen=True, slots=True)
class Cause:
    """What the data say of one cause, or of several that they cannot tell apart.

    Attributes
    ----------
    name : str
        The likeliest; of those that are alike in everything, the one that is set most often.
    value, u : float
        Standard uncertainty; of a cause with lobes the PV of its share over the points.
    unit : str
        um, ppm, arcsec, or um over the run.
    angle_deg, u_angle_deg : float or None
        Direction of one lobe, from +x towards +y: of clamping in frame `surface`, of the probe in frame
        `machine`. None where there is no direction.
    sign : str
        What a positive value means.
    remedy : str
        What to do about it.
    share, u_share : float
        Of the mean square beyond the rigid motion, 0 to 1: what goes with this cause, mean over all orders in
        which the causes may be put right, so that shares add up to what all explain (Shapley 1953); and the
        standard uncertainty of what it contributes.
    rms_um : float
        RMS of what it contributes, beyond a rigid motion.
    rms_without_um : float
        RMS that is left if it alone is put right; larger than now where it hides another cause.
    odds : float
        How many times likelier the data are with it than without it, capped at 1e12.
    alternatives : tuple of Member
        Causes that the data cannot tell from this one.
    """

    name: str
    value: float
    u: float
    unit: str
    angle_deg: float | None
    u_angle_deg: float | None
    sign: str
    remedy: str
    share: float
    u_share: float
    rms_um: float
    rms_without_um: float
    odds: float
    alternatives: tuple[Member, ...]

    @property
    def words(self) -> str:
        """Return the cause as a sentence for whoever stands at the machine."""
        text = f"{self.name} {_sized(self.value, self.u, self.unit)} (u {_two(self.u)})"
        even = [m for m in self.alternatives if m.times_less_likely <= CANNOT_TELL]
        behind = [m for m in self.alternatives if m.times_less_likely > CANNOT_TELL]
        if even:
            text = f"{_either(text, even)} (the data cannot tell which)"
        text += f" explains {100.0 * self.share:.0f} %"
        if behind and not even:
            text += f" ({_either('', behind)} would look nearly the same)"
        return f"{text}: {self.remedy}" if self.share >= RELEVANT else text


@dataclass(frozen=True, slots=True)
class RootCauses:
    """What single causes explain of the deviations of the points.

    Attributes
    ----------
    causes : tuple of Cause
        Largest share first; only those that the data prove.
    reason : str
        Why none was looked for; empty if they were.
    looked_for : tuple of str
    hidden : tuple of str
        Causes that a rigid motion takes away on this part: the data say nothing about them.
    rms_um : float
        Of the points, beyond the rigid motion.
    rms_without_um : float
        Of the points, without all causes.
    n_points : int
        Points that were looked at.
    n_places : int
        Places that they were averaged to.
    correlation_mm : float
        Over what length the rest is alike; 0 if it is like noise.
    axis_mm : tuple of float
        Axis of rotation for offset and wear of the wheel, x and y in frame `surface`.
    """

    causes: tuple[Cause, ...]
    reason: str
    looked_for: tuple[str, ...]
    hidden: tuple[str, ...]
    rms_um: float
    rms_without_um: float
    n_points: int
    n_places: int
    correlation_mm: float
    axis_mm: tuple[float, float]

    @property
    def relevant(self) -> tuple[Cause, ...]:
        """Causes worth a line beside the numbers of the map."""
        return tuple(cause for cause in self.causes if cause.share >= RELEVANT)

    @property
    def dominant(self) -> Cause | None:
        """The cause to put right before anything is compensated, if there is one."""
        return self.causes[0] if self.causes and self.causes[0].share >= DOMINANT else None

    @property
    def words(self) -> str:
        """Return the finding in one sentence."""
        if self.reason:
            return f"not looked for: {self.reason}"
        if not self.causes:
            return "no single setting explains the deviations"
        return "; ".join(cause.words for cause in self.causes)


def _either(first: str, others: Sequence[Member]) -> str:
    """Write some causes as alternatives."""
    names = [first] if first else []
    names += [f"{m.name} {_sized(m.value, m.u, m.unit)}" for m in others]
    if len(names) > MOST_NAMES:
        names = [*names[: MOST_NAMES - 1], f"{len(names) - MOST_NAMES + 1} more"]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"


def _two(value: float) -> str:
    """Write a standard uncertainty with two digits and no exponent."""
    if not 0.0 < value < 1e6:
        return f"{value:.2g}"
    digits = max(0, 1 - int(f"{value:.1e}".split("e")[1]))
    return f"{value:.{min(digits, 6)}f}"


def _sized(value: float, u: float, unit: str) -> str:
    """Write a value with the digits that its uncertainty leaves, and three significant ones at most."""
    digits = max(0, 1 - int(f"{u:.1e}".split("e")[1])) if 0.0 < u < 1e6 else 3
    most = max(0, 2 - int(f"{abs(value):.2e}".split("e")[1])) if value else 0
    return f"{value:+.{min(digits, most, 6)}f} {unit}"
