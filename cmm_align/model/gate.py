"""What the gate found: each exported file, read back, ground and measured again on paper."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GateCheck:
    """One question to an exported file.

    Attributes
    ----------
    name : str
        coverage, frame, sign, Z against normal, rounding, ripple, normals, band, RMS, gouge or air cut.
    passed : bool
    value : float or None
        What was found; None where it could not be.
    limit : float or None
        What is allowed.
    unit : str
        Of both; empty for pure numbers.
    words : str
        The same as a sentence.
    """

    name: str
    passed: bool
    value: float | None
    limit: float | None
    unit: str
    words: str


@dataclass(frozen=True, slots=True)
class GatedExport:
    """What the gate found in one file.

    Attributes
    ----------
    kind : str
        Of the export, as ``gcode-raster``.
    n : int
        Points in it.
    checks : tuple of GateCheck
    rms_before_mm, pv_before_mm : float
        Of the measured points now.
    rms_mm, pv_mm : float or None
        Of the same points after an ideal machine has ground this file; None where that cannot be told.
    accuracy_mm : float
        How well the surface is known from the file.
    looks_like : str
        The mistake that explains it best; empty if nothing is wrong.
    """

    kind: str
    n: int
    checks: tuple[GateCheck, ...]
    rms_before_mm: float
    pv_before_mm: float
    rms_mm: float | None
    pv_mm: float | None
    accuracy_mm: float
    looks_like: str = ""

    @property
    def passed(self) -> bool:
        """Return whether every check was passed."""
        return all(check.passed for check in self.checks)


@dataclass(frozen=True, slots=True)
class GateReport:
    """All files of a compensation.

    Attributes
    ----------
    skipped : bool
        The user asked for no gate: nothing was checked.
    exports : tuple of GatedExport
    """

    skipped: bool
    exports: tuple[GatedExport, ...] = ()
