"""Gouges, air cuts and shifted paths, on surfaces in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from truth_corrections import ON_ITS_SIDE, Bowl, Rippled, correction_to

from cmm_align.config import CompensateConfig
from cmm_align.errors import InputError, UsageError
from cmm_align.numerics.wheel import Wheel
from cmm_align.stages.wheel_check import check_depth, check_wheel, refuse_gouge, wheel_of


@pytest.mark.parametrize("turn", [None, ON_ITS_SIDE], ids=["upright", "on its side"])
@pytest.mark.parametrize("side", [1, -1])
def test_a_sphere_is_filled_by_the_ratio_of_the_radii(side, turn):
    c = correction_to(Bowl(side * 60.0), side=side, surface_from_part=turn)
    found = check_wheel(c, Wheel(45.0))
    assert found.fill == pytest.approx(0.75, abs=1e-6)
    assert found.overcut_mm < 1e-9
    assert found.slope_change_rad == 0.0
    refuse_gouge(found)
    assert check_wheel(correction_to(Bowl(-side * 60.0), side=side), Wheel(45.0)).fill < 0.0


def test_a_wheel_larger_than_the_bowl_gouges_by_what_the_circles_say():
    with pytest.raises(InputError, match="gouges") as caught:
        refuse_gouge(check_wheel(correction_to(Bowl(40.0)), Wheel(60.0)))
    assert "150 % of the wheel's" in str(caught.value)
    # touching one corner, the wheel reaches farthest past the bowl in the opposite one
    corner = np.array([20.0, 15.0])
    n = np.append(-corner, np.sqrt(40.0**2 - 625.0)) / 40.0
    first = np.append(corner, 40.0 - np.sqrt(40.0**2 - 625.0))
    other = np.append(-corner, first[2])
    deep = 60.0 - np.linalg.norm(other - first - 60.0 * n)
    assert check_wheel(correction_to(Bowl(40.0)), Wheel(60.0)).overcut_mm == pytest.approx(deep, rel=1e-12)


def test_a_ripple_of_the_correction_counts_by_its_curvature():
    """rho = 60 bowl plus a ripple: 1/60 + 2 a k^2 at its troughs along both axes' sum; here along x."""
    c = correction_to(Rippled(Bowl(60.0), 0.005, 8.0), Bowl(60.0), step_mm=0.25)
    k = 2.0 * np.pi / 8.0
    found = check_wheel(c, Wheel(30.0))
    assert found.fill == pytest.approx(30.0 * (1 / 60 + 0.005 * k * k), rel=0.01)
    assert found.slope_change_rad == pytest.approx(0.005 * k, rel=0.02)
    assert found.old_normals_mm == pytest.approx(30.0 * found.slope_change_rad**2 / 2, rel=1e-4)
    with pytest.raises(InputError, match="gouges"):
        refuse_gouge(check_wheel(c, Wheel(55.0)))


def test_a_step_elsewhere_is_met_although_the_curvature_is_small():
    """A slope of 45 degrees that a wheel reaches from afar: only the measured overcut sees it."""
    bowl = Bowl(30.0, half_x=22.0, half_y=4.0)
    c = correction_to(bowl, step_mm=0.5)
    cut = replace(
        c,
        commanded_z_mm=np.where(np.abs(c.x_mm) < 3.0, 5.0 * np.ones_like(c.commanded_z_mm), c.commanded_z_mm),
    )
    assert check_wheel(cut, Wheel(10.0)).overcut_mm > 1.0


def test_a_torus_fits_a_groove_along_its_axis_only():
    """Radius 50 with a rim of 8: across its axis the wheel is as sharp as its rim, in its plane it is not."""
    bowl = correction_to(Bowl(20.0, half_x=6.0, half_y=6.0), step_mm=0.25)
    assert check_wheel(bowl, Wheel(19.0)).overcut_mm < 1e-9
    assert check_wheel(bowl, Wheel(50.0, 8.0)).fill == pytest.approx(50.0 / 20.0, rel=0.05)
    turned = correction_to(Bowl(20.0, half_x=6.0, half_y=6.0), step_mm=0.25, surface_from_part=ON_ITS_SIDE)
    along = check_wheel(turned, Wheel(50.0, 8.0, (0.0, 0.0, 1.0)))  # frame `part`: y of the surface
    same = check_wheel(bowl, Wheel(50.0, 8.0, (0.0, 1.0, 0.0)))
    assert along.fill == pytest.approx(same.fill, rel=1e-12)
    assert along.overcut_mm == pytest.approx(same.overcut_mm, rel=1e-9)


def test_air_cuts_are_refused_with_the_depth_that_is_needed():
    c = correction_to(Rippled(Bowl(60.0), 0.005, 8.0), Bowl(60.0))
    span = float(np.nanmax(c.correction_mm) - np.nanmin(c.correction_mm)) * 1e3
    assert check_depth(c, CompensateConfig()) is None
    with pytest.raises(InputError, match="in air") as caught:
        check_depth(c, CompensateConfig(depth_of_cut_um=span + 1.9))
    assert f"at least {span + 2.0:.2f} um" in str(caught.value)
    found = check_depth(c, CompensateConfig(depth_of_cut_um=span + 2.1))
    assert found is not None
    assert found.least_mm == pytest.approx(2.1e-3)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"wheel_tip_radius_mm": 5.0}, "without its radius"),
        ({"wheel_radius_mm": 4.0, "wheel_tip_radius_mm": 5.0}, "below --wheel-radius"),
        ({"wheel_radius_mm": 4.0, "wheel_axis": "w"}, "wheel axis"),
        ({"wheel_radius_mm": 4.0, "wheel_axis": "0,0,0"}, "wheel axis"),
    ],
)
def test_a_wheel_that_cannot_be_is_refused(settings, words):
    with pytest.raises(UsageError, match=words):
        wheel_of(CompensateConfig(**settings))


def test_the_wheel_of_the_settings():
    assert wheel_of(CompensateConfig()) is None
    found = wheel_of(CompensateConfig(wheel_radius_mm=50.0, wheel_tip_radius_mm=8.0, wheel_axis="0, 3, 4"))
    assert found == Wheel(50.0, 8.0, (0.0, 0.6, 0.8))
