"""Every bad input: the exit code, one line that says what and where, and nothing left behind."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Ran

Cli = Callable[..., Ran]
HEAD = "# cmm-align points v1; units=mm; kind=tip_centre; frame=machine\nx_mm,y_mm,z_mm\n"


def rows(points: np.ndarray) -> str:
    return "".join(",".join(f"{value:.5f}" for value in row) + "\n" for row in points)


@pytest.fixture
def part(sample_data: Path) -> np.ndarray:
    return np.loadtxt(sample_data / "part.csv", delimiter=",", skiprows=2)[::10]


@pytest.fixture
def folder(tmp_path: Path, sample_data: Path) -> Path:
    shutil.copy(sample_data / "nominal.h5", tmp_path)
    return tmp_path


def refused(ran: Ran, code: int, *words: str) -> None:
    """Assert that a command said no, in one line that holds these words."""
    assert ran.code == code, ran.err
    assert ran.out == ""
    assert len(ran.err.splitlines()) == 1, ran.err
    for word in words:
        assert word in ran.err


def align(cli: Cli, folder: Path, content: str | bytes | None, *more: object) -> Ran:
    """Align a measured file of this content; assert that nothing but the inputs is left."""
    source = folder / "bad.csv"
    if isinstance(content, bytes):
        source.write_bytes(content)
    elif content is not None:
        source.write_text(content)
    before = sorted(folder.iterdir())
    ran = cli("align", source, folder / "nominal.h5", *more)
    assert sorted(folder.iterdir()) == before
    return ran


TEXTS = {
    "missing": (None, ("cannot read",)),
    "empty": ("", ("empty",)),
    "header only": (HEAD, ()),
    "not a number": (HEAD + "1,2,3\n4,nan,6\n" + "7,8,9\n" * 9, ("bad.csv:4",)),
    "text in a number": (HEAD + "1,2,3\n4,5x,6\n" + "7,8,9\n" * 9, ("bad.csv:4", "5x")),
    "ragged rows": (HEAD + "1,2,3\n4,5\n" + "7,8,9\n" * 9, ("bad.csv:4",)),
    "two columns": ("1,2\n3,4\n5,6\n7,8\n9,10\n11,12\n13,14\n", ()),
    "nonsense": (b"\x00\x01\x02\xff" * 50, ()),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_bad_text_is_refused_with_its_place(cli: Cli, folder: Path, name: str) -> None:
    content, words = TEXTS[name]

    refused(align(cli, folder, content), 3, "bad.csv", *words)


def test_fewer_than_six_points_are_refused(cli: Cli, folder: Path, part: np.ndarray) -> None:
    ran = align(cli, folder, HEAD + rows(part[:5]))

    refused(ran, 3, "5")


def test_points_on_a_line_are_refused(cli: Cli, folder: Path) -> None:
    line = np.linspace(0.0, 1.0, 40)[:, None] * [60.0, 30.0, 5.0]

    refused(align(cli, folder, HEAD + rows(line)), 3, "line")


@pytest.mark.parametrize("factor", [1000.0, 25.4, 1 / 25.4, 1 / 1000.0])
def test_a_wrong_unit_is_named(cli: Cli, folder: Path, part: np.ndarray, factor: float) -> None:
    ran = align(cli, folder, HEAD + rows(part * factor))

    refused(ran, 3, "unit")


def test_inches_are_fine_when_said(cli: Cli, folder: Path, part: np.ndarray) -> None:
    (folder / "inch.csv").write_text("".join(",".join(f"{v:.8f}" for v in row) + "\n" for row in part / 25.4))
    ran = cli("align", folder / "inch.csv", folder / "nominal.h5", "--units", "inch", "--json")

    assert ran.code == 0
    assert ran.result["rms_um"] < 6.0


def test_a_nominal_is_not_a_measurement(cli: Cli, folder: Path, sample_data: Path) -> None:
    for nominal in ("nominal.csv", "nominal.toml", "nominal.h5"):
        refused(cli("align", sample_data / nominal, folder / "nominal.h5", "-o", folder / "x.h5"), 3, nominal)
    assert not (folder / "x.h5").exists()


def test_a_measurement_is_not_a_nominal(cli: Cli, folder: Path, sample_data: Path) -> None:
    ran = cli(
        "align", folder / "nominal.h5", sample_data / "part.csv", "--tip-radius", "1.5", "-o", folder / "x.h5"
    )

    assert ran.code == 3
    assert not (folder / "x.h5").exists()


@pytest.mark.parametrize(
    ("command", "source"),
    [
        ("error-map", "nominal.h5"),
        ("compensate", "nominal.h5"),
        ("error-map", "nominal.csv"),
        ("compensate", "part.csv"),
    ],
)
def test_a_file_of_the_wrong_stage_is_refused(
    cli: Cli, tmp_path: Path, sample_data: Path, command: str, source: str
) -> None:
    ran = cli(command, sample_data / source, "-o", tmp_path / "x.h5")

    refused(ran, 3, source)
    assert not list(tmp_path.iterdir())


def test_offset_twice_is_refused(cli: Cli, folder: Path) -> None:
    refused(cli("offset", folder / "nominal.h5", "--tip-radius", "1.5"), 3, "offset")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_a_truncated_hdf5_is_refused(cli: Cli, folder: Path, sample_data: Path, share: float) -> None:
    whole = (sample_data / "nominal.h5").read_bytes()
    (folder / "cut.h5").write_bytes(whole[: int(len(whole) * share)])
    ran = cli("align", sample_data / "part.csv", folder / "cut.h5", "-o", folder / "x.h5")

    refused(ran, 3, "cut.h5")
    assert not (folder / "x.h5").exists()


def test_the_real_mistake_is_named_before_an_output_that_exists(
    cli: Cli, folder: Path, sample_data: Path, part: np.ndarray
) -> None:
    kept = folder / "bad.align.h5"
    kept.write_text("mine")
    whole = HEAD + rows(part)

    refused(align(cli, folder, HEAD), 3, "bad.csv")
    refused(align(cli, folder, HEAD + rows(part * 25.4)), 3, "unit")
    align(cli, folder, whole)
    refused(cli("align", folder / "bad.csv", sample_data / "nominal.csv"), 2, "tip radius")
    refused(cli("align", folder / "no.csv", folder / "nominal.h5", "-o", kept), 3, "cannot read")
    refused(align(cli, folder, whole), 8, "bad.align.h5", "--overwrite")
    refused(align(cli, folder, whole, "--overwrite"), 8, "not a file of cmm-align", "another name")
    assert kept.read_text() == "mine"


def test_a_stage_file_has_the_name_of_one(cli: Cli, folder: Path, sample_data: Path) -> None:
    output = folder / "result.csv"

    refused(cli("align", sample_data / "part.csv", folder / "nominal.h5", "-o", output), 2, ".h5 or .hdf5")
    assert not output.exists()


def test_a_folder_is_no_file_of_points(cli: Cli, folder: Path) -> None:
    refused(cli("align", folder, folder / "nominal.h5"), 3, "is a folder", "expected a file of points")
    refused(cli("align", ".", folder / "nominal.h5"), 3, "is a folder")
    refused(cli("error-map", folder), 3, "is a folder")


def test_what_is_no_data_is_called_by_its_name(cli: Cli, folder: Path, sample_data: Path) -> None:
    refused(cli("info", sample_data / "chain.png"), 3, "is a picture")
    refused(cli("align", sample_data / "chain.png", folder / "nominal.h5"), 3, "is a picture")


def test_a_skipped_step_is_named(cli: Cli, folder: Path, sample_data: Path) -> None:
    part = sample_data / "part.csv"
    commanded = folder / "part.comp.xyz"
    commanded.write_text(HEAD.replace("tip_centre", "commanded").replace("machine", "part") + "1,2,3\n" * 9)

    refused(cli("error-map", part), 3, "it is a point file", "cmm-align align")
    refused(cli("error-map", folder / "nominal.h5"), 3, "it is a nominal", "which is what error-map takes")
    refused(cli("error-map", sample_data / "nominal.csv"), 3, "it is a nominal", "cmm-align offset")
    refused(cli("compensate", commanded), 3, "give the .h5 file beside it")
    commanded.with_suffix(".h5").write_text("")
    refused(cli("compensate", commanded), 3, f"give {commanded.with_suffix('.h5')}")


def test_a_missing_folder_is_refused(cli: Cli, folder: Path, sample_data: Path) -> None:
    ran = cli("align", sample_data / "part.csv", folder / "nominal.h5", "-o", folder / "no" / "x.h5")

    refused(ran, 8, "no")
    assert not (folder / "no").exists()


@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_refused(cli: Cli, folder: Path, sample_data: Path) -> None:
    closed = folder / "closed"
    closed.mkdir(mode=0o500)
    ran = cli("align", sample_data / "part.csv", folder / "nominal.h5", "-o", closed / "x.h5")

    refused(ran, 8, "closed")


def test_an_output_is_never_an_input(cli: Cli, folder: Path) -> None:
    before = (folder / "nominal.h5").read_bytes()
    ran = cli(
        "offset", folder / "nominal.h5", "--tip-radius", "1.5", "-o", folder / "nominal.h5", "--overwrite"
    )

    refused(ran, 8, "input")
    assert (folder / "nominal.h5").read_bytes() == before


@pytest.mark.parametrize(
    "arguments",
    [
        ["offset", "x.csv"],
        ["offset", "x.csv", "--tip-radius", "1.5 furlong"],
        ["offset", "x.csv", "--tip-radius", "-1"],
        ["offset", "x.csv", "--tip-radius", "0"],
        ["align", "x.csv"],
        ["align", "a.csv", "b.h5", "--distance", "fast"],
        ["nonsense"],
        ["align", "a.csv", "b.h5", "--nonsense"],
    ],
    ids=" ".join,
)
def test_usage_is_explained_in_one_line(cli: Cli, arguments: list[str]) -> None:
    refused(cli(*arguments), 2)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["align", "x.csv"], "two files are needed: MEASURED NOMINAL"),
        (["align"], "two files are needed: MEASURED NOMINAL"),
        (["alin", "x.csv"], "did you mean align?"),
        (["errormap"], "did you mean error-map?"),
        (["qqqqqq"], "known are offset, align"),
    ],
)
def test_usage_errors_say_what_is_meant(cli: Cli, arguments: list[str], word: str) -> None:
    refused(cli(*arguments), 2, word)


def test_with_json_an_error_is_an_object_too(cli: Cli, folder: Path) -> None:
    ran = cli("align", folder / "no.csv", folder / "nominal.h5", "--json")
    found = ran.json

    assert ran.code == found["exit_code"] == 3
    assert len(ran.err.splitlines()) == 1
    assert found["command"] == "align"
    assert set(found) == {"command", "version", "error", "exit_code"}
    assert set(found["error"]) == {"what", "where", "expected", "remedy"}
    assert found["error"]["where"] == str(folder / "no.csv")
    assert cli("alin", "--json").json["exit_code"] == 2


def test_an_unknown_key_names_the_nearest(cli: Cli, folder: Path, sample_data: Path) -> None:
    (folder / "job.toml").write_text("[align]\nmax_iteration = 3\n")
    ran = cli("align", sample_data / "part.csv", folder / "nominal.h5", "--config", folder / "job.toml")

    refused(ran, 2, "max_iteration", "max_iterations")


def test_a_bad_start_pose_is_refused(cli: Cli, folder: Path, sample_data: Path) -> None:
    bad = folder / "start.txt"
    for content in ("1 2 3\n", "a b c d\n" * 4, "2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"):
        bad.write_text(content)
        ran = cli(
            "align", sample_data / "part.csv", folder / "nominal.h5", "--initial", bad, "-o", folder / "x.h5"
        )

        refused(ran, 3, "start.txt")


def test_a_stop_before_the_end_is_not_a_result(cli: Cli, folder: Path, sample_data: Path) -> None:
    output = folder / "x.h5"
    ran = cli("align", sample_data / "part.csv", folder / "nominal.h5", "--iterations", "1", "-o", output)

    refused(ran, 4)
    assert not output.exists()
