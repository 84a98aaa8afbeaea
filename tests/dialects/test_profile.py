"""A machine profile that is wrong is refused with its place and the remedy."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

from cmm_align.dialects import MachineProfile, profile_of, read_profile
from cmm_align.errors import MissingFileError, UnitsError, UsageError

FAULTS = [
    ('bau = 9600\ndialect = "xyz"\n', "did you mean 'baud'"),
    ("baud = 9600\n", "dialect is missing"),
    ('dialect = "xyzzy"\n', "did you mean 'xyz'"),
    ('dialect = "xyz"\nbaud = 1\n', "expected 50 to 1e+07"),
    ('dialect = "xyz"\nbaud = "9600"\n', "a value like 9600"),
    ('dialect = "xyz"\nbytesize = 9\n', "expected 7 to 8"),
    ('dialect = "xyz"\nparity = "even"\n', "one of N, E, O, M, S"),
    ('dialect = "xyz"\nstopbits = 3\n', "one of 1.0, 1.5, 2.0"),
    ('dialect = "xyz"\nxonxoff = 1\n', "a value like False"),
    ('dialect = "xyz"\nterminator = "CRFL"\n', "did you mean 'CRLF'"),
    ('dialect = "xyz"\ncolumns = "x,y"\n', "x, y and z"),
    ('dialect = "xyz"\ncolumns = "x,y,z,z"\n', "each once"),
    ('dialect = "xyz"\ncolumns = "x,y,z,i"\n', "i, j, k together"),
    ('dialect = "xyz"\ncolumns = "x,y,h"\n', "column 'h'"),
    ('dialect = "xyz_letters"\ncolumns = "id,x,y,z"\n', "column 'id'"),
    ('dialect = "gmserver"\ncolumns = "x,y,z"\n', "always x,y,z,w,i,j,k"),
    ('dialect = "xyz"\naxis_map = "+x,+x,+z"\n', "each axis once"),
    ('dialect = "xyz"\naxis_map = "x,y,z"\n', "each axis once"),
    ('dialect = "xyz"\nscale = 0\n', "1e-12 to 1e+06"),
    ('dialect = "xyz"\nscale = [1, 2]\n', "0.001 or [0.001, 0.001, 0.001]"),
    ('dialect = "xyz"\nscale = [1, 2, true]\n', "1e-12 to 1e+06"),
    ('dialect = "xyz"\nscale = nan\n', "scale = nan"),
    ('dialect = "xyz"\ndecimal = ","\nseparator = "comma"\n', "commas both inside and between"),
    ('dialect = "xyz"\nkind = "centre"\n', "did you mean 'tip_centre'"),
    ('dialect = "xyz"\nend_marker = " END"\n', "ASCII without blanks"),
    ('dialect = "xyz"\nmax_bytes = 0\n', "max_bytes = 0"),
    ('dialect = "ipp"\nunits = "inch"\n', "I++ DME lays down mm"),
    ('dialect = "ipp"\nscale = 0.001\n', "I++ DME lays down mm"),
    ("dialect = \n", "not valid TOML"),
]


@pytest.mark.parametrize(("text", "words"), FAULTS)
def test_a_mistake_is_named_with_its_file(tmp_path, text, words):
    path = tmp_path / "machine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=r"machine\.toml") as caught:
        read_profile(path)

    assert words in str(caught.value)


def test_an_unknown_unit_and_a_missing_file_say_so(tmp_path):
    with pytest.raises(UnitsError, match="unknown unit 'furlong'"):
        profile_of({"units": "furlong"})
    with pytest.raises(MissingFileError):
        read_profile(tmp_path / "none.toml")
    (tmp_path / "latin.toml").write_bytes(b'name = "\xb5"\n')
    with pytest.raises(UsageError, match="not valid TOML"):
        read_profile(tmp_path / "latin.toml")


def test_what_is_left_out_has_its_default_and_the_name_is_that_of_the_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('dialect = "xyz"\n', encoding="utf-8")

    assert read_profile(path) == MachineProfile(name="mine")


def test_a_profile_goes_through_json_and_back():
    profile = profile_of(
        {"dialect": "xyz", "terminator": "CR", "scale": [1, 2, 3], "kind": "contact", "stopbits": 2}
    )

    assert profile.terminator == "\r"
    assert profile_of(json.loads(json.dumps(asdict(profile)))) == profile
    assert profile_of(asdict(profile)) == profile
