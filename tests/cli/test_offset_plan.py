"""`offset --plot --plan`: what is written, what is said, and that the plan is no measurement."""

import numpy as np
import pytest

from cmm_align import files
from cmm_align.model import PointKind, PointSet


@pytest.fixture
def nominal_file(tmp_path):
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-6, 6, 61), np.linspace(-4, 4, 41)))
    z = -0.8 * np.exp(-((x / 0.9) ** 2))
    points = PointSet.of(np.stack([x, y, z], axis=1), kind=PointKind.NOMINAL, frame="part")
    files.write_points(tmp_path / "groove.csv", points)
    return tmp_path / "groove.csv"


def test_plan_and_pictures_lie_beside_the_output(cli, nominal_file):
    ran = cli("offset", nominal_file, "--tip-radius", "1.5", "--plot", "--plan", "--spacing", "0.5", "--json")

    assert ran.code == 0
    folder = nominal_file.parent
    written = ["groove.h5", "groove.png", "groove.plan.csv", "groove.plan.png"]
    assert [p.rsplit("/", 1)[-1] for p in ran.json["outputs"]] == written
    assert all((folder / name).stat().st_size > 0 for name in written)
    plan = ran.result["plan"]
    points = files.read(folder / "groove.plan.csv")
    assert points.kind is PointKind.NOMINAL
    assert len(points) == plan["n_points"]
    assert plan["spacing_mm"] == 0.5
    lines = (folder / "groove.plan.csv").read_text(encoding="ascii").splitlines()
    assert "contact points on the nominal" in lines[1]
    assert lines[4] == "x_mm,y_mm,z_mm,i,j,k"


def test_a_ball_that_is_too_large_is_warned_of_with_place_and_remedy(cli, nominal_file):
    ran = cli("offset", nominal_file, "--tip-radius", "1.5", "--json")

    (text,) = [w for w in ran.json["warnings"] if "does not fit" in w]
    radius = ran.result["largest_ball_radius_mm"]
    assert radius == pytest.approx(0.9**2 / (2 * 0.8), rel=1e-3)  # of exp at its bottom
    assert f"a ball of radius {radius:.3g} mm or less fits" in text
    assert "at x = " in text
    assert ran.result["n_not_reached"] > 0
    fits = cli("offset", nominal_file, "--tip-radius", "0.45", "--overwrite", "--json")
    assert fits.result["n_not_reached"] == 0


def test_the_plan_is_not_taken_for_a_measurement(cli, nominal_file):
    cli("offset", nominal_file, "--tip-radius", "0.4", "--plan")

    ran = cli("align", nominal_file.parent / "groove.plan.csv", nominal_file.parent / "groove.h5")

    assert ran.code == 3
    assert "not measured" in ran.err
