"""Zemax OpticStudio grid sag files (.DAT), in and out.

First line ``nx ny delx dely unitflag xdec ydec``, then nx * ny lines ``z dz/dx dz/dy d2z/dxdy [nodata]``, the
upper left corner (-x, +y) first, along x fastest, rows downwards. Zygo's .dat is a binary file of the same
name; its first bytes tell it apart.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

import numpy as np

from cmm_align.errors import MalformedInputError, UsageError
from cmm_align.formats.decoding import decoded
from cmm_align.formats.fixed_decimals import Field, lines_of
from cmm_align.formats.source import Source, scale_to_mm
from cmm_align.model import PointKind, PointSet
from cmm_align.surfaces.grid import GridPoints, grid_surface
from cmm_align.surfaces.protocol import Array, Mask

UNIT_OF_FLAG: Final = ("mm", "cm", "inch", "m")
FEWEST: Final = 5
"""Points along an axis that the format asks for."""

_ZYGO: Final = (b"\x88\x1b\x03\x6f", b"\x88\x1b\x03\x70", b"\x88\x1b\x03\x71")
_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?"
_FIRST: Final = re.compile(
    rf"\s*(\d+)\s+(\d+)\s+({_NUMBER})\s+({_NUMBER})\s+([0-3])\s+({_NUMBER})\s+({_NUMBER})\s*"
)
_CONTRADICTION: Final = 0.3
"""Slopes that differ from those of the heights by this share (RMS) belong to another surface."""
_MOST_NODES: Final = 100_000_000
_HEIGHT_ONLY: Final = (Field(0, 9), b" 0 0 0 ", Field(1, 0), b"\n")


def recognises(head: bytes) -> bool:
    """Return whether the first line is that of a grid sag file, or the file is Zygo's namesake."""
    if head.startswith(_ZYGO):
        return True
    lines = [line for line in head.decode("latin-1").splitlines() if not _is_passed_over(line)]
    return len(lines) > 1 and bool(_FIRST.fullmatch(lines[0])) and len(lines[1].split()) in {4, 5}


def _is_passed_over(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("!")


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the points of a grid sag file, frame `part`; those marked ``nodata`` are left out.

    Parameters
    ----------
    source : Source
    units : str, optional
        Unit the user gave; must not differ from the one in the file.

    Raises
    ------
    MalformedInputError
        If the file is cut off or damaged, or its slopes contradict its heights.
    UnitsError
        If the file states another unit than `units`.

    Notes
    -----
    Only the heights make the nominal; the slopes, where they are not all zero, are a check on the order of
    the rows. Heights come back to the last printed digit.
    """
    if source.head.startswith(_ZYGO):
        raise MalformedInputError(
            "a binary file of a Zygo interferometer: form errors, not the shape of a part",
            where=source.where,
            expected="a nominal; Zemax grid sag is a text file of the same suffix",
        )
    lines = [
        (k, line)
        for k, line in enumerate(decoded(source.raw, source.where).split("\n"), 1)
        if not _is_passed_over(line)
    ]
    first = _FIRST.fullmatch(lines[0][1])
    if first is None:
        raise MalformedInputError(
            "not the first line of a grid sag file",
            where=f"{source.where}:{lines[0][0]}",
            expected="nx ny delx dely unitflag xdec ydec",
        )
    nx, ny = int(first[1]), int(first[2])
    scale = scale_to_mm(UNIT_OF_FLAG[int(first[5])], units, source.where)
    dx, dy, x0, y0 = (float(first[k].lower().replace("d", "e")) * scale for k in (3, 4, 6, 7))
    dx, dy = abs(dx), abs(dy)
    if min(nx, ny) < FEWEST or min(dx, dy) == 0.0 or nx * ny > _MOST_NODES:
        raise MalformedInputError(
            f"{nx} x {ny} points, {dx:g} x {dy:g} mm apart",
            where=f"{source.where}:{lines[0][0]}",
            expected=f"at least {FEWEST} x {FEWEST}, apart",
        )
    if len(lines) - 1 != nx * ny:
        raise MalformedInputError(
            f"{len(lines) - 1} points", where=source.where, expected=f"{nx} x {ny} = {nx * ny} points"
        )
    table = _table(lines[1:], source.where).reshape(ny, nx, 5)[::-1]  # rows upwards from here on
    z, known = table[..., 0] * scale, table[..., 4] == 0.0
    x = x0 + dx * (np.arange(nx) - 0.5 * (nx - 1))
    y = y0 + dy * (np.arange(ny) - 0.5 * (ny - 1))
    _check_slopes(z, known, table[..., 1], table[..., 2], (dx, dy), source.where)
    px, py = np.meshgrid(x, y)
    points = np.stack([px[known], py[known], z[known]], axis=1)
    return PointSet.of(points, kind=PointKind.NOMINAL, frame="part", source=source.where)


def _table(lines: list[tuple[int, str]], where: str) -> Array:
    """Return the five numbers of every line, the last one 0 where it is left out."""
    try:
        table = np.loadtxt([line for _, line in lines], ndmin=2, comments=None)
    except ValueError:
        table = np.zeros((0, 0))  # line by line, then: lengths that differ, powers with d, a mistake
    if table.shape == (len(lines), 5) and np.isfinite(table).all():
        return table
    table = np.zeros((len(lines), 5))
    for row, (number, line) in enumerate(lines):
        fields = line.split()
        try:
            values = [float(field.replace("d", "e").replace("D", "e")) for field in fields]
        except ValueError:
            values = []
        if len(values) not in {4, 5} or not np.isfinite(values).all():
            raise MalformedInputError(
                f"{line.strip()[:60]!r}",
                where=f"{where}:{number}",
                expected="z dz/dx dz/dy d2z/dxdy [nodata]",
            )
        table[row, : len(values)] = values
    return table


def _check_slopes(z: Array, known: Mask, zx: Array, zy: Array, step: tuple[float, float], where: str) -> None:
    """Compare the slopes of the file with those of a spline through its heights."""
    stated = np.stack([zx[known], zy[known]])
    size = float(np.sqrt(np.mean(stated**2))) if stated.size else 0.0
    if size == 0.0:
        return  # none stated: the reader of the format finds them itself
    none = np.zeros_like(z)
    grid = GridPoints(0.0, 0.0, step[0], step[1], np.where(known, z, np.nan), none, none)
    surface, _ = grid_surface(grid, 3)
    iy, ix = np.nonzero(known)
    jet = surface.jet(ix.astype(np.float64) * step[0], iy.astype(np.float64) * step[1])

    def away(sign_x: float, sign_y: float) -> float:
        rest = np.stack([sign_x * stated[0] - jet.zx, sign_y * stated[1] - jet.zy])
        return float(np.sqrt(np.mean(rest**2))) / size

    if away(1.0, 1.0) <= _CONTRADICTION:
        return
    causes = {"rows": away(1.0, -1.0), "columns": away(-1.0, 1.0), "rows and columns": away(-1.0, -1.0)}
    cause = min(causes, key=lambda name: causes[name])
    guess = f": the {cause} look reversed" if causes[cause] <= _CONTRADICTION else ""
    raise MalformedInputError(
        f"dz/dx and dz/dy contradict the heights by {100.0 * away(1.0, 1.0):.0f} %{guess}",
        where=where,
        expected="upper left corner first, rows downwards, slopes per unit of length",
        remedy="export the file again, or set the slopes to zero if the heights are right",
    )


def zemax_grid_sag_text(
    x_mm: Array, y_mm: Array, z_mm: Array, derivatives: tuple[Array, Array, Array] | None = None
) -> Iterator[bytes]:
    """Give a grid sag file in mm, row by row.

    Parameters
    ----------
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm
        Ascending, equal steps, at least five each.
    z_mm : ndarray, shape (ny, nx), mm
        Indexed [iy, ix]; NaN becomes ``nodata``.
    derivatives : tuple of ndarray, each of shape (ny, nx), optional
        dz/dx, dz/dy and d2z/dxdy (1/mm). Zeros without: the reader then finds them itself.

    Yields
    ------
    bytes
        ASCII; heights with 9 decimals (0.001 nm).

    Raises
    ------
    UsageError
        If the grid is none that the format can hold.
    """
    nx, ny = len(x_mm), len(y_mm)
    dx, dy = (float(a[-1] - a[0]) / max(len(a) - 1, 1) for a in (x_mm, y_mm))
    even = all(
        d > 0.0 and float(np.abs(np.diff(a) - d).max(initial=0.0)) <= 1e-6 * d
        for a, d in ((x_mm, dx), (y_mm, dy))
    )
    if min(nx, ny) < FEWEST or z_mm.shape != (ny, nx) or not even:
        raise UsageError(
            f"a grid of {nx} x {ny} points with heights of shape {z_mm.shape}",
            expected=f"at least {FEWEST} x {FEWEST} points at equal steps, heights (ny, nx)",
        )
    return _lines(x_mm, y_mm, (dx, dy), z_mm, derivatives)


def _lines(
    x_mm: Array, y_mm: Array, step: tuple[float, float], z_mm: Array, parts: tuple[Array, Array, Array] | None
) -> Iterator[bytes]:
    x0, y0 = 0.5 * float(x_mm[0] + x_mm[-1]), 0.5 * float(y_mm[0] + y_mm[-1])
    yield f"{len(x_mm)} {len(y_mm)} {step[0]:.12g} {step[1]:.12g} 0 {x0:.12g} {y0:.12g}\n".encode("ascii")
    for j in range(len(y_mm) - 1, -1, -1):
        known = np.isfinite(z_mm[j])
        if parts is None:
            height = np.where(known, z_mm[j], 0.0)
            yield from lines_of(_HEIGHT_ONLY, [height, (~known).astype(np.float64)])
            continue
        row = np.stack([z_mm[j], *(part[j] for part in parts)], axis=1)
        row = np.where(known[:, None] & np.isfinite(row), row, 0.0) + 0.0
        text = "%.9f %.12g %.12g %.12g %d\n" * len(row)
        values = np.concatenate([row, ~known[:, None]], axis=1).ravel()
        yield (text % tuple(values.tolist())).encode("ascii")
