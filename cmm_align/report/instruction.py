"""The one thing to do next with a part: for its operator, who reads one line.

The first rule that holds decides: a map that does not know the part, outliers that alone keep the verdict
open, an open verdict, a part within
tolerance, a part out of it for one cause that a setting removes, a part out of it, no tolerance at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from cmm_align.model import DeviationMap, Verdict
from cmm_align.model.root_causes import CANNOT_TELL, Cause
from cmm_align.report.page_section import shown
from cmm_align.report.wording import as_percent, calm

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
        return _undecided(m)
    if m.verdict == Verdict.PASS:
        return Instruction("Clean and ship", "", "The part is within tolerance.")
    cause = None if m.root_causes is None else m.root_causes.dominant
    if m.verdict == Verdict.FAIL and cause is not None:
        return Instruction(_first(cause), "", f"{shown(cause.words)}.")
    if m.verdict == Verdict.FAIL:
        return Instruction("Compensate, then grind", command, "The part is out of tolerance.")
    return Instruction("Ask for the tolerance", "", "No tolerance was given, so nothing was judged.")


def _undecided(m: DeviationMap) -> Instruction:
    """Return what to do with a part whose verdict is open."""
    if m.conformance is not None and m.conformance.kept:
        return Instruction(
            "Clean, then measure again",
            "",
            "Points left out as outliers break the tolerance: dirt, or a fault of the part.",
        )
    return Instruction(
        "Measure again, with more points",
        "",
        "The tolerance lies inside the uncertainty: the part is neither good nor bad.",
    )


def _first(cause: Cause) -> str:
    """Return what to put right before anything is compensated: a setting with its value, or what to do."""
    if not cause.remedy.startswith("set that"):
        return cause.remedy.partition(",")[0].capitalize()
    if any(member.times_less_likely <= CANNOT_TELL for member in cause.alternatives):
        return f"Check {cause.name} first"  # the data cannot tell it from another: no number to key in
    size = calm(abs(cause.value)) if abs(cause.value) < 1.0 else f"{abs(cause.value):.3g}"
    sign = "+" if cause.value > 0.0 else "\N{MINUS SIGN}"
    return f"Change {cause.name} by {sign}{size} {shown(cause.unit)} first"
