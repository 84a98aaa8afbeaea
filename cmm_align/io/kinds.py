"""What an existing file is, before it is replaced: ours, or somebody else's work.

The suffix of an output says what will be written to it. A stage file replaces only a stage file, a picture
only a picture, a page only a page of ours, points only points that carry our header; an empty file may
always be replaced.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from cmm_align.errors import InputError, OutputError, OutputExistsError

HDF5_SUFFIXES: Final = (".h5", ".hdf5")
"""Of the files that stages write."""

POST_STEM: Final = ".post"
"""What the stem of a file ends in whose format a user has described: any text."""

_POINTS: Final = ((b"# cmm-align points ", b"# cmm-align map "), "a points file of cmm-align")
_TABLE: Final = ((*_POINTS[0], b"step,phase,movement_mm,"), "a points file or iteration log of cmm-align")
_STARTS: Final[dict[str, tuple[bytes | tuple[bytes, ...], str]]] = {
    ".png": (b"\x89PNG\r\n\x1a\n", "a PNG picture"),
    ".pdf": (b"%PDF-", "a PDF"),
    ".mat": (b"MATLAB 5.0 MAT-file, cmm-align ", "a dwell grid of cmm-align"),
    ".x3p": (b"PK\x03\x04", "an X3P file"),
    ".xyz": _POINTS,
    ".csv": _TABLE,
    ".txt": _POINTS,
}
"""What a file of a suffix starts with, and what it is called."""
_HOLDS: Final = {
    ".svg": (b"<svg", "an SVG picture"),
    ".json": (b'"schema": "cmm-align/selftest"', "a certificate of cmm-align"),
    ".html": (b'<meta name="generator" content="cmm-align', "a page of cmm-align"),
}
"""What the head of a file of a suffix holds, and what it is called."""
_METROPRO: Final = (b"\x88\x1b\x03", slice(246, 255), b"cmm-align")
"""First bytes, and where our name stands."""
_HEAD_BYTES: Final = 4096
_SCHEMAS: Final = "cmm-align/"


def refuse_another_kind(target: Path, where: str) -> None:
    """Refuse to replace a file that is not of the kind its suffix stands for.

    Parameters
    ----------
    target : Path
        A file that is there.
    where : str
        Its name as the user wrote it.

    Raises
    ------
    OutputExistsError
        If it is of another kind.
    OutputError
        If it cannot be looked into.
    """
    try:
        with target.open("rb") as stream:
            head = stream.read(_HEAD_BYTES)
    except OSError as error:
        raise OutputError(f"cannot look into it ({error.strerror})", where=where) from None
    if not head:
        return
    good, kind = _as_expected(target, head)
    if not good:
        raise OutputExistsError(
            f"it exists and is not {kind}", where=where, remedy="choose another name: it is not replaced"
        )


def _as_expected(target: Path, head: bytes) -> tuple[bool, str]:
    """Return whether a file is of the kind its suffix stands for, and what that kind is called."""
    suffix = target.suffix.lower()
    if suffix in HDF5_SUFFIXES:
        return _is_stage_file(target), "a file of cmm-align"
    if suffix in _HOLDS:
        mark, kind = _HOLDS[suffix]
        return mark in head, kind
    if suffix in _STARTS and not target.stem.endswith(POST_STEM):
        start, kind = _STARTS[suffix]
        return head.startswith(start), kind
    start, place, name = _METROPRO
    if head.startswith(start):
        return head[place] == name, "a MetroPro file of cmm-align"
    return b"\0" not in head, "a text file"


def _is_stage_file(target: Path) -> bool:
    """Return whether a file is HDF5 with a schema of ours, complete or not."""
    from cmm_align.io.safe_hdf5 import opened

    try:
        with opened(target) as file:
            return str(file.attrs.get("schema", "")).startswith(_SCHEMAS)
    except InputError:
        return False
