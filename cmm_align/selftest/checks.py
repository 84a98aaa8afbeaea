"""The list of checks, and how they are run: a check that fails does not stop the others."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from cmm_align.selftest.caps import radius_errors
from cmm_align.selftest.closed_forms import closed_form_distances
from cmm_align.selftest.finding import MPE_NM, MPE_RAD, Finding
from cmm_align.selftest.null_space import least_squares, minimum_zone
from cmm_align.selftest.port import replayed
from cmm_align.selftest.two_paths import both_paths

__all__ = ["CHECKS", "MPE_NM", "MPE_RAD", "Check", "Finding", "run"]


class _Case(NamedTuple):
    """A check by its name."""

    name: str
    measure: Callable[[], list[Finding]]


@dataclass(frozen=True, slots=True)
class Check:
    """What came of one check.

    Attributes
    ----------
    name : str
    findings : tuple of Finding
        Empty where it did not run to its end.
    seconds : float
    trouble : str
        What stopped it; empty if nothing did.
    """

    name: str
    findings: tuple[Finding, ...]
    seconds: float
    trouble: str = ""

    @property
    def passed(self) -> bool:
        """Whether it ran and every finding is within the stated error."""
        return not self.trouble and all(finding.passed for finding in self.findings)

    def largest(self, unit: str) -> float | None:
        """Return the largest error in a unit (NaN counts as largest); None if nothing was compared in it."""
        errors = [finding.error for finding in self.findings if finding.unit == unit]
        if any(math.isnan(error) for error in errors):
            return math.nan
        return max(errors, default=None)


CHECKS: Final = (
    _Case("closed-form distances", closed_form_distances),
    _Case("null-space data, least squares", least_squares),
    _Case("multiplier data, minimum zone", minimum_zone),
    _Case("radius error on caps", radius_errors),
    _Case("two paths to a deviation", both_paths),
    _Case("replay of a serial port", replayed),
)
"""All checks, the simplest first."""


def run() -> Iterator[Check]:
    """Run all checks, one after the other.

    Yields
    ------
    Check
        As each ends. An exception of any kind is a check that did not pass, with its text.
    """
    for case in CHECKS:
        begun = time.perf_counter()
        try:
            findings, trouble = tuple(case.measure()), ""
        except Exception as error:
            findings, trouble = (), f"{type(error).__name__}: {' '.join(str(error).split())}"
        yield Check(case.name, findings, time.perf_counter() - begun, trouble)
