"""What an input is taken for, found out before anything is computed, so that the real mistake is named."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from cmm_align.cli.job import typed
from cmm_align.errors import InputError, MalformedInputError, MissingFileError, WrongStageError

POINTS: Final = "a file of points"
NOMINAL: Final = "a nominal: points, a mesh, a prescription, or what `offset` wrote"
ANY: Final = "a file that one of the commands reads or writes"

_HEAD_BYTES: Final = 16
_STRANGERS: Final = (
    (b"\x89PNG", "a picture"),
    (b"\xff\xd8\xff", "a picture"),
    (b"GIF8", "a picture"),
    (b"II*\0", "a picture"),
    (b"MM\0*", "a picture"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive or an office document"),
)
"""First bytes of files that people mistake for data, and what to call them."""


def check_kind(path: Path, expected: str) -> None:
    """Refuse a folder, a missing file, and what can be no data at all.

    Parameters
    ----------
    path : Path
    expected : str
        What the file should have been, in words.

    Raises
    ------
    MissingFileError
        If it is a folder, or cannot be opened.
    MalformedInputError
        If it is a picture, a document or an archive.
    """
    if path.is_dir():
        raise MissingFileError("is a folder", where=str(path), expected=expected)
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD_BYTES)
    except OSError as error:
        raise MissingFileError(f"cannot read it ({error.strerror})", where=str(path)) from None
    for magic, name in _STRANGERS:
        if head.startswith(magic):
            raise MalformedInputError(f"is {name}", where=str(path), expected=expected)


def check_stage(path: Path, wanted: str, taker: str, units: str | None = None) -> None:
    """Refuse a file that `taker` does not take, and say which step is missing.

    Parameters
    ----------
    path : Path
    wanted : str
        Schema of the files that it takes.
    taker : str
        The command that is running.
    units : str, optional
        Unit of length where the file states none.

    Raises
    ------
    WrongStageError
        If the file is of another stage, or points.
    InputError
        If it cannot be opened at all.
    """
    from cmm_align import files, io
    from cmm_align.io.schema import NOMINAL as NOMINAL_SCHEMA
    from cmm_align.io.schema import STAGES
    from cmm_align.model import PointKind, PointSet

    maker = STAGES[wanted].maker
    expected = f"what `{maker}` wrote"
    check_kind(path, expected)
    with path.open("rb") as stream:
        ours = stream.read(len(io.MAGIC)) == io.MAGIC and io.schema_of(path) is not None
    if ours:
        if io.schema_of(path) == NOMINAL_SCHEMA:
            raise WrongStageError(
                "it is a nominal",
                where=str(path),
                expected=f"{expected}, which is what {taker} takes",
                remedy=f"run {typed('cmm-align', 'align', 'MEASURED', path)} first",
            )
        return
    try:
        found = files.read(path, units)
    except InputError:
        return  # the reader of the stage says what is wrong with it
    if not isinstance(found, PointSet) or found.kind is PointKind.NOMINAL:
        raise WrongStageError(
            "it is a nominal",
            where=str(path),
            expected=f"{expected}, which is what {taker} takes",
            remedy=f"run {typed('cmm-align', 'offset', path, '--tip-radius', 'R')} first, then align",
        )
    if found.kind is PointKind.COMMANDED:
        whole = path.with_suffix(".h5")
        name = str(whole) if whole.exists() else "the .h5 file beside it"
        raise WrongStageError(
            "it is the text of a correction, for the machine", where=str(path), remedy=f"give {name}"
        )
    raise WrongStageError(
        "it is a point file",
        where=str(path),
        expected=expected,
        remedy=f"run {typed('cmm-align', 'align', path, 'NOMINAL')} first",
    )
