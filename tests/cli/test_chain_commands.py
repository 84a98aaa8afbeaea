"""The commands as scripts see them: exit codes, JSON, files."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import Ran

Cli = Callable[..., Ran]

KEYS = {
    "offset": {
        "tip_radius_mm",
        "nominal_kind",
        "n_points",
        "max_slope_deg",
        "min_concave_radius_mm",
        "regular",
        "facet_error_pv_nm",
        "surface_error_pv_nm",
    },
    "align": {
        "part_from_machine",
        "machine_from_part",
        "translation_mm",
        "rotation_deg",
        "n_points",
        "n_used",
        "n_outliers",
        "n_outside",
        "iterations",
        "stop_reason",
        "converged",
        "rms_um",
        "pv_um",
        "max_abs_um",
        "unobservable",
        "pose_sigma",
        "two_path_difference_nm",
    },
    "error-map": {
        "n",
        "pv_um",
        "rms_um",
        "mean_um",
        "min_um",
        "max_um",
        "profile_um",
        "pvr_um",
        "grid_spacing_mm",
        "ladder",
        "verdict",
        "u_rms_um",
    },
    "compensate": {
        "gain",
        "max_correction_um",
        "predicted_pv_um",
        "predicted_rms_um",
        "worth_another_pass",
        "reason",
        "exports",
    },
}
"""The contract: what must be there."""


def arguments_of(command: str, folder: Path, sample_data: Path) -> list[Any]:
    return {
        "offset": ["offset", sample_data / "nominal.toml", "--tip-radius", "1.5mm", "-o", folder / "n.h5"],
        "align": ["align", folder / "part.csv", folder / "nominal.h5", "-o", folder / "j.align.h5"],
        "error-map": ["error-map", folder / "part.align.h5", "-o", folder / "j.map.h5"],
        "compensate": ["compensate", folder / "part.map.h5", "-o", folder / "j.comp.h5"],
    }[command]


@pytest.mark.parametrize("command", KEYS)
def test_json_is_pure_and_has_the_keys(cli: Cli, made: Path, sample_data: Path, command: str) -> None:
    ran = cli(*arguments_of(command, made, sample_data), "--json", "--overwrite")
    found = ran.json  # fails if stdout holds anything else

    assert ran.code == 0
    assert set(found) == {"command", "version", "inputs", "outputs", "warnings", "result"}
    assert found["command"] == command
    assert KEYS[command] <= set(found["result"])
    assert "NaN" not in ran.out
    assert all(len(item["sha256"]) == 64 for item in found["inputs"])
    assert all(Path(path).is_file() for path in found["outputs"])


def test_default_outputs_lie_beside_the_input(made: Path) -> None:
    names = {path.name for path in made.iterdir()}

    assert {"part.align.h5", "part.map.h5", "part.map.png", "part.comp.h5", "part.comp.xyz"} <= names


def test_every_output_knows_the_steps_that_led_to_it(made: Path) -> None:
    with h5py.File(made / "part.comp.h5") as file:
        commands = [file[f"provenance/{name}"].attrs["command"] for name in sorted(file["provenance"])]
        last = json.loads(file["provenance"][sorted(file["provenance"])[-1]].attrs["parameters"])

    assert commands == ["offset", "align", "error-map", "compensate"]
    assert last["compensate"]["gain"] == 1.0


def test_the_map_is_the_truth(cli: Cli, made: Path, sample_data: Path) -> None:
    truth = np.load(sample_data / "truth.npz")
    found = cli("align", made / "part.csv", made / "nominal.h5", "-o", made / "t.align.h5", "--json").result

    assert found["rms_um"] == pytest.approx(np.std(truth["deviation_mm"]) * 1e3, rel=0.03)
    assert found["pv_um"] == pytest.approx(np.ptp(truth["deviation_mm"]) * 1e3, rel=0.03)


def test_an_existing_output_is_refused_and_stays_as_it_was(cli: Cli, made: Path) -> None:
    before = (made / "part.align.h5").read_bytes()
    ran = cli("align", made / "part.csv", made / "nominal.h5")

    assert ran.code == 8
    assert "--overwrite" in ran.err
    assert (made / "part.align.h5").read_bytes() == before


def test_text_and_hdf5_of_the_correction_agree(made: Path) -> None:
    points = np.loadtxt(made / "part.comp.xyz", delimiter=",", skiprows=2)
    with h5py.File(made / "part.comp.h5") as file:
        z = file["grid/commanded_z_mm"][()]

    np.testing.assert_allclose(points[:, 2], z[np.isfinite(z)], rtol=0.0, atol=0.51e-6)


@pytest.mark.parametrize(
    ("tolerance", "code", "word"), [("100um", 0, "pass"), ("5um", 5, "fail"), ("0.1mm", 0, "pass")]
)
def test_a_tolerance_decides_the_exit_code(
    cli: Cli, made: Path, tolerance: str, code: int, word: str
) -> None:
    output = made / "v.map.h5"
    ran = cli(
        "error-map",
        made / "part.align.h5",
        "--tolerance-pv",
        tolerance,
        "-o",
        output,
        "--overwrite",
        "--json",
    )

    assert ran.code == code
    assert ran.result["verdict"] == word
    assert output.is_file()


def test_inside_the_guard_band_the_verdict_is_open(cli: Cli, made: Path) -> None:
    output = made / "u.map.h5"
    found = cli("error-map", made / "part.align.h5", "-o", output, "--json").result
    rms = max(found["rms_um"], found["points"]["rms_um"])  # the worse one is judged
    ran = cli(
        "error-map",
        made / "part.align.h5",
        "--tolerance-rms",
        f"{rms}um",
        "-o",
        output,
        "--overwrite",
        "--json",
    )

    assert ran.code == 6
    assert ran.result["verdict"] == "undecided"
    assert output.is_file()


def test_an_option_beats_a_file_and_a_later_file_beats_an_earlier(
    cli: Cli, made: Path, tmp_path: Path
) -> None:
    one, two = tmp_path / "one.toml", tmp_path / "two.toml"
    one.write_text("[compensate]\ngain = 0.5\n")
    two.write_text("[compensate]\ngain = 0.6\n")
    start = ["compensate", made / "part.map.h5", "-o", made / "g.comp.h5", "--overwrite", "--json"]

    assert cli(*start, "--config", one, "--config", two).result["gain"] == 0.6
    assert cli(*start, "--config", one, "--gain", "0.9").result["gain"] == 0.9


def test_quiet_says_nothing_but_the_verdict(cli: Cli, made: Path) -> None:
    ran = cli("compensate", made / "part.map.h5", "-q", "--overwrite")

    assert (ran.code, ran.out, ran.err) == (0, "", "")
    start = ["error-map", made / "part.align.h5", "-o", made / "q.map.h5", "-q", "--overwrite"]
    assert cli(*start).out == ""
    ran = cli(*start, "--tolerance-pv", "10um")
    assert (ran.code, len(ran.out.splitlines()), ran.out[:5]) == (5, 1, "FAIL:")


def test_reports_are_plain_ascii_and_names_with_blanks_can_be_copied(cli: Cli, made: Path) -> None:
    (made / "my data").mkdir()
    output = made / "my data" / "a b.align.h5"
    ran = cli("align", made / "part.csv", made / "nominal.h5", "-o", output)

    assert ran.out.isascii()
    assert not ran.out.startswith("\n")
    assert ran.out.rstrip().endswith(f"cmm-align error-map '{output}'")


@pytest.mark.parametrize("command", KEYS)
def test_the_report_fits_on_a_screen_and_has_no_colour(
    cli: Cli, made: Path, sample_data: Path, command: str
) -> None:
    ran = cli(*arguments_of(command, made, sample_data), "--overwrite")

    assert ran.code == 0
    assert "\x1b" not in ran.out
    assert "1.5 mm" in ran.out
    assert "+z side" in ran.out
    assert len(ran.out.splitlines()) <= 30
    assert all(line == line.rstrip() for line in ran.out.splitlines())


def test_a_raw_nominal_with_a_tip_radius_is_offset_on_the_way(
    cli: Cli, made: Path, sample_data: Path
) -> None:
    output = made / "raw.align.h5"
    start = ["align", made / "part.csv", sample_data / "nominal.toml", "-o", output, "--json"]
    direct = cli(
        "align", made / "part.csv", made / "nominal.h5", "-o", made / "direct.align.h5", "--json"
    ).result

    assert cli(*start).code == 2
    assert not output.exists()
    assert cli(*start, "--tip-radius", "1.5").result["rms_um"] == pytest.approx(direct["rms_um"], abs=1e-3)


def test_several_files_are_one_measurement(cli: Cli, made: Path, tmp_path: Path) -> None:
    lines = (made / "part.csv").read_text().splitlines(keepends=True)
    (tmp_path / "a.csv").write_text("".join(lines[:3000]))
    (tmp_path / "b.csv").write_text("".join(lines[:2] + lines[3000:]))
    whole = cli("align", made / "part.csv", made / "nominal.h5", "-o", made / "w.align.h5", "--json").result
    found = cli("align", tmp_path / "a.csv", tmp_path / "b.csv", made / "nominal.h5", "--json").result

    assert found["n_points"] == whole["n_points"] == 6601
    assert found["rms_um"] == pytest.approx(whole["rms_um"], rel=1e-9)


@pytest.mark.parametrize("kind", ["matrix", "alignment"])
def test_a_start_pose_saves_steps(cli: Cli, made: Path, tmp_path: Path, kind: str) -> None:
    start = made / "part.align.h5"
    if kind == "matrix":
        with h5py.File(start) as file:
            np.savetxt(tmp_path / "start.txt", file["pose/part_from_machine"][()])
        start = tmp_path / "start.txt"
    output = tmp_path / "s.align.h5"
    found = cli(
        "align", made / "part.csv", made / "nominal.h5", "--initial", start, "-o", output, "--json"
    ).result

    assert found["iterations"] <= 4


def test_contact_points_align_like_their_centres(cli: Cli, made: Path, tmp_path: Path) -> None:
    with h5py.File(made / "part.align.h5") as file:
        contact = file["points/contact_part_mm"][()]
    np.savetxt(tmp_path / "contact.csv", contact, delimiter=",", fmt="%.9f")
    found = cli(
        "align",
        tmp_path / "contact.csv",
        made / "nominal.h5",
        "--contact-points",
        "--initial",
        "identity",
        "--json",
    ).result

    assert np.abs(np.array(found["part_from_machine"]) - np.eye(4)).max() < 1e-5


def test_info_tells_what_a_file_is(cli: Cli, made: Path, sample_data: Path) -> None:
    found = cli("info", made / "part.comp.h5", "--json").result

    assert found["schema"] == "cmm-align/correction"
    assert [step["command"] for step in found["steps"]] == ["offset", "align", "error-map", "compensate"]
    assert cli("info", made / "part.csv", "--json").result["n_points"] == 6601
    assert cli("info", sample_data / "nominal.toml").code == 0
    both = cli("info", made / "part.csv", made / "nominal.h5", "--json").json
    assert [item["n_points"] for item in both["result"]["files"][:1]] == [6601]
    assert len(both["inputs"]) == 2
    assert cli("info", made / "part.csv", "--overwrite").code == 2
    for name in ("nominal.h5", "part.align.h5", "part.map.h5", "part.comp.h5"):
        assert cli("info", made / name).code == 0
        assert cli("info", made / name, "-v").code == 0


def test_demo_closes_the_loop(cli: Cli, tmp_path: Path) -> None:
    ran = cli("demo", tmp_path / "demo", "--json")
    found = ran.result

    assert ran.code == 0
    assert found["before"]["pv_um"] == pytest.approx(27.0, rel=0.1)  # the corners lie outside the scan
    assert found["before"]["pv_um"] >= 4.0 * found["after"]["pv_um"]
    assert (tmp_path / "demo" / "before-after.png").stat().st_size > 10_000
    assert cli("demo", tmp_path / "demo").code == 8
