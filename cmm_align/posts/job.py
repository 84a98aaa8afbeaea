"""What every post is given."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from cmm_align.config import ExportConfig
from cmm_align.errors import UsageError
from cmm_align.model import Correction
from cmm_align.numerics.wheel import Wheel

_FRAME: Final = re.compile(rb"frame of the (\w+)", re.IGNORECASE)
_HEAD_BYTES: Final = 1000


@dataclass(frozen=True, slots=True)
class ExportJob:
    """A correction and how it is to be written.

    Attributes
    ----------
    correction : Correction
    config : ExportConfig
    decimals : int
        Of coordinates in mm, at least six.
    wheel : Wheel or None
        Axis in frame `frame`.
    name : str
        Name of the part.
    """

    correction: Correction
    config: ExportConfig
    decimals: int = 6
    wheel: Wheel | None = None
    name: str = "PART"

    @property
    def frame(self) -> str:
        """Return the frame of what is written: part, or grinder where the part was touched there."""
        return self.correction.nominal.surface_from_part.source

    def known_wheel(self, purpose: str) -> Wheel:
        """Return the wheel.

        Raises
        ------
        UsageError
            If it is not known.
        """
        if self.wheel is None:
            raise UsageError(f"{purpose} needs the wheel", remedy="give --wheel-radius")
        return self.wheel

    def program_name(self, most: int = 24) -> str:
        """Return the name as controls take it: letters, digits and underscores, upper case."""
        plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in self.name.upper())
        return plain.strip("_")[:most] or "PART"


def frame_in(raw: bytes) -> str:
    """Return the frame that the head of a program states, as ``frame of the grinder``; part without one."""
    found = _FRAME.search(raw, 0, _HEAD_BYTES)
    return "part" if found is None else found[1].decode("ascii", "replace").lower()
