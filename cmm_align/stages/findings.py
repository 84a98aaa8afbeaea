"""What a doctor of data says: a finding, how sure it is, and all that was looked at."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Evidence(StrEnum):
    """How sure a finding is, surest first."""

    CLEAR = "clear"
    """Nothing else explains the data: do not write a result."""
    SUSPECT = "suspect"
    """Something else may explain the data as well: warn."""
    UNTOLD = "untold"
    """The data cannot tell: say so."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that the data look like.

    Attributes
    ----------
    name : str
        Short and stable, for scripts: ``contact-points``, ``wrong-side``, ``mirrored`` ...
    words : str
        One sentence with numbers.
    evidence : Evidence
    remedy : str
        What the user can do.
    """

    name: str
    words: str
    evidence: Evidence
    remedy: str


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What a look at a fit found, surest first.

    Attributes
    ----------
    findings : tuple of Finding
    rms_mm : float
        Of the ordinary fit, on the points looked at.
    free_offset_mm, free_offset_u_mm : float
        Distance of the points from the nominal with the pose fitted too, and its standard uncertainty
        (noise, and form error that may look like it); NaN and infinite where the part is too flat.
    start_offset_mm, start_spread_mm : float
        Mean and standard deviation of the distance where the fit began; NaN where the points are elsewhere.
    other_side_rms_mm : float
        RMS with the ball on the other side; NaN for contact points.
    power_correlation : float
        How far an offset looks like a change of curvature, 0 to 1.
    """

    findings: tuple[Finding, ...]
    rms_mm: float
    free_offset_mm: float
    free_offset_u_mm: float
    start_offset_mm: float
    start_spread_mm: float
    other_side_rms_mm: float
    power_correlation: float

    @property
    def clear(self) -> tuple[Finding, ...]:
        """What must stop a run."""
        return tuple(f for f in self.findings if f.evidence is Evidence.CLEAR)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The rest, a sentence each."""
        return tuple(f.words for f in self.findings if f.evidence is not Evidence.CLEAR)
