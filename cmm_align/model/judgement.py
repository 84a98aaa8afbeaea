"""What a comparison with tolerances found: one judgement for each, and what they say together."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Judgement:
    """One quantity against its limits, in `unit`."""

    quantity: str
    """PV, RMS, profile, slope or band."""
    unit: str
    """um, or mrad for slopes."""
    measured: float
    """The worse of nodes and single points, as measured; of a band, the deviation that exceeds it most."""
    value: float
    """The same less the share of noise: what is judged under a guard band."""
    u: float
    """Standard uncertainty of `value`."""
    lower: float | None
    """Limits; None where there is none, or where they differ from point to point."""
    upper: float | None
    margin: float
    """From `value` to the nearest limit, negative beyond it."""
    probability: float
    """That the part conforms, 0 to 1 (JCGM 106)."""
    verdict: str
    """pass, fail or undecided."""
    sentence: str


@dataclass(frozen=True, slots=True)
class Conformance:
    """All judgements of a part."""

    rule: str
    """guard-band or simple."""
    guard_factor: float
    """Guard band in standard uncertainties; 0 under simple acceptance."""
    judgements: tuple[Judgement, ...]
    probability: float
    """That the part keeps all tolerances, where it was measured: at least this (exact for a single one)."""

    @property
    def kept(self) -> bool:
        """Whether every tolerance is kept by what was measured and counts."""
        return all(j.verdict == "pass" for j in self.judgements)
