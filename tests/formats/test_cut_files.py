"""Files cut at any byte: what is read is the beginning of what was there, or an error with its place."""

from __future__ import annotations

import re

import numpy as np
import pytest
from formats.saddle import POINT_ENTITIES, TEXT, calypso, dmis, geopak, iges, pc_dmis, tracker, vda

from cmm_align.errors import InputError
from cmm_align.formats import FORMATS
from cmm_align.formats.source import Source

END = {"VDA-FS": b"= END", "DMIS": b"ENDFIL", "IGES points": b" T"}
"""With what a file is complete."""
WITH_END = {"VDA-FS": vda(), "VDA-FS points": vda("POINT", numbered=False), "DMIS": dmis()}
WITH_END |= {"IGES points": iges(POINT_ENTITIES[:2])}
WITHOUT_END = {
    "GEOPAK scan": geopak(),
    "CALYPSO table": calypso(),
    "PC-DMIS text": pc_dmis(),
    "laser-tracker table": tracker(TEXT),
}


def reader(name: str):
    return next(known for known in FORMATS if name.startswith(known.name))


def points_or_error(known, raw: bytes):
    try:
        return known.read(Source("cut", raw), None).points_mm
    except InputError as error:
        return error


@pytest.mark.parametrize(("name", "text"), [*WITH_END.items(), *WITHOUT_END.items()])
def test_a_cut_file_gives_no_wrong_point(name, text):
    known, raw = reader(name), text.encode()
    assert known.recognises(raw)
    whole = known.read(Source("cut", raw), None).points_mm
    for end in range(len(raw)):
        points = points_or_error(known, raw[:end])
        if isinstance(points, InputError):
            assert re.match(r"cut(:\d+:\d+)?: ", str(points))
        else:
            assert name in WITHOUT_END or END[known.name] in raw[:end], f"cut at byte {end}"
            np.testing.assert_array_equal(points, whole[: len(points)])


@pytest.mark.parametrize(("name", "text"), [*WITH_END.items(), *WITHOUT_END.items()])
def test_every_format_is_recognised_by_its_own_reader_and_no_other(name, text):
    known = reader(name)
    raw = text.encode()
    others = [one.name for one in FORMATS[:-1] if one.recognises(raw)]

    assert known.name == others[0]
    assert set(others) <= {known.name, "CAD"}
    assert not any(one.recognises(b"x,y,z\n1,2,3\n") for one in FORMATS[:-1])
