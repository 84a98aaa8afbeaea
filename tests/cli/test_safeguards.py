"""What keeps an operator from a wrong pass: verdicts that are seen, doubts that are said, refusals."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
from conftest import Ran

Cli = Callable[..., Ran]


def test_the_verdict_is_the_first_line_and_says_what_failed(cli: Cli, made: Path) -> None:
    start = ["error-map", made / "part.align.h5", "-o", made / "f.map.h5", "--overwrite"]
    failed = cli(*start, "--tolerance-pv", "10um", "--tolerance-rms", "50um")
    first, second = failed.out.splitlines()[:2]

    assert first.startswith("  FAIL   PV 26")
    assert first.endswith("fail")
    assert second.split()[0] == "RMS"
    assert second.endswith("pass")
    assert "PV 10 um, RMS 50 um" in failed.out
    passed = cli(*start, "--tolerance-pv", "40um")
    assert passed.out.startswith("  PASS")
    assert passed.out.rstrip().endswith("nothing: within tolerance")
    assert "none given" in cli(*start).out


def test_a_tolerance_without_a_unit_is_refused_and_one_in_the_wrong_unit_is_doubted(
    cli: Cli, made: Path
) -> None:
    start = ["error-map", made / "part.align.h5", "-o", made / "w.map.h5", "--overwrite"]
    bare = cli(*start, "--tolerance-pv", "10")

    assert bare.code == 2
    assert "'10' has no unit; expected 10um or 10mm" in bare.err
    assert not (made / "w.map.h5").exists()
    assert "is its unit right?" in cli(*start, "--tolerance-pv", "10mm").err
    assert cli(*start, "--tolerance-pv", "100um").err == ""


def test_an_earlier_correction_beside_the_map_is_not_forgotten(
    cli: Cli, made: Path, sample_data: Path, tmp_path: Path
) -> None:
    for name in ("nominal.h5", "part.map.h5", "part.comp.h5"):
        shutil.copy(made / name, tmp_path)
    shutil.copy(sample_data / "part2.csv", tmp_path)
    assert cli("align", tmp_path / "part2.csv", tmp_path / "nominal.h5", "-q").code == 0
    mapped = cli("error-map", tmp_path / "part2.align.h5")
    start = ["compensate", tmp_path / "part2.map.h5"]
    refused = cli(*start)

    assert f"add --previous {tmp_path / 'part.comp.h5'}" in " ".join(mapped.out.split())
    assert refused.code == 2
    assert f"give --previous {tmp_path / 'part.comp.h5'}, else --first-pass" in refused.err
    assert not (tmp_path / "part2.comp.h5").exists()
    both = cli(*start, "--first-pass", "--previous", tmp_path / "part.comp.h5")
    assert both.code == 2
    assert cli(*start, "--first-pass", "--json").result["pass_number"] == 1
    again = cli(*start, "--previous", tmp_path / "part.comp.h5", "--overwrite", "--json")
    assert again.result["pass_number"] == 2
    first = cli("compensate", tmp_path / "part.map.h5", "--overwrite")
    assert first.code == 0  # a later pass of the same chain is no earlier one


def test_more_is_said_when_asked(cli: Cli, made: Path) -> None:
    for command, source, word in (
        ("error-map", "part.align.h5", "ISO 10110-5"),
        ("compensate", "part.map.h5", "sum of all passes"),
    ):
        start = [command, made / source, "-o", made / "more.h5", "--overwrite"]
        assert word not in cli(*start).out
        assert word in cli(*start, "-v").out


def test_a_map_of_part_of_the_nominal_is_warned_of_and_hardly_any_is_no_base(
    cli: Cli, made: Path, sample_data: Path, tmp_path: Path
) -> None:
    head, *lines = (sample_data / "part.csv").read_text().splitlines(keepends=True)
    names, *rows = lines
    with h5py.File(made / "part.align.h5") as file:
        x = file["points/contact_part_mm"][:, 0]
    for share, limit in (("most", 35.0), ("least", -10.0)):
        text = [head, names, *(row for row, place in zip(rows, x, strict=True) if place < limit)]
        (tmp_path / f"{share}.csv").write_text("".join(text))
        start = made / "part.align.h5"
        align = ["align", tmp_path / f"{share}.csv", made / "nominal.h5", "--initial", start, "-q"]
        assert cli(*align).code == 0
        mapped = cli("error-map", tmp_path / f"{share}.align.h5", "--json").json
        assert mapped["result"]["coverage_percent"] < 95.0
        assert any("of the nominal only" in text for text in mapped["warnings"])
    most = cli("compensate", tmp_path / "most.map.h5", "--json").json
    least = cli("compensate", tmp_path / "least.map.h5", "--first-pass")

    assert any("continued from neighbours" in text for text in most["warnings"])
    assert least.code == 3
    assert "no data of its own" in least.err
    assert not (tmp_path / "least.comp.h5").exists()


def test_a_limit_of_the_settings_is_named_with_its_section(cli: Cli, made: Path, tmp_path: Path) -> None:
    (tmp_path / "low.toml").write_text("[compensate]\nmax_correction_um = 1.0\n")
    ran = cli("compensate", made / "part.map.h5", "--config", tmp_path / "low.toml", "--overwrite")

    assert ran.code == 3
    assert all(word in ran.err for word in ("max_correction_um", "[compensate]", "--config"))
