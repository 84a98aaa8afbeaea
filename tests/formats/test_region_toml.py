"""A region from a TOML file, or from the text itself."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import Sphere

from cmm_align.errors import MalformedInputError, MissingFileError, UnitsError, UsageError
from cmm_align.formats.region_toml import read_region

SQUARE = Sphere(20.0, "prescription", 50.0)
ON_ITS_OWN = 'shape = "circle"\nradius = 10.0\n'


@pytest.mark.parametrize(
    ("text", "units", "radius_mm"),
    [
        (ON_ITS_OWN, None, 10.0),
        (ON_ITS_OWN, "inch", 254.0),
        ('units = "um"\n' + ON_ITS_OWN, None, 0.01),
        ('units = "cm"\n[aperture]\n' + ON_ITS_OWN, "inch", 100.0),
        ('schema = "cmm-align/prescription/1"\n[aperture]\n' + ON_ITS_OWN + "[[term]]\n", None, 10.0),
    ],
)
def test_a_file_has_the_keys_of_an_aperture(text, units, radius_mm, tmp_path):
    path = tmp_path / "clear.toml"
    path.write_text(text)

    region = read_region(str(path), SQUARE, units)

    assert region.words == f"circle of radius {radius_mm:g} mm about (0, 0)"
    assert region.contains(np.array([0.99, 1.01]) * radius_mm, np.zeros(2)).tolist() == [True, False]


def test_a_text_that_names_no_file_is_read_itself():
    assert read_region("circle:0,0,3", SQUARE).words == "circle of radius 3 mm about (0, 0)"
    with pytest.raises(UsageError, match=r"--fit-region: 'clear\.txt' is no region.*or a \.toml file"):
        read_region("clear.txt", SQUARE, where="--fit-region")


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("shape = ", MalformedInputError, "not valid TOML"),
        ('shape = "circel"\nradius = 1.0\n', MalformedInputError, "did you mean 'circle'"),
        ('shape = "circle"\nradios = 1.0\n', MalformedInputError, "unknown key 'radios'"),
        ('units = "furlong"\n' + ON_ITS_OWN, UnitsError, "unknown unit 'furlong'"),
        ("aperture = 3\n", MalformedInputError, "no [aperture]"),
    ],
)
def test_a_wrong_file_is_refused_by_name(text, error, words, tmp_path):
    path = tmp_path / "clear.toml"
    path.write_text(text)

    with pytest.raises(error) as caught:
        read_region(str(path), SQUARE)

    assert str(caught.value).startswith(f"{path}:")
    assert words in caught.value.one_line()


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no\.toml"):
        read_region(str(tmp_path / "no.toml"), SQUARE)
