"""Every error a user can meet: one class per cause, each with its exit code.

An error is one line: what happened, where, what was expected, what to do. The exit codes are a
contract with scripts (see the table in the README): 2 usage, 3 input, 4 numerics, 7 device, 8 output.
"""

from __future__ import annotations


class CmmAlignError(Exception):
    """Root of all errors that a user can cause or meet.

    Parameters
    ----------
    what : str
        What happened, in one clause.
    where : str
        ``file:line:column`` or ``file:/dataset``; empty if there is no place to name.
    expected : str
        What would have been right.
    remedy : str
        What the user can do now.
    """

    exit_code = 1

    def __init__(self, what: str, *, where: str = "", expected: str = "", remedy: str = "") -> None:
        self.what = what
        self.where = where
        self.expected = expected
        self.remedy = remedy
        super().__init__(self.one_line())

    def one_line(self) -> str:
        """Return the message as one line without line breaks."""
        parts = [f"{self.where}: {self.what}" if self.where else self.what]
        if self.expected:
            parts.append(f"expected {self.expected}")
        if self.remedy:
            parts.append(self.remedy)
        return "; ".join(" ".join(part.split()) for part in parts)


class UsageError(CmmAlignError):
    """The command line or a configuration key is wrong."""

    exit_code = 2


class InputError(CmmAlignError):
    """An input cannot be used as it is."""

    exit_code = 3


class MissingFileError(InputError):
    """An input file does not exist or cannot be opened."""


class MalformedInputError(InputError):
    """An input file breaks the rules of its format."""


class UnitsError(InputError):
    """Lengths look as if they were in another unit."""


class WrongStageError(InputError):
    """A file belongs to another stage, or a stage would be applied twice."""


class GeometryError(InputError):
    """Points or a nominal cannot carry the computation: too few, collinear, no height field."""


class NumericsError(CmmAlignError):
    """No fit is possible, or it did not converge."""

    exit_code = 4


class GateError(CmmAlignError):
    """A file would not make the part better: it is not written."""

    exit_code = 5


class DeviceError(CmmAlignError):
    """A port or the device behind it failed."""

    exit_code = 7


class OutputError(CmmAlignError):
    """An output cannot be written."""

    exit_code = 8


class OutputExistsError(OutputError):
    """The output is there already and overwriting was not asked for."""


class OutputLockedError(OutputError):
    """Another run is writing the same output."""
