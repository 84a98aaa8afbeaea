"""The verdict on a change in words: what became of the RMS, whether it is real, and what is left of it."""

from __future__ import annotations

from cmm_align.model import Change
from cmm_align.units import UM_PER_MM

_WITHOUT = {
    "rigid motion": "rigid motion",
    "+ power": "rigid motion and power",
    "+ astigmatism": "rigid motion, power and astigmatism",
    "+ coma and trefoil": "rigid motion, power, astigmatism, coma and trefoil",
    "36 terms": "rigid motion and 36 terms",
}
"""What is missing from a rung, in words."""


def change_words(change: Change) -> tuple[str, ...]:
    """Return the verdict on a change, a sentence each.

    Parameters
    ----------
    change : Change
        Its own words are not looked at.
    """
    before, after = change.before.rms_mm * UM_PER_MM, change.after.rms_mm * UM_PER_MM
    head = f"RMS {_um(before)} -> {_um(after)} um"
    if not change.real:
        rung = change.rungs[min(1, len(change.rungs) - 1)]
        return (
            f"{head}; no change beyond the noise (the difference is {_um(rung.rms_um)} um RMS, "
            f"noise gives {_um(rung.expected_rms_um)})",
        )
    where = (
        f"significant on {_percent(change.share_changed)} of the area"
        if change.share_changed
        else ("no single place stands out, the whole does")
    )
    return (f"{head}; the change is real ({where})", *_outcome(change), _left(change))


def _outcome(change: Change) -> tuple[str, ...]:
    """Say whether it is better or worse, and where it is worse."""
    moved = f"RMS {change.rms_change_um:+.2g} um, u {change.u_rms_change_um:.2g}"
    sentences = []
    if change.worse_than_before:
        sentences.append(f"WORSE than before, outside the noise ({moved})")
    elif change.better_than_before:
        sentences.append(f"better than before, outside the noise ({moved})")
    else:
        sentences.append(f"neither better nor worse by RMS, within the noise ({moved})")
    if change.share_worse:
        sentences.append(
            f"farther from the nominal than before on {_percent(change.share_worse)} of the area"
        )
    return tuple(sentences)


def _left(change: Change) -> str:
    """Say what explains the difference: the first rung beyond which there is noise alone."""
    for rung in change.rungs[1:]:
        if rung.noise:
            text = (
                f"what is left of the difference without {_WITHOUT[rung.removed]} is noise "
                f"({_um(rung.rms_um)} um, expected {_um(rung.expected_rms_um)})"
            )
            if rung.removed == "rigid motion":
                text += ": the part lies otherwise, its form has not changed"
            return text
    last = change.rungs[-1]
    without = f"without {_WITHOUT[last.removed]} " if last.removed in _WITHOUT else ""
    return (
        f"{without}{_um(last.rms_um)} um of the difference are left, noise gives "
        f"{_um(last.expected_rms_um)}: it changed in shorter waves too"
    )


def _um(value: float) -> str:
    """Write a length in um with a sensible number of digits."""
    size = abs(value)
    return f"{value:.1f}" if size >= 10.0 else f"{value:.2f}" if size >= 1.0 else f"{value:.2g}"


def _percent(share: float) -> str:
    """Write a share; a small one is not nothing."""
    percent = 100.0 * share
    return f"{percent:.0f} %" if percent >= 1.0 else f"{percent:.1g} %"
