"""Straight blocks with normals in Klartext: ``LN X Y Z NX NY NZ``, points in frame `part` or `grinder`.

The control itself moves the tool off the surface along the normal by the radius and the deltas of its tool
table (3-D tool compensation), so the program holds for every wheel. Source: Heidenhain, "TNC 640 User's
Manual for HEIDENHAIN Conversational Programming", chapter on multiple-axis machining. Spindle, tool call
and M functions are the machine's own and are left to the user.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import MalformedInputError
from cmm_align.formats.fixed_decimals import Field, Piece, lines_of
from cmm_align.posts.commanded import CommandedPoints
from cmm_align.posts.job import ExportJob, frame_in
from cmm_align.posts.limits import check_lines
from cmm_align.posts.numbers import Lines, table_of
from cmm_align.posts.rounding import least_normal_decimals, rounding_mm
from cmm_align.posts.tool_path import raster
from cmm_align.surfaces.protocol import Array

_BLOCK: Final = re.compile(rb"^\d+ LN X([+-][\d.]+) Y[+-][\d.]+ Z", re.MULTILINE)
_HEAD_BLOCKS: Final = 4


def blocks(job: ExportJob) -> Iterator[bytes]:
    """Give the program: lines to and fro over the nodes, lifted along the normals where they break off.

    Raises
    ------
    UsageError
        If it has more lines than the control takes.
    """
    path = raster(job.correction, job.config, job.wheel)
    name = job.program_name()
    n = len(path.points_mm)
    lifts = int(path.lifted.sum())
    check_lines(n + 2 * lifts + _HEAD_BLOCKS + 1, job.config)
    fine = least_normal_decimals(job.wheel)
    pieces: list[Piece] = [Field(6, 0), b" LN"]
    for k, axis in enumerate((b"X", b"Y", b"Z")):
        pieces += [b" " + axis, Field(k, job.decimals, plus=True)]
    for k, axis in enumerate((b"X", b"Y", b"Z")):
        pieces += [b" N" + axis, Field(k + 3, fine, plus=True)]
    columns = [*path.points_mm.T, *path.normals.T]
    yield (
        f"0 BEGIN PGM {name} MM\n"
        f"1 ; cmm-align: contact points and surface normals, frame of the {job.frame}\n"
        "2 ; tool call, spindle, coolant and the M function of 3-D compensation: put yours here\n"
        f"3 FN 0: Q1 =+{job.config.feed_mm_min:g} ; feed mm/min\n"
    ).encode("ascii")
    number = _HEAD_BLOCKS
    safe = float((path.points_mm @ path.up).max()) + job.config.safe_height_mm
    bounds = [*path.starts[path.lifted].tolist(), n]
    for first, end in pairwise(bounds):
        at = path.points_mm[first] + (safe - path.points_mm[first] @ path.up) * path.up
        yield _move(number, at, b" R0 FMAX\n", job.decimals)
        first_line = [number + 1.0]
        part = [column[first : first + 1] for column in columns]
        yield from lines_of([*pieces, b" FQ1\n"], [*part, np.array(first_line)])
        count = np.arange(number + 2, number + 1 + end - first, dtype=np.float64)
        yield from lines_of([*pieces, b"\n"], [*(c[first + 1 : end] for c in columns), count])
        number += 1 + end - first
        at = path.points_mm[end - 1] + (safe - path.points_mm[end - 1] @ path.up) * path.up
        yield _move(number, at, b" R0 FMAX\n", job.decimals)
        number += 1
    yield f"{number} END PGM {name} MM\n".encode("ascii")


def _move(number: int, at: Array, end: bytes, decimals: int) -> bytes:
    """Return a straight move in rapid traverse."""
    pieces: list[Piece] = [Field(3, 0), b" L"]
    for k, axis in enumerate((b"X", b"Y", b"Z")):
        pieces += [b" " + axis, Field(k, decimals, plus=True)]
    return b"".join(lines_of([*pieces, end], [*at[:, None], np.array([float(number)])]))


def read(raw: bytes, where: str) -> CommandedPoints:
    """Return points and normals of the LN blocks.

    Raises
    ------
    MalformedInputError
        If it is no program in mm, is cut off, or its blocks are not these.
    """
    head, _, rest = raw.partition(b"\n")
    tail = raw.rstrip().rpartition(b"\n")[2].split()
    if not head.endswith(b" MM") or b" BEGIN PGM " not in head or tail[1:3] != [b"END", b"PGM"]:
        raise MalformedInputError(
            "no whole program in mm", where=where, expected="0 BEGIN PGM ... MM to END PGM ... MM"
        )
    first = _BLOCK.search(rest)
    if first is None:
        raise MalformedInputError("no block with LN X Y Z NX NY NZ", where=where)
    lines = Lines(rest.replace(b" FQ1\n", b"\n"))
    table = table_of(lines.only(_has_normal(lines)), 7, where, b"LNXYZ")
    return CommandedPoints(
        points_mm=table[:, 1:4],
        normals=table[:, 4:7],
        tool_centres_mm=None,
        frame=frame_in(raw),
        accuracy_mm=rounding_mm(len(first[1].partition(b".")[2])),
    )


def _has_normal(lines: Lines) -> NDArray[np.bool_]:
    """Return, shape (n,), which lines are LN blocks."""
    last = len(lines.bytes_) - 1
    at = np.flatnonzero(lines.bytes_ == ord("L"))
    for k, byte in enumerate(b" LN X", -1):
        at = at[lines.bytes_[np.clip(at + k, 0, last)] == byte]
    found = np.zeros(len(lines.starts), np.bool_)
    found[np.searchsorted(lines.ends, at)] = True
    return found
