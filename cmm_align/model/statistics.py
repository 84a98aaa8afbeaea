"""Numbers of a set of deviations, and the outcome of a comparison with a tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


@dataclass(frozen=True, slots=True)
class Statistics:
    """Numbers of a set of deviations; the count stands beside them because PV grows with it."""

    n: int
    pv_mm: float
    rms_mm: float
    mean_mm: float
    min_mm: float
    max_mm: float
    min_at_mm: tuple[float, float]
    max_at_mm: tuple[float, float]

    @property
    def profile_mm(self) -> float:
        """Profile of a surface, ISO 1101: twice the largest absolute deviation, mm."""
        return 2.0 * max(abs(self.min_mm), abs(self.max_mm))


class Verdict(StrEnum):
    """Outcome of a comparison with a tolerance."""

    PASS = "pass"
    FAIL = "fail"
    UNDECIDED = "undecided"
    NONE = "none"
