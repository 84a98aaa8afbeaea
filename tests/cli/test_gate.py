"""`compensate` and its gate: what it tells, what it holds back, and how loudly it is left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import Ran

from cmm_align import posts
from cmm_align.io import read_correction, read_map
from cmm_align.numerics.grid_field import interpolated
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.posts import xyz
from cmm_align.posts.commanded import points_and_normals
from cmm_align.surfaces.geometry import unit_normal

Cli = Callable[..., Ran]


@pytest.fixture
def start(made: Path, tmp_path: Path) -> list[object]:
    return ["compensate", made / "part.map.h5", "--first-pass", "--no-picture", "-o", tmp_path / "a.comp.h5"]


def written(tmp_path: Path) -> list[str]:
    return sorted(path.name for path in tmp_path.iterdir())


def test_every_export_goes_through_the_gate(cli: Cli, start: list[object], tmp_path: Path) -> None:
    ran = cli(*start, "--export", "xyzijk", "--export", "gcode-spiral", "--wheel-radius", "30mm", "--json")
    assert ran.code == 0
    gate = ran.result["gate"]
    assert (gate["skipped"], gate["passed"]) == (False, True)
    assert [one["kind"] for one in gate["exports"]] == ["xyzijk", "gcode-spiral"]
    first = gate["exports"][0]
    names = [check["name"] for check in first["checks"]]
    assert names == [
        "coverage",
        "frame",
        "sign",
        "Z against normal",
        "rounding",
        "ripple",
        "band",
        "RMS",
        "normals",
        "gouge",
    ]
    assert first["checks"][4]["value_nm"] <= 0.9
    assert first["rms_um"] < 0.25 * first["rms_before_um"]
    assert first["rms_before_um"] == pytest.approx(ran.result["before_rms_um"], rel=1e-6)
    stored = read_correction(tmp_path / "a.comp.h5").gate
    assert stored is not None
    assert [one.kind for one in stored.exports] == ["xyzijk", "gcode-spiral"]
    told = cli("info", tmp_path / "a.comp.h5")
    assert "passed (coverage, frame, sign, Z against normal, rounding" in " ".join(told.out.split())


def test_a_wrong_file_is_held_back_and_nothing_is_written(
    cli: Cli, start: list[object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def swapped(correction):
        points, normals = points_and_normals(correction)
        return np.ascontiguousarray(points[:, [1, 0, 2]]), normals

    monkeypatch.setattr(xyz, "points_and_normals", swapped)
    ran = cli(*start, "--export", "zemax", "--export", "xyz", "--ledger", tmp_path / "new.ledger")
    assert ran.code == 5
    assert ran.err.count("\n") == 1
    assert "a.comp.xyz: the gate holds this file back" in ran.err
    assert "looks like x and y swapped" in ran.err
    assert written(tmp_path) == []
    loud = cli(*start, "--export", "xyz", "--no-gate")
    assert loud.code == 0
    assert "NO GATE" in loud.err
    assert "SKIPPED" in loud.out
    assert read_correction(tmp_path / "a.comp.h5").gate.skipped
    told = cli(*start, "--no-gate", "--overwrite", "--json")
    assert told.result["gate"] == {"skipped": True, "passed": False, "exports": []}


def test_an_old_file_stays_when_the_new_one_is_held_back(
    cli: Cli, start: list[object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert cli(*start).code == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr(
        xyz, "points_and_normals", lambda c: (points_and_normals(c)[0] * [1.0, 1.0, -1.0], None)
    )
    ran = cli(*start, "--overwrite")
    assert ran.code == 5
    assert "z with the wrong sign" in ran.err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def touches_of(made: Path, folder: Path, *, turned: float = 0.1) -> Path:
    """Twelve touches of the part as it was measured, tip radius 2 mm, in the frame of a grinder."""
    deviation_map = read_map(made / "part.map.h5")
    nominal = deviation_map.alignment.nominal
    b = nominal.surface.bounds
    grid = np.meshgrid(np.array([-0.8, -0.2, 0.3, 0.85]) * b.x_max, np.array([-0.75, 0.1, 0.7]) * b.y_max)
    x, y = (a.ravel() for a in grid)
    jet = nominal.surface.jet(x, y)
    e = interpolated(deviation_map.x_mm, deviation_map.y_mm, deviation_map.deviation_mm, x, y)
    points = np.column_stack([x, y, jet.z]) + (2.0 + e)[:, None] * unit_normal(jet, nominal.side)
    pose = Pose(
        rotation_from_vector(np.array([0.02, -0.03, turned])), np.array([150.0, -60.0, 40.0]), "g", "part"
    )
    path = folder / "touches.csv"
    np.savetxt(path, pose.apply(points), fmt="%.6f", delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    return path


def test_a_part_that_was_touched_gets_its_exports_in_the_frame_of_the_grinder(
    cli: Cli, made: Path, start: list[object], tmp_path: Path
) -> None:
    touches = touches_of(made, tmp_path)
    ran = cli(
        *start,
        "--touches",
        touches,
        "--touch-radius",
        "2mm",
        *("--export", "xyzijk", "--export", "gcode-raster", "--wheel-radius", "20mm", "--json"),
    )
    assert ran.code == 0, ran.err
    assert ran.result["gate"]["passed"]
    seat = ran.result["seat"]
    assert [row[3] for row in seat["grinder_from_part"][:3]] == pytest.approx([150.0, -60.0, 40.0], abs=2e-3)
    assert (seat["n_touches"], seat["held"], seat["doubtful"]) == (12, [], [])
    assert seat["expanded_u_edge_um"] < 1.0
    assert (tmp_path / "a.comp.ijk.xyz").read_text().splitlines()[0].endswith("frame=grinder")
    assert "FRAME OF THE GRINDER" in (tmp_path / "a.comp.raster.nc").read_text()[:200]
    correction = read_correction(tmp_path / "a.comp.h5")
    assert correction.nominal.surface_from_part.source == "part"
    assert correction.seat is not None
    pose = Pose.from_matrix(np.array(correction.seat.grinder_from_part), "grinder", "part")
    found = posts.read_back(tmp_path / "a.comp.ijk.xyz", "xyzijk")
    np.testing.assert_allclose(
        pose.inverse().apply(found.points_mm), posts.points_and_normals(correction)[0], atol=1e-6
    )
    assert [one["motion"] for one in ran.result["remount"]][:2] == ["decentre x", "decentre y"]
    assert "on the grinder" in cli("info", tmp_path / "a.comp.h5").out


def test_a_file_in_the_frame_of_the_part_is_held_back_when_the_grinder_has_its_own(
    cli: Cli, made: Path, start: list[object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    touches = touches_of(made, tmp_path)

    def in_part(correction):
        part = replace(correction.nominal, surface_from_part=Pose.identity("surface", "part"))
        return points_and_normals(replace(correction, nominal=part))

    monkeypatch.setattr(xyz, "points_and_normals", in_part)
    ran = cli(*start, "--touches", touches, "--touch-radius", "2mm")
    assert ran.code == 5
    assert "looks like the frame of the part" in ran.err
    assert written(tmp_path) == ["touches.csv"]


@pytest.mark.parametrize(
    ("options", "words"),
    [(["--touch-radius", "2mm"], "go together"), (["--touches", "touches.csv"], "go together")],
)
def test_touches_and_their_radius_go_together(
    cli: Cli, made: Path, start: list[object], tmp_path: Path, options: list[str], words: str
) -> None:
    touches_of(made, tmp_path)
    options = [str(tmp_path / word) if word.endswith(".csv") else word for word in options]
    ran = cli(*start, *options)
    assert (ran.code, words in ran.err) == (2, True)


def test_touches_in_the_frame_of_the_part_are_refused(
    cli: Cli, made: Path, start: list[object], tmp_path: Path
) -> None:
    touches = touches_of(made, tmp_path)
    head = "# cmm-align points v1; units=mm; kind=tip_centre; frame=part\n"
    touches.write_text(head + touches.read_text())
    ran = cli(*start, "--touches", touches, "--touch-radius", "2mm")
    assert (ran.code, "is in the frame of the part" in ran.err) == (3, True)
    assert written(tmp_path) == ["touches.csv"]
