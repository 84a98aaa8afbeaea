"""G-code with the path of the tool's centre, as a raster or a spiral: G21 G90 G94, frame `part` or `grinder`.

A stroke starts with a G1 that repeats the feed; its other points are lines of coordinates alone. Where the
tool is lifted it goes along the direction of projection to a height above the highest point of the path, at
rapid. Lines stay below 80 characters and carry no numbers, which no control needs. Tool, spindle and work
offset are the machine's own and are left to the user.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import MalformedInputError
from cmm_align.formats.fixed_decimals import Field, Piece, lines_of
from cmm_align.numerics.wheel import Wheel, centre_from_contact
from cmm_align.posts.commanded import CommandedPoints
from cmm_align.posts.contacts import contacts
from cmm_align.posts.job import ExportJob, frame_in
from cmm_align.posts.limits import check_lines
from cmm_align.posts.numbers import Lines, table_of
from cmm_align.posts.rounding import rounding_mm
from cmm_align.posts.tool_path import ToolPath, raster, spiral

_CUT = b"G1 X"
_RAPID = b"G0 X"
_WHOLE = re.compile(rb"%\n(?:\([^\n]*\)\n)*G21 G90 G94\n")


def raster_blocks(job: ExportJob) -> Iterator[bytes]:
    """Give the program of a raster."""
    return _blocks(job, raster(job.correction, job.config, job.wheel), "raster")


def spiral_blocks(job: ExportJob) -> Iterator[bytes]:
    """Give the program of a spiral."""
    return _blocks(job, spiral(job.correction, job.config, job.wheel), "spiral")


def _blocks(job: ExportJob, path: ToolPath, kind: str) -> Iterator[bytes]:
    """Give a program.

    Raises
    ------
    UsageError
        If there is no wheel, or more lines than the control takes.
    """
    wheel = job.known_wheel("G-code")
    centres = path.points_mm + centre_from_contact(wheel, path.normals)
    check_lines(len(centres) + 2 * int(path.lifted.sum()) + 9, job.config)
    safe = float((centres @ path.up).max()) + job.config.safe_height_mm
    columns = list(np.ascontiguousarray(centres.T))
    xyz: list[Piece] = []
    for k, axis in enumerate((b"X", b" Y", b" Z")):
        xyz += [axis, Field(k, job.decimals)]
    feed = f" F{job.config.feed_mm_min:.10g}\n".encode("ascii")

    def move(code: bytes, k: int, end: bytes) -> bytes:
        at = centres[k] if code == b"G1 " else centres[k] + (safe - centres[k] @ path.up) * path.up
        return b"".join(lines_of([code, *xyz, end], list(at[:, None])))

    yield (
        f"%\n({job.program_name()})\n"
        f"(CMM-ALIGN: TOOL CENTRES, {kind.upper()}, FRAME OF THE {job.frame.upper()})\n"
        f"({wheel.words.upper().replace('(', '').replace(')', '')})\nG21 G90 G94\n"
    ).encode("ascii")
    bounds = [*path.starts.tolist(), len(centres)]
    for k, (first, end) in enumerate(pairwise(bounds)):
        if path.lifted[k]:
            if k:
                yield move(b"G0 ", first - 1, b"\n")
            yield move(b"G0 ", first, b"\n")
        yield move(b"G1 ", first, feed)
        yield from lines_of([*xyz, b"\n"], [column[first + 1 : end] for column in columns])
    yield move(b"G0 ", len(centres) - 1, b"\n")
    yield b"M30\n%\n"


def read(raw: bytes, where: str, wheel: Wheel) -> CommandedPoints:
    """Return the tool centres of a program, and the contacts recovered from them.

    Raises
    ------
    MalformedInputError
        If it is no whole program of this kind in mm and absolute coordinates.
    """
    if not _WHOLE.match(raw) or raw.split()[-2:] != [b"M30", b"%"]:
        raise MalformedInputError("no whole program in mm and absolute coordinates", where=where)
    lines = Lines(raw)
    first, rapid = lines.start_with(_CUT), lines.start_with(_RAPID)
    cut = first | lines.start_with(b"X")
    if not first.any() or not first[cut][0] or not rapid.any():
        raise MalformedInputError("no stroke", where=where, expected="G0 X Y Z, then G1 X Y Z F")
    plain = _without_feed(lines, cut, first)
    centres = table_of(plain, 3, where, b"XYZ")
    above = table_of(lines.only(rapid).replace(b"G0 ", b"   "), 3, where, b"XYZ")[0]
    rounding = rounding_mm(len(plain.split(maxsplit=1)[0].partition(b".")[2]))
    starts = np.flatnonzero(first[cut])
    found = contacts(centres, starts, wheel, above - centres[0])
    return CommandedPoints(found.points_mm, found.normals, centres, frame_in(raw), rounding + found.error_mm)


def _without_feed(lines: Lines, cut: NDArray[np.bool_], first: NDArray[np.bool_]) -> bytes:
    """Return the coordinates of all cuts, the words G1 and F of the first points of strokes blanked."""
    out = bytearray(lines.only(cut))
    for k in np.flatnonzero(first).tolist():
        start, end = int(lines.starts[k]), int(lines.ends[k])
        feed = out.find(b" F", start, end)
        out[start : start + 2] = b"  "
        if feed >= 0:
            out[feed:end] = b" " * (end - feed)
    return bytes(out)
