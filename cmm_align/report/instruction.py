"""The one thing to do next with a part: for its operator, who reads one line.

The first rule that holds decides: a map that does not know the part, an open verdict, a part within
tolerance, a part out of it, no tolerance at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from cmm_align.model import DeviationMap, Verdict
from cmm_align.report.wording import as_percent

ENOUGH_COVERAGE: Final = 0.9
"""With less of the part known, it is measured again before anything else is done to it."""


@dataclass(frozen=True, slots=True)
class Instruction:
    """What to do next.

    Attributes
    ----------
    order : str
        The instruction itself, a few words.
    command : str
        What to type for it; empty where nothing is typed.
    why : str
        One sentence.
    """

    order: str
    command: str
    why: str


def instruction(deviation_map: DeviationMap, command: str) -> Instruction:
    """Return what to do with the part of a map.

    Parameters
    ----------
    deviation_map : DeviationMap
    command : str
        What to type to compensate this map.
    """
    m = deviation_map
    if math.isfinite(m.coverage) and m.coverage < ENOUGH_COVERAGE:
        whole = m.alignment.report.report_region.removeprefix("the ") or "part"
        return Instruction(
            "Measure the rest", "", f"The map knows {as_percent(m.coverage)} of the {whole} only."
        )
    if m.verdict == Verdict.UNDECIDED:
        return Instruction(
            "Measure again, with more points",
            "",
            "The tolerance lies inside the uncertainty: the part is neither good nor bad.",
        )
    if m.verdict == Verdict.PASS:
        return Instruction("Clean and ship", "", "The part is within tolerance.")
    if m.verdict == Verdict.FAIL:
        return Instruction("Compensate, then grind", command, "The part is out of tolerance.")
    return Instruction("Ask for the tolerance", "", "No tolerance was given, so nothing was judged.")
