"""What a user may ask of the pictures of a map, the same for all of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from cmm_align.report.wording import minus


class Limits(NamedTuple):
    """Tolerance limits of single deviations."""

    low_um: float
    high_um: float
    origin: str = ""
    """Which tolerance they come from."""

    @property
    def words(self) -> str:
        """Return the limits in words."""
        high = minus(self.high_um)
        told = f"limits {minus(self.low_um)} to {'+' if self.high_um > 0.0 else ''}{high} \N{MICRO SIGN}m"
        return f"{told} ({self.origin})" if self.origin else told


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the pictures of a map shall show.

    Attributes
    ----------
    title : str
        Headline; shown as it is.
    source : str
        Name of the file behind the map, for the foot of the sheet.
    scale_um : float
        The colours and axes of deviations reach from minus to plus this, um, so that the pictures of a series
        compare; 0 for what the map needs.
    limits : Limits or None
        Tolerance limits of single deviations.
    sections : tuple of str
        Lines to cut along, as ``x=0``; none for the two through the middle.
    """

    title: str = "Deviation map"
    source: str = ""
    scale_um: float = 0.0
    limits: Limits | None = None
    sections: tuple[str, ...] = ()
