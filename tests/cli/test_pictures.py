"""Pictures from the command line: which, where, and the numbers that come out where none can be drawn."""

from __future__ import annotations

import sys

import pytest

from cmm_align.cli import drawing
from cmm_align.config import ErrorMapConfig
from cmm_align.errors import UsageError
from cmm_align.report.pictures import PICTURES


def test_names_formats_and_sections_are_parsed(tmp_path):
    assert drawing.parsed(None, (), ()).names == ("map",)
    assert drawing.parsed("ladder, MAP", (), ()).names == ("map", "ladder")
    assert drawing.parsed("all", (), ()).names == tuple(PICTURES)
    assert drawing.parsed(None, (), ("x=0",)).names == ("map", "sections")
    assert drawing.parsed(None, ("svg",), ()).formats == ("svg",)
    assert drawing.parsed(None, ("both",), ()).formats == ("png", "svg")
    assert drawing.parsed(None, (), (), none=True).files(tmp_path / "a.map.h5") == []
    files = drawing.parsed("map,ladder", ("both",), ()).files(tmp_path / "a.map.h5")
    names = [path.name for _, path in files]
    assert names == ["a.map.png", "a.map.svg", "a.ladder.png", "a.ladder.svg"]


@pytest.mark.parametrize(
    ("pictures", "sections", "none", "words"),
    [
        ("histgram", (), False, "did you mean histogram"),
        ("map,", (), False, "there is no picture ''"),
        ("map", (), True, "one or the other"),
        (None, ("x=0",), True, "one or the other"),
    ],
)
def test_what_cannot_be_meant_is_refused(pictures, sections, none, words):
    with pytest.raises(UsageError, match=words):
        drawing.parsed(pictures, (), sections, none=none)


def test_pictures_lie_beside_the_map_and_in_the_outputs(cli, made, tmp_path):
    out = tmp_path / "part.map.h5"
    result = cli(
        "error-map", made / "part.align.h5", "-o", out, "--json",
        "--pictures", "histogram,ladder", "--picture-format", "svg", "--section", "x=0",
    )  # fmt: skip
    assert result.code == 0, result.err
    expected = [out, *(tmp_path / f"part.{name}.svg" for name in ("histogram", "sections", "ladder"))]
    assert result.json["outputs"] == [str(path) for path in expected]
    assert all(path.stat().st_size > 1000 for path in expected)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--pictures", "sectoins"), "did you mean sections?"),
        (("--section", "x=1000"), "misses the part"),
        (("--scale", "0"), "not a length above zero"),
    ],
)
def test_a_wrong_wish_is_refused_before_anything_is_written(options, words, cli, made, tmp_path):
    out = tmp_path / "part.map.h5"
    result = cli("error-map", made / "part.align.h5", "-o", out, *options)
    assert result.code == 2
    assert words in result.err
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def _no_matplotlib(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("cmm_align.report.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)


@pytest.mark.usefixtures("_no_matplotlib")
def test_the_numbers_come_out_where_no_picture_can_be_drawn(cli, made, tmp_path):
    out = tmp_path / "part.map.h5"
    result = cli("error-map", made / "part.align.h5", "-o", out, "--json", "--pictures", "map,ladder")
    assert result.code == 8
    told = result.json
    assert told["outputs"] == [str(out)]
    assert told["result"]["pv_um"] > 0.0
    assert "part.map.png and part.ladder.png not drawn: ModuleNotFoundError" in told["warnings"][0]
    assert [path.name for path in tmp_path.iterdir()] == ["part.map.h5"]


def test_an_older_picture_that_stays_is_told(tmp_path):
    path = tmp_path / "a.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n")

    def fails(_place):
        raise RuntimeError("no   font " + 100 * "long ")

    fault = drawing.attempt(fails, path, overwrite=True)
    assert fault.startswith("RuntimeError: no font long")
    assert len(fault) < 200
    assert "older than these numbers" in drawing.named(path)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert "exists already" in drawing.attempt(fails, path, overwrite=False)


def test_all_leaves_out_what_a_map_cannot_have_and_says_so(cli, made, tmp_path):
    out = tmp_path / "part.map.h5"
    result = cli(
        "error-map", made / "part.align.h5", "-o", out, "--json", "--spacing", "12", "--pictures", "all"
    )  # fmt: skip
    assert result.code == 0, result.err
    assert any(text.startswith("no picture bands: no tolerance") for text in result.json["warnings"])
    assert any(text.startswith("no picture psd: a map with values in") for text in result.json["warnings"])
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"part.map.h5", *(f"part.{n}.png" for n in PICTURES if n not in {"bands", "psd"})}
    assert result.result["spectrum"]["rings"] == []
    assert result.result["spectrum"]["missing"]
    bands = cli("error-map", made / "part.align.h5", "-o", out, "--overwrite", "--pictures", "bands")
    assert bands.code == 2
    assert "or --tolerance-pv 10um" in bands.err


def test_a_cutoff_that_cannot_be_is_refused_with_both_limits(cli, made, tmp_path):
    for option, cutoff in (("--low-pass", "1mm"), ("--high-pass", "200mm")):
        result = cli("error-map", made / "part.align.h5", "-o", tmp_path / "a.map.h5", option, cutoff)
        assert result.code == 2
        assert "(sampling: 4 spacings) to" in result.err
        assert "mm (the part)" in result.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("_no_matplotlib")
@pytest.mark.parametrize(
    ("command", "source", "name", "others"),
    [
        (("compensate",), "part.map.h5", "a.comp", {".xyz"}),
        (("offset", "--tip-radius", "1.5", "--plot"), "nominal.toml", "a", set()),
    ],
)
def test_so_do_the_files_of_other_stages(command, source, name, others, cli, made, sample_data, tmp_path):
    folder = made if (made / source).exists() else sample_data
    result = cli(command[0], folder / source, *command[1:], "-o", tmp_path / f"{name}.h5", "--json")
    assert result.code == 8, result.err
    assert f"{name}.png not drawn: ModuleNotFoundError" in result.json["warnings"][0]
    assert {path.name for path in tmp_path.iterdir()} == {f"{name}{s}" for s in (".h5", *others)}
    assert result.json["outputs"] == [str(tmp_path / f"{name}{s}") for s in (".h5", *others)]


@pytest.mark.parametrize(
    ("settings", "limits"),
    [
        ({"tolerance_pv_um": 10.0}, (-5.0, 5.0)),
        ({"tolerance_pv_um": 10.0, "tolerance_profile_um": 6.0}, (-3.0, 3.0)),
        (
            {"tolerance_profile_um": 6.0, "tolerance_band_lower_um": -1.0, "tolerance_band_upper_um": 4.0},
            (-1.0, 4.0),
        ),
        ({"tolerance_rms_um": 1.0}, None),
    ],
)
def test_the_limits_of_the_pictures_are_those_of_the_plainest_tolerance(settings, limits):
    found = drawing.limits_of(ErrorMapConfig(**settings), drawing.Drawings())
    assert (None if found is None else (found.low_um, found.high_um)) == limits
