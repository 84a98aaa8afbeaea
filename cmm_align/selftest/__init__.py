"""Proof on the user's own machine: cases whose answer is known beforehand, measured with the installed code.

Each file holds one kind of case and says where its answer comes from. `checks` lists them all; every check
gives the largest error it found beside what the software states of itself: 1 nm and 1e-9 rad. The cases walk
through the same doors as a user's data (`offset`, `align`, the replay of a port), not through test doubles.

Sources: M. G. Cox, A. B. Forbes and others (NPL), data from the null space of the Jacobian; EMPIR 15SIB01,
minimum-zone data from multipliers.
"""

from __future__ import annotations

from cmm_align.selftest.checks import CHECKS, MPE_NM, MPE_RAD, Check, Finding, run

__all__ = ["CHECKS", "MPE_NM", "MPE_RAD", "Check", "Finding", "run"]
