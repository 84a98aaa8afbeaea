"""Points as text: columns between commas, semicolons, tabs or blanks, as people and programs write them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Final, TypeAlias

import numpy as np

from cmm_align.errors import MalformedInputError, UnitsError
from cmm_align.formats.column_names import AXES, is_unit
from cmm_align.formats.decoding import decoded
from cmm_align.formats.delimited_layout import Layout, layout_of
from cmm_align.formats.delimited_scan import first_place, lines_at, table_of, words_in
from cmm_align.formats.source import Source, scale_to_mm, told
from cmm_align.formats.statements import numbers_of_names
from cmm_align.model import IntArray, PointKind, PointSet
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import MM_PER, mm_per

PlaceOf: TypeAlias = Callable[[int, str], str]
"""Gives file, line and column of a field, by its row and the meaning of its column."""

_UNIT_LENGTH: Final = (0.9, 1.1)
_MAX_EXACT_ID: Final = 2.0**53
_WORST_QUALITY: Final = 99.0
"""As I++ DME has it: 0 is good, 100 is a bad point."""
_GOOD: Final = {"ok", "good", "valid", "gut", "gültig", "gueltig", "io", "i.o.", "1", "true", "pass"}
_BAD: Final = {"nok", "bad", "invalid", "schlecht", "ungültig", "ungueltig", "nio", "n.i.o.", "false", "fail"}
_LAST_NUMBER: Final = re.compile(r"[+-]?\d*(?:[.,](\d*))?\s*$", re.ASCII)


def recognises(head: bytes) -> bool:
    """Return whether a file may be text: the last guess, taken if no other format knows the file."""
    return bool(head)


def read(source: Source, units: str | None = None) -> PointSet:
    """Return the points of a delimited text.

    Parameters
    ----------
    source : Source
        Its hints say what the decimal sign is and what the columns are, where the file leaves it open.
    units : str, optional
        Unit of length where the file states none; mm by default.

    Returns
    -------
    PointSet
        Measured coordinates where the file has both measured and nominal ones. Points whose quality the
        file calls bad are left out, and told in `passed_over`.

    Raises
    ------
    MalformedInputError
        With file, line, column and the offending text; also if the hints contradict the file.
    UnitsError
        If the file states another unit than `units`.
    """
    where = source.where
    text = decoded(source.raw, where)
    layout = layout_of(text, where, source.hints)
    table = table_of(text, layout, where)
    place = partial(first_place, text, layout, where)
    _check_end(text, layout, table, source)
    _check_count(layout, table, where)
    scales = _scales(text, layout, units, where)
    column = {name: table[:, k] for k, name in enumerate(layout.numbers)}
    if not layout.named and source.hints.columns is None and "k" in column:
        _check_normals(column, place)
    if "sigma" in column:
        _refuse(column["sigma"] <= 0.0, column["sigma"], "sigma", "above 0", place)
    if "weight" in column:
        _check_weights(column["weight"], place)
    ids = _ids(text, layout, column, place)
    points = table if layout.numbers == AXES else np.stack([column[axis] for axis in AXES], axis=1)
    of_axes = np.array([scales[axis] for axis in AXES])
    points = points if (of_axes == 1.0).all() else points * of_axes
    sigma_mm = column["sigma"] * scales["sigma"] if "sigma" in column else None
    weight = column.get("weight")
    bad = _bad(text, layout, column, place)
    left_out = []
    if bad.any():
        rows = np.flatnonzero(bad).tolist()
        left_out = [(number, line, "its quality is bad") for number, line in lines_at(text, layout, rows)]
        points = points[~bad]
        ids = np.flatnonzero(~bad) if ids is None else ids[~bad]
        sigma_mm, weight = (None if one is None else one[~bad] for one in (sigma_mm, weight))
    kind = layout.header.kind
    if layout.columns.is_nominal and kind is PointKind.UNSTATED:
        kind = PointKind.NOMINAL
    return PointSet.of(
        points,
        kind=kind,
        frame=layout.header.frame,
        ids=ids,
        source=where,
        sigma_mm=sigma_mm,
        weight=weight,
        passed_over=told(where, left_out),
    )


def _scales(text: str, layout: Layout, units: str | None, where: str) -> dict[str, float]:
    """Return the factors to mm of x, y, z and sigma, from all places where a file may state units."""
    stated = layout.columns.units
    in_names = {axis: stated[axis] for axis in AXES if axis in stated}
    elsewhere = [layout.header.units, layout.units, _unit_in_rows(text, layout, where)]
    for_all = [unit for unit in (*elsewhere, *in_names.values()) if unit]
    if any(elsewhere) or len({MM_PER[unit] for unit in for_all}) == 1:
        for unit in for_all[1:]:
            scale_to_mm(for_all[0], unit, where)
        in_names = dict.fromkeys(AXES, for_all[0])
    scales = {}
    for axis in AXES:
        if in_names and axis not in in_names:
            raise UnitsError(
                f"columns in {' and '.join(sorted(set(in_names.values())))}, and {axis} without a unit",
                where=where,
                expected="a unit for each of them",
            )
        scales[axis] = scale_to_mm(in_names.get(axis, ""), units, where)
    if "sigma" in layout.numbers:
        if "sigma" not in stated and len(set(scales.values())) > 1:
            raise UnitsError("sigma without a unit", where=where, expected="one, since x, y and z differ")
        scales["sigma"] = mm_per(stated["sigma"], where=where) if "sigma" in stated else scales["x"]
    return scales


def _unit_in_rows(text: str, layout: Layout, where: str) -> str:
    """Return the one unit in a column of units; empty if there is none."""
    if "unit" not in layout.columns.index:
        return ""
    found = Counter(words_in(text, layout, "unit"))
    found.pop("", None)
    known = {is_unit(word) for word in found}
    if "" in known or len({MM_PER[unit] for unit in known}) > 1:
        shown = ", ".join(sorted(found)[:3])
        raise UnitsError(
            f"units {shown} in the rows", where=where, expected="one unit of length for all points"
        )
    return next(iter(known), "")


def _check_end(text: str, layout: Layout, table: Array, source: Source) -> None:
    """Refuse a last line that may have been cut: it has no end, and nothing shows that its number is whole.

    Lines that all have as many decimals show it, and lines whose decimals differ are taken as a text whose
    end somebody forgot.
    """
    if text.endswith("\n"):
        return
    start = max(text.rfind("\n") + 1, layout.start)
    last, number = text[start:], text.count("\n") + 1
    before = text[layout.start : start].rstrip("\n").split("\n")[-50:] if len(table) > 1 else []
    decimals = {len(match[1] or "") for line in before if (match := _LAST_NUMBER.search(line))}
    match = _LAST_NUMBER.search(last)
    usual = decimals.pop() if len(decimals) == 1 else None
    fewer = match is not None and usual is not None and len(match[1] or "") < max(usual, 1)
    if fewer or len(table) == 1 or source.hints.strict:
        raise MalformedInputError(
            f"the last line {last.strip()[-40:]!r} has no end: it may have been cut off",
            where=f"{source.where}:{number}:{len(last) + 1}",
            expected="an end of line after the last point",
            remedy="export it again, or add the end if nothing is missing",
        )


def _check_count(layout: Layout, table: Array, where: str) -> None:
    if layout.announced is not None and layout.announced[0] != len(table):
        announced, number = layout.announced
        raise MalformedInputError(
            f"{announced} points are announced, {len(table)} are there",
            where=f"{where}:{number + 1}:1",
            expected="as many as announced",
            remedy="export the file again: it may have been cut off",
        )


def _bad(text: str, layout: Layout, column: dict[str, Array], place: PlaceOf) -> Mask:
    """Return which points the file itself calls bad."""
    none: Mask = np.zeros(len(column["x"]), dtype=bool)
    if "quality" not in layout.columns.index:
        return none
    if "quality" in column:
        bad = column["quality"] > _WORST_QUALITY
        if 2 * bad.sum() > len(bad):
            row = int(np.argmax(bad))
            raise MalformedInputError(
                f"quality {column['quality'][row]:.12g} in most rows: 100 may be the best or the worst",
                where=place(row, "quality"),
                expected="0 for good and 100 for bad points, as in I++ DME",
                remedy="leave the column out with - in --columns",
            )
        return bad
    words = [word.lower() for word in words_in(text, layout, "quality")]
    unknown = next((k for k, word in enumerate(words) if word not in _GOOD | _BAD), None)
    if unknown is not None:
        raise MalformedInputError(
            f"quality {words[unknown][:40]!r} is not known",
            where=place(unknown, "quality"),
            expected="OK, NOK, good, bad, gut, schlecht ...",
            remedy="leave the column out with - in --columns",
        )
    return np.array([word in _BAD for word in words])


def _check_normals(column: dict[str, Array], place: PlaceOf) -> None:
    length = np.linalg.norm([column[name] for name in "ijk"], axis=0)
    wrong = (length < _UNIT_LENGTH[0]) | (length > _UNIT_LENGTH[1])
    if wrong.any():
        row = int(np.argmax(wrong))
        raise MalformedInputError(
            f"the last three columns are no unit vector (length {length[row]:.3g})",
            where=place(row, "i"),
            expected="x y z i j k, or a line that names the columns",
            remedy='name them with --columns "x,y,z,-,-,-"',
        )


def _check_weights(weight: Array, place: PlaceOf) -> None:
    _refuse(weight < 0.0, weight, "weight", "0 or more", place)
    if not weight.any():
        raise MalformedInputError("all weights are 0", where=place(0, "weight"), expected="some above 0")


def _ids(text: str, layout: Layout, column: dict[str, Array], place: PlaceOf) -> IntArray | None:
    """Return the numbers of the points; None if the file gives none, or names without numbers."""
    if "id" in column:
        values = column["id"]
        wrong = (values != np.round(values)) | (np.abs(values) > _MAX_EXACT_ID)
        _refuse(wrong, values, "id", "a whole number", place)
        return values.astype(np.int64)
    if "id" not in layout.columns.index:
        return None
    found = numbers_of_names(words_in(text, layout, "id"))
    return None if found is None else np.array(found, dtype=np.int64)


def _refuse(wrong: Mask, values: Array, name: str, expected: str, place: PlaceOf) -> None:
    """Raise at the first wrong value of a column, if there is one."""
    if wrong.any():
        row = int(np.argmax(wrong))
        raise MalformedInputError(f"{name} {values[row]:.12g}", where=place(row, name), expected=expected)
