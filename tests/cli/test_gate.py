"""`compensate` and its gate: what it tells, what it holds back, and how loudly it is left out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Ran

from cmm_align.io import read_correction
from cmm_align.posts import xyz
from cmm_align.posts.commanded import points_and_normals

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
    ran = cli(*start, "--export", "zemax", "--export", "xyz")
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
