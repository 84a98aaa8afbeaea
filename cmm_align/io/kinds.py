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

_PNG_SUFFIX: Final = ".png"
_SVG_SUFFIX: Final = ".svg"
_POINTS_SUFFIXES: Final = (".xyz", ".csv", ".txt")
_PNG: Final = b"\x89PNG\r\n\x1a\n"
_SVG: Final = b"<svg"
_PDF: Final = b"%PDF-"
_PAGE: Final = b'<meta name="generator" content="cmm-align'
_DWELL: Final = b"MATLAB 5.0 MAT-file, cmm-align "
_POINTS: Final = b"# cmm-align points "
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
    suffix = target.suffix.lower()
    if not head:
        return
    if suffix in HDF5_SUFFIXES:
        good, kind = _is_stage_file(target), "a file of cmm-align"
    elif suffix == _PNG_SUFFIX:
        good, kind = head.startswith(_PNG), "a PNG picture"
    elif suffix == _SVG_SUFFIX:
        good, kind = _SVG in head, "an SVG picture"
    elif suffix == ".pdf":
        good, kind = head.startswith(_PDF), "a PDF"
    elif suffix == ".html":
        good, kind = _PAGE in head, "a page of cmm-align"
    elif suffix in _POINTS_SUFFIXES and not target.stem.endswith(POST_STEM):
        good, kind = head.startswith(_POINTS), "a points file of cmm-align"
    elif suffix == ".mat":
        good, kind = head.startswith(_DWELL), "a dwell grid of cmm-align"
    else:
        good, kind = b"\0" not in head, "a text file"
    if not good:
        raise OutputExistsError(
            f"it exists and is not {kind}", where=where, remedy="choose another name: it is not replaced"
        )


def _is_stage_file(target: Path) -> bool:
    """Return whether a file is HDF5 with a schema of ours, complete or not."""
    from cmm_align.io.safe_hdf5 import opened

    try:
        with opened(target) as file:
            return str(file.attrs.get("schema", "")).startswith(_SCHEMAS)
    except InputError:
        return False
