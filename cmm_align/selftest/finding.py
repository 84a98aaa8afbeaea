"""What a check found, and the errors that the software states of itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MPE_NM: Final = 1.0
"""Largest error of a length that the software states of itself on the cases of the self-test, nm."""
MPE_RAD: Final = 1e-9
"""The same of an angle, rad."""

_LIMITS: Final = {"nm": MPE_NM, "rad": MPE_RAD, "points": 0.0}


@dataclass(frozen=True, slots=True)
class Finding:
    """One number that was compared with its known value.

    Attributes
    ----------
    what : str
        The number, in words.
    error : float
        Largest absolute error found.
    unit : str
        nm, rad, or points (wrong or missing ones).
    n : int
        How many values were compared.
    """

    what: str
    error: float
    unit: str
    n: int

    @property
    def limit(self) -> float:
        """The stated error in the same unit."""
        return _LIMITS[self.unit]

    @property
    def passed(self) -> bool:
        """Whether the error is a number within the limit."""
        return bool(self.error <= self.limit)
