"""CODE V interferogram files (.INT) of heights on a grid, in and out.

``!`` comments, a title, ``GRD nx ny SUR WVL w SSZ s NDA n``, then whole numbers, the top row first; a height
is ``number * w / s`` micrometres. The format knows no lengths along x and y, so it cannot be a nominal.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from cmm_align.errors import MalformedInputError, UsageError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.source import Source
from cmm_align.model import PointSet
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

NO_DATA: Final = -32768
LARGEST: Final = 32767
TITLE: Final = 80
_A_LINE: Final = 10
_MOST_NODES: Final = 100_000_000


class CodeVGrid(NamedTuple):
    """Heights of an .INT file."""

    title: str
    content: str
    """SUR (surface), WFR (wavefront) or FIL (filter)."""
    z_mm: Array
    """Shape (ny, nx), mm (SUR and WFR), rows upwards, NaN where there are no data."""


def recognises(head: bytes) -> bool:
    """Return whether the second line that is no comment starts a grid."""
    lines = [line for line in head.decode("latin-1").splitlines() if not line.lstrip().startswith("!")]
    words = lines[1].split() if len(lines) > 1 else []
    return len(words) > 3 and words[0].upper() == "GRD" and words[1].isdigit() and words[2].isdigit()


def read(source: Source, units: str | None = None) -> PointSet:
    """Refuse the file as a nominal, and say why.

    Parameters
    ----------
    source : Source
    units : str, optional
        Not used: the heights are in micrometres.

    Raises
    ------
    MalformedInputError
        Always: heights without places are no points. Damage in the file is reported first.
    """
    del units
    grid = read_heights(source)
    ny, nx = grid.z_mm.shape
    raise MalformedInputError(
        f"a CODE V file of {nx} x {ny} heights without the distance of its points",
        where=source.where,
        expected="a nominal with x, y and z",
        remedy="export the surface as Zemax grid sag or as x, y, z text",
    )


def read_heights(source: Source) -> CodeVGrid:
    """Return the heights of a file.

    Raises
    ------
    MalformedInputError
        If the file is cut off or damaged.
    """
    lines = decoded(source.raw, source.where).split("\n")
    numbered = [(k, line) for k, line in enumerate(lines, 1) if not line.lstrip().startswith("!")]
    title = numbered[0][1].strip() if numbered else ""
    words = numbered[1][1].upper().split() if len(numbered) > 1 else []
    place = f"{source.where}:{numbered[1][0] if len(numbered) > 1 else 1}"
    try:
        nx, ny, content = int(words[1]), int(words[2]), words[3]
        wavelength_um = float(words[words.index("WVL") + 1])
        per_wave = float(words[words.index("SSZ") + 1])
        none = int(words[words.index("NDA") + 1]) if "NDA" in words else NO_DATA
        good = words[0] == "GRD" and 0 < nx * ny <= _MOST_NODES and per_wave != 0.0
    except (IndexError, ValueError):
        good = False
    if not good:
        raise MalformedInputError(
            f"{' '.join(words)[:60]!r}", where=place, expected="GRD nx ny SUR WVL w SSZ s [NDA n]"
        )
    values: list[int] = []
    for number, line in numbered[2:]:
        try:
            values += [int(field) for field in line.split()]
        except ValueError:
            raise MalformedInputError(
                f"{line.strip()[:60]!r}", where=f"{source.where}:{number}", expected="whole numbers"
            ) from None
    if len(values) != nx * ny:
        raise MalformedInputError(
            f"{len(values)} numbers", where=source.where, expected=f"{nx} x {ny} = {nx * ny}"
        )
    raw = np.array(values, dtype=np.float64).reshape(ny, nx)[::-1]
    z_mm = np.where(raw == none, np.nan, raw * wavelength_um / per_wave / UM_PER_MM)
    return CodeVGrid(title, content, z_mm)


def codev_int_text(z_mm: Array, title: str = "surface height") -> Iterator[bytes]:
    """Give an .INT file of a surface, row by row.

    Parameters
    ----------
    z_mm : ndarray, shape (ny, nx), mm
        Indexed [iy, ix], rows upwards; NaN becomes ``NDA``.
    title : str
        At most 80 characters of ASCII; more are cut off.

    Yields
    ------
    bytes
        ASCII. Heights are rounded to 1/32767 of the largest one.

    Raises
    ------
    UsageError
        If the heights are no grid.
    """
    if z_mm.ndim != 2 or z_mm.size == 0:
        raise UsageError(f"heights of shape {z_mm.shape}", expected="(ny, nx)")
    return _lines(z_mm, title)


def _lines(z_mm: Array, title: str) -> Iterator[bytes]:
    known = np.isfinite(z_mm)
    largest_um = float(np.abs(z_mm[known]).max(initial=0.0)) * UM_PER_MM
    per_um = float(f"{LARGEST / largest_um:.9g}") if largest_um > 0.0 else 1.0
    ny, nx = z_mm.shape
    plain = title.encode("ascii", "replace").decode("ascii").replace("\n", " ")[:TITLE].strip() or "-"
    yield f"{plain.lstrip('!') or '-'}\nGRD {nx} {ny} SUR WVL 1.0 SSZ {per_um!r} NDA {NO_DATA}\n".encode(
        "ascii"
    )
    counts = np.full(z_mm.shape, NO_DATA)
    counts[known] = np.clip(np.rint(z_mm[known] * (UM_PER_MM * per_um)), -LARGEST, LARGEST).astype(np.int64)
    for row in counts[::-1].tolist():
        for start in range(0, nx, _A_LINE):
            yield (" ".join(map(str, row[start : start + _A_LINE])) + "\n").encode("ascii")
