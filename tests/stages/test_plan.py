"""A measuring plan: nested lattices, an order that goes forward, errors that are measured."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cmm_align.config import OffsetConfig
from cmm_align.errors import UsageError
from cmm_align.model import PointKind, PointSet
from cmm_align.stages.offset import offset
from cmm_align.stages.plan import DENSITY, plan
from cmm_align.surfaces.envelope import edge_band_mm
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.virtual.window import window

SPHERE = """
schema = "cmm-align/prescription/1"
units = "mm"
[aperture]
shape = "circle"
radius = 20.0
[[term]]
kind = "conic"
radius = -100.0
"""
SPACING = 1.0


@pytest.fixture(scope="module")
def sphere():
    return offset(prescription_from_toml(SPHERE, "sphere.toml"), 1.5)


@pytest.fixture(scope="module")
def ridged():
    """A plane with a soft ridge along y, 5 mm wide: a feature that the ball reaches."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-20, 20, 201), np.linspace(-12, 12, 121)))
    z = 0.5 * np.exp(-((x / 2.0) ** 2))
    return offset(PointSet.of(np.stack([x, y, z], axis=1), kind=PointKind.NOMINAL, frame="part"), 0.5)


def test_points_lie_on_the_nominal_inside_the_edge_band_with_its_normals(sphere):
    made = plan(sphere, OffsetConfig(plan_spacing_mm=SPACING))
    x, y, z = made.points_mm.T
    jet = sphere.surface.jet(x, y)

    np.testing.assert_allclose(z, jet.z, atol=1e-12)
    np.testing.assert_allclose(made.normals, unit_normal(jet, 1), atol=1e-12)
    band = edge_band_mm(1.5, np.array([-0.01]), 0.01)[0]
    assert np.hypot(x, y).max() < 20.0 - band + 1e-3
    assert len(made) == pytest.approx(np.pi * 19.8**2, rel=0.03)


def test_facets_of_the_plan_are_as_far_off_as_the_formula_says(sphere):
    made = plan(sphere, OffsetConfig(plan_spacing_mm=SPACING))

    # h^2 k / 4, and up to 1 + slope^2 = 1.04 of it on the slope; the ball's sphere is 1.5 % larger.
    assert made.facet_error_pv_nm == pytest.approx(1e6 * SPACING**2 / 100.0 / 4.0, rel=0.06)
    assert made.facet_error_pv_nm <= made.facet_error_predicted_nm


def test_the_bound_on_the_facets_chooses_the_spacing_until_the_count_stops_it(sphere):
    fine = plan(sphere, OffsetConfig(plan_facet_error_um=1.0, plan_points=10_000))
    few = plan(sphere, OffsetConfig(plan_facet_error_um=1.0, plan_points=1000))

    assert "within 1 um" in fine.chosen_by
    assert 0.8e3 < fine.facet_error_pv_nm <= 1e3
    assert "1000" in few.chosen_by
    assert 750 < len(few) <= 1050


def test_features_get_five_times_the_points_without_doubles_or_gaps(ridged):
    made = plan(ridged, OffsetConfig(plan_spacing_mm=SPACING))
    x, y = made.places_mm.T

    assert made.dense.any()
    assert (np.abs(x[made.dense]) < 9.0).all()
    gap = cKDTree(made.places_mm).query(made.places_mm, k=2)[0][:, 1]
    np.testing.assert_allclose(gap[made.dense].min(), SPACING / np.sqrt(DENSITY), rtol=1e-9)
    np.testing.assert_allclose(gap[np.abs(x) > 12.0], SPACING, rtol=1e-9)
    high = np.abs(y - 0.017) < 5.0  # whole cells of the lattice, its points not on the border of the window
    assert np.count_nonzero(high & (np.abs(x - 0.013) < 2.0)) == DENSITY * 4 * 10
    assert np.count_nonzero(high & (np.abs(x - 14.013) < 2.0)) == 4 * 10
    # Nowhere inside is a place further from a point than in the base lattice alone.
    rng = np.random.default_rng(1)
    inside = rng.uniform(-1, 1, (4000, 2)) * (np.abs(x).max(), np.abs(y).max())
    assert cKDTree(made.places_mm).query(inside)[0].max() <= SPACING / np.sqrt(2.0) + 1e-9


def test_denser_points_make_better_facets(ridged):
    with_features = plan(ridged, OffsetConfig(plan_spacing_mm=SPACING))
    without = plan(ridged, OffsetConfig(plan_spacing_mm=SPACING, feature_curvature_per_mm=10.0))

    assert not without.dense.any()
    assert with_features.facet_error_pv_nm < 0.45 * without.facet_error_pv_nm


def test_the_path_goes_to_and_fro_and_never_back_inside_a_strip(ridged):
    made = plan(ridged, OffsetConfig(plan_spacing_mm=SPACING))
    x, y = made.places_mm.T
    strip = np.floor((y - y[~made.dense].min()) / SPACING + 0.5).astype(int)

    steps = np.diff(strip)
    assert ((steps == 0) | (steps == 1)).all()
    for k in np.unique(strip):
        forward = np.diff(x[strip == k])
        assert (forward > 0).all() if k % 2 == 0 else (forward < 0).all()
    assert made.path_mm < 1.3 * SPACING * len(made)
    assert made.time_s == pytest.approx(made.path_mm / 10.0 + len(made))


def test_what_the_ball_does_not_reach_is_left_out():
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-10, 10, 201), np.linspace(-6, 6, 61)))
    z = -0.8 * np.exp(-((x / 0.9) ** 2))
    nominal = offset(PointSet.of(np.stack([x, y, z], axis=1), kind=PointKind.NOMINAL, frame="part"), 1.5)

    made = plan(nominal, OffsetConfig(plan_spacing_mm=0.5))

    assert made.n_not_reached > 0
    assert np.abs(made.points_mm[:, 0]).min() > 0.3
    assert made.facet_error_pv_nm < made.facet_error_predicted_nm


def test_the_plan_of_the_window_says_what_it_shows():
    made = plan(offset(window(), 1.5))

    assert 4500 < len(made) <= 5100
    assert made.shortest_wavelength_mm == pytest.approx(2.0 * made.spacing_mm)
    assert made.practical_wavelength_mm == pytest.approx(5.0 * made.spacing_mm)
    assert not made.dense.any()


@pytest.mark.parametrize("spacing", [-1.0, 30.0])
def test_a_spacing_that_makes_no_plan_is_refused(sphere, spacing):
    with pytest.raises(UsageError, match="spacing"):
        plan(sphere, OffsetConfig(plan_spacing_mm=spacing))
