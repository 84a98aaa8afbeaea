"""What is known of the share of a commanded change that reaches the part: from text to numbers and back."""

from __future__ import annotations

from typing import Final

from cmm_align.errors import UnitsError, UsageError
from cmm_align.model import ProcessTransfer
from cmm_align.units import parse_length_mm

FORM: Final = '"0.9", or by wavelength "0.95@30mm, 0.8@10mm, 0.4@3mm"'
LARGEST: Final = 2.0
"""A process that cuts more than twice what it is told is none."""


def process_transfer(text: str, u: float) -> ProcessTransfer:
    """Return the transfer that a text describes; 1 if it is empty.

    Parameters
    ----------
    text : str
        A share, or shares with their wavelengths; lengths without a unit are mm.
    u : float
        Standard uncertainty of the shares.

    Raises
    ------
    UsageError
        If the text is neither, or a share is not above 0 and at most 2.
    """
    if not text.strip():
        return ProcessTransfer((), (1.0,), u, known=False)
    entries = [entry.strip().partition("@") for entry in text.split(",")]
    try:
        shares = [float(share) for share, _, _ in entries]
        lengths = [parse_length_mm(length) for _, at, length in entries if at]
    except (ValueError, UnitsError):
        raise UsageError(f"transfer = {text!r}", expected=FORM) from None
    if len(lengths) != (len(shares) if len(shares) > 1 else len(lengths)) or len(set(lengths)) != len(
        lengths
    ):
        raise UsageError(f"transfer = {text!r}", expected=f"a wavelength for each share: {FORM}")
    if not all(0.0 < share <= LARGEST for share in shares) or not all(length > 0.0 for length in lengths):
        raise UsageError(f"transfer = {text!r}", expected=f"shares above 0, at most {LARGEST:g}")
    if len(lengths) < 2:
        return ProcessTransfer((), (shares[0],), u, known=True)
    pairs = sorted(zip(lengths, shares, strict=True))
    return ProcessTransfer(tuple(p[0] for p in pairs), tuple(p[1] for p in pairs), u, known=True)
