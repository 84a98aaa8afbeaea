"""The choices of `align` on the command line: what they write, what they say, and what they refuse."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Ran

from cmm_align import io

Cli = Callable[..., Ran]
HEAD = "# cmm-align points v1; units=mm; kind=tip_centre; frame=machine\n"


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory, sample_data: Path) -> Path:
    """A nominal, a light scan with ids and uncertainties, and an earlier alignment of it."""
    folder = tmp_path_factory.mktemp("shop")
    shutil.copy(sample_data / "nominal.h5", folder)
    points = np.loadtxt(sample_data / "part.csv", delimiter=",", skiprows=2)[::5]
    lines = [f"{x:.6f},{y:.6f},{z:.6f},{1000 + k},0.0003" for k, (x, y, z) in enumerate(points)]
    text = HEAD + "x_mm,y_mm,z_mm,id,sigma_mm\n" + "\n".join(lines) + "\n"
    (folder / "part.csv").write_text(text)
    return folder


@pytest.fixture(scope="module")
def ids(shop: Path) -> range:
    return range(1000, 1000 + len((shop / "part.csv").read_text().splitlines()) - 2)


@pytest.fixture
def run(cli: Cli, shop: Path, tmp_path: Path) -> Callable[..., Ran]:
    """Align the scan with some options; the output goes to a folder of its own."""

    def align(*options: object) -> Ran:
        return cli(
            "align", shop / "part.csv", shop / "nominal.h5", "-o", tmp_path / "a.h5", "--json", *options
        )

    return align


def test_everything_at_once_comes_back_from_the_file(run, shop, tmp_path, cli):
    start = tmp_path / "start.h5"
    cli("align", shop / "part.csv", shop / "nominal.h5", "-o", start)
    log = tmp_path / "log.csv"
    ran = run(
        *(
            "--initial",
            start,
            "--lock",
            "rz",
            "--fit-region",
            "circle:0,0,40",
            "--report-region",
            "aperture:-2mm",
        ),
        *("--weights", "area", "--monte-carlo", 50, "--mpe", "0.7+L/400", "--bidirectional"),
        *("--limit", "wedge=60", "--limit", "thickness=500um", "--log-iterations", log),
    )
    assert ran.code == 0, ran.err
    result = ran.result
    assert result["locked"] == ["rz"]
    assert result["weights"] == "area"
    assert result["fit_region"] == "circle of radius 40 mm about (0, 0)"
    assert result["n_apart"] > 0
    assert 0 < result["n_judged"] < result["n_points"]
    assert result["removed_motion"]["verdict"] == "pass"
    assert result["monte_carlo"]["n"] == 50
    assert result["bidirectional"]["forward"]["n"] == result["n_used"]
    back = io.read_alignment(tmp_path / "a.h5")
    assert back.report.monte_carlo is not None
    assert back.report.knowledge is not None
    assert back.report.bidirectional is not None
    assert back.sigma_mm is not None
    with log.open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["phase"] for row in rows] == [step.phase for step in back.report.steps]
    assert float(rows[-1]["cost_mm2"]) == back.report.steps[-1].cost_mm2
    mapped = cli("error-map", tmp_path / "a.h5", "--json", "--no-picture")
    assert mapped.code == 0, mapped.err
    assert mapped.result["u_rms_um"] >= result["monte_carlo"]["rms"]["std_um"]


def test_the_exit_code_tells_whether_any_position_passes(run, shop, tmp_path, ids):
    assert run("--tolerance", "1mm").code == 0
    ran = run("--tolerance", "-2um,3um", "--overwrite")
    assert ran.code == 5
    assert (tmp_path / "a.h5").exists()
    assert ran.result["certificate"]["zone_um"] > 0.0
    assert set(ran.result["proof_ids"]) <= set(ids)
    table = tmp_path / "limits.csv"
    table.write_text("id,lower_um,upper_um\n" + "".join(f"{n},-500,\n" for n in ids))
    assert run("--tolerance", table, "--overwrite").code == 0


def test_limits_of_the_hidden_motion_make_a_verdict(run, tmp_path, shop, cli):
    start = tmp_path / "start.h5"
    cli("align", shop / "part.csv", shop / "nominal.h5", "-o", start)
    moved = io.read_alignment(start).part_from_machine.matrix()
    moved[2, 3] += 0.1  # as its datums lie, the surface stands 100 um proud of the nominal
    pose = tmp_path / "datum.txt"
    np.savetxt(pose, moved, fmt="%.17g")
    ran = run("--initial", pose, "--limit", "thickness=20")
    assert ran.code == 5
    assert ran.result["removed_motion"]["thickness"]["change_um"] == pytest.approx(100.0, abs=2.0)
    assert run("--initial", pose, "--limit", "thickness=500", "--overwrite").code == 0


def test_a_reference_method_says_that_it_is_one(run):
    ran = run("--method", "xiong")
    assert ran.code == 0
    assert ran.result["method"] == "xiong"


def refused(ran: Ran, folder: Path, code: int, *words: str) -> None:
    assert ran.code == code, ran.err
    assert len(ran.err.splitlines()) == 1
    for word in words:
        assert word in ran.err
    assert not (folder / "a.h5").exists()


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("--lock", "rx,ry,rz,tx,ty,tz"), 2, ("all six",)),
        (("--lock", "rz", "--initial", "search"), 2, ("a search",)),
        (("--lock", "bend"), 2, ("bend", "rx, ry")),
        (("--fit-region", "circle:900,0,3"), 3, ("0 points steer the fit", "at least 7", "rx, ry, rz")),
        (("--fit-region", "circle:0,0"), 2, ("--fit-region", "circle:X,Y,R")),
        (("--fit-region", "ring.toml"), 3, ("ring.toml",)),
        (("--report-region", "circle:900,0,3"), 2, ("report region",)),
        (("--weights", "missing.csv"), 2, ("missing.csv", "area")),
        (("--initial", "serach"), 2, ("serach", "search")),
        (("--temperature", "24"), 2, ("does nothing alone", "--expansion")),
        (("--centre", "1,2,3"), 2, ("does nothing alone", "--lock")),
        (("--tolerance", "0,01"), 2, ("decimal comma",)),
        (("--scale", "free", "--lock", "tx"), 2, ("free scale",)),
        (("--iterations", "0", "--criterion", "minimum-zone"), 2, ("--iterations 0",)),
        (("--weights", "stated"), 2, ("column weight",)),
        (("--tolerance", "missing.csv"), 2, ("missing.csv",)),
        (("--tolerance", "3um,-2um"), 2, ("LOW below HIGH",)),
        (("--tolerance", "5um", "--criterion", "minimum-zone"), 2, ("one or the other",)),
        (("--criterion", "within-tolerance"), 2, ("--tolerance",)),
        (("--fiducials", "missing.csv"), 3, ("missing.csv",)),
        (("--limit", "wedge"), 2, ("wedge=VALUE in arcmin",)),
        (("--limit", "height=3"), 2, ("thickness=VALUE in um",)),
        (("--limit", "wedge=-3"), 2, ("wedge=VALUE",)),
        (("--monte-carlo", "100"), 2, ("--mpe",)),
        (("--monte-carlo", "100", "--mpe", "good"), 2, ("good", "0.7+L/400")),
        (("--method", "icp", "--lock", "rz"), 2, ("icp", "lock")),
        (("--expansion", "7.1", "--temperature", "24"), 2, ("expansion_per_k",)),
        (("--temperature", "2000", "--expansion", "7e-6"), 2, ("temperature_c",)),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(run, tmp_path, options, code, words):
    refused(run(*options), tmp_path, code, *words)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("id,weight\n" + "".join(f"{n},-1\n" for n in range(1000, 2400)), (":2:", "-1")),
        ("id,weight\n" + "".join(f"{n},0\n" for n in range(1000, 2400)), ("all weights are 0",)),
        ("id,weight\n1,1\n2,1\n", ("1000",)),
    ],
)
def test_weights_that_cannot_be_are_refused(run, tmp_path, content, words):
    table = tmp_path / "weights.csv"
    table.write_text(content)
    refused(run("--weights", table), tmp_path, 3, *words)


def test_a_tolerance_table_with_other_ids_is_refused(run, tmp_path):
    table = tmp_path / "limits.csv"
    table.write_text("id,lower_um,upper_um\n1,-5,5\n2,-5,5\n")
    refused(run("--tolerance", table), tmp_path, 3, "limits.csv", "1000")


def test_points_beside_the_aperture_are_no_measurement(cli, shop, tmp_path):
    """All points of the bench next to the part: flat, and nowhere near the nominal."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(300, 400, 20), np.linspace(0, 60, 12)))
    rows = "".join(f"{a:.4f},{b:.4f},{0.01 * np.sin(a):.5f}\n" for a, b in zip(x, y, strict=True))
    (tmp_path / "bench.csv").write_text(HEAD + "x_mm,y_mm,z_mm\n" + rows)
    ran = cli(
        *("align", tmp_path / "bench.csv", shop / "nominal.h5", "-o", tmp_path / "a.h5", "--iterations", "0"),
        *("--initial", "identity"),
    )
    assert ran.code in (3, 4)
    assert not (tmp_path / "a.h5").exists()


def test_what_the_stage_noticed_is_shown(cli, shop, tmp_path):
    """A file without a header, a touch on dirt: the operator is told of both."""
    points = np.loadtxt(shop / "part.csv", delimiter=",", skiprows=2)[:, :3]
    points[7, 2] += 0.4
    np.savetxt(tmp_path / "bare.csv", points, fmt="%.6f", delimiter=",")
    ran = cli("align", tmp_path / "bare.csv", shop / "nominal.h5", "-v")
    assert ran.code == 0
    assert "taken for tip centres" in ran.err
    assert "1 outlier was left out: point 7" in ran.err
    assert "point 7 at (" in ran.out
    shown = cli("align", tmp_path / "bare.csv", shop / "nominal.h5", "--json", "--overwrite").json
    assert any("taken for tip centres" in text for text in shown["warnings"])
    assert [point["id"] for point in shown["result"]["outliers"]] == [7]


def test_a_recording_of_the_port_is_captured_and_aligned_in_one_go(cli, shop, tmp_path):
    points = np.loadtxt(shop / "part.csv", delimiter=",", skiprows=2)[:, :3]
    (tmp_path / "dump.txt").write_bytes(b"".join(b"%.6f,%.6f,%.6f\r\n" % tuple(row) for row in points))
    once = cli("align", f"replay://{tmp_path / 'dump.txt'}", shop / "nominal.h5", "--json")
    assert once.code == 0, once.err
    twice = cli("align", tmp_path / "dump.txt", shop / "nominal.h5", "--json", "-o", tmp_path / "b.h5")
    assert once.result["part_from_machine"] == twice.result["part_from_machine"]
    (tmp_path / "cut.txt").write_bytes((tmp_path / "dump.txt").read_bytes()[:-5])
    cut = cli("align", f"replay://{tmp_path / 'cut.txt'}", shop / "nominal.h5")
    assert cut.code == 7
    assert "not complete" in cut.err
    assert not (tmp_path / "cut.align.h5").exists()


def test_rows_that_are_left_out_are_told_and_fail_under_strict(cli, shop, tmp_path):
    """A column of quality: one touch that the machine calls bad."""
    points = np.loadtxt(shop / "part.csv", delimiter=",", skiprows=2)[:, :3]
    rows = [f"{x:.6f};{y:.6f};{z:.6f};{'NOK' if k == 4 else 'OK'}" for k, (x, y, z) in enumerate(points)]
    (tmp_path / "q.csv").write_text("X [mm];Y [mm];Z [mm];Quality\n" + "\n".join(rows) + "\n")
    ran = cli("align", tmp_path / "q.csv", shop / "nominal.h5", "--json")
    assert ran.code == 0, ran.err
    assert ran.result["n_points"] == len(points) - 1
    assert len(ran.result["passed_over"]) == 1
    assert "q.csv:6" in ran.json["warnings"][0]
    strict = cli("align", tmp_path / "q.csv", shop / "nominal.h5", "--strict", "--overwrite")
    assert strict.code == 3
    assert "q.csv:6" in strict.err


def test_a_text_with_two_readings_names_the_flag_that_settles_it(cli, shop, tmp_path):
    points = np.loadtxt(shop / "part.csv", delimiter=",", skiprows=2)[:, :3]
    rows = [";".join(f"{value:.3f}".replace(".", ",") for value in row) for row in points]
    (tmp_path / "de.csv").write_text("\n".join(rows) + "\n")
    asked = cli("align", tmp_path / "de.csv", shop / "nominal.h5", "--decimal", ",")
    assert asked.code == 0, asked.err
