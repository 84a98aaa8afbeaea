import closed_forms as cf
import numpy as np
import pytest

from cmm_align.config import OffsetConfig
from cmm_align.errors import GeometryError, UsageError, WrongStageError
from cmm_align.model import PointKind, PointSet
from cmm_align.stages.offset import offset
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml

FREEFORM = """
schema = "cmm-align/prescription/1"
units = "mm"
[aperture]
shape = "rectangle"
width = 40.0
height = 30.0
[[term]]
kind = "conic"
radius = -60.0
conic = -0.4
[[term]]
kind = "xy_polynomial"
coefficients = { "1,1" = 1e-3, "3,0" = 1e-4, "0,3" = -5e-5 }
"""


def nominal_points(surface, half=(20.0, 15.0), step=0.5, order="x fastest"):
    x, y = np.meshgrid(
        np.arange(-half[0], half[0] + step / 2, step), np.arange(-half[1], half[1] + step / 2, step)
    )
    if order == "y fastest":
        x, y = x.T, y.T
    x, y = x.ravel(), y.ravel()
    return np.stack([x, y, surface.jet(x, y).z], axis=1)


def as_nominal(points):
    return PointSet.of(points, kind=PointKind.NOMINAL, frame="part", source="nominal.csv")


@pytest.fixture(scope="module")
def freeform():
    return prescription_from_toml(FREEFORM, "freeform.toml")


@pytest.mark.parametrize("order", ["x fastest", "y fastest"])
def test_a_grid_is_recognised_in_either_order(freeform, order):
    nominal = offset(as_nominal(nominal_points(freeform, order=order)), 1.5)

    assert nominal.kind == "grid"
    assert nominal.quality.n_points == 81 * 61
    assert nominal.quality.spacing_mm == pytest.approx((0.5, 0.5))


def test_a_grid_with_unequal_steps_and_a_hole_is_a_grid_that_is_not_defined_in_the_hole(freeform):
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-20, 20, 161), np.linspace(-15, 15, 61)))
    keep = np.hypot(x - 5, y) > 4.0
    points = np.stack([x, y, freeform.jet(x, y).z], axis=1)[keep]

    nominal = offset(as_nominal(np.random.default_rng(1).permutation(points)), 1.5)

    assert nominal.kind == "grid"
    assert nominal.quality.n_points == keep.sum()
    assert not nominal.surface.contains(np.array([5.0]), np.array([0.0]))[0]
    rng = np.random.default_rng(2)
    u, v = rng.uniform(-20, 20, 4000), rng.uniform(-15, 15, 4000)
    inside = nominal.surface.contains(u, v)
    error = (nominal.surface.jet(u, v).z - freeform.jet(u, v).z)[inside]
    assert np.ptp(error) < 1e-7  # mm: 0.1 nm, also beside the hole


def test_the_error_estimate_of_a_grid_is_honest(freeform):
    nominal = offset(as_nominal(nominal_points(freeform)), 1.5)
    rng = np.random.default_rng(3)
    u, v = rng.uniform(-20, 20, 20_000), rng.uniform(-15, 15, 20_000)

    true_pv_nm = 1e6 * np.ptp(nominal.surface.jet(u, v).z - freeform.jet(u, v).z)

    assert nominal.quality.surface_error_pv_nm > true_pv_nm / 3
    assert nominal.quality.surface_error_pv_nm < true_pv_nm * 10 + 1e-4


def test_printed_decimals_do_not_hide_the_grid(freeform):
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-20, 20, 122), np.linspace(-15, 15, 92)))
    points = np.round(np.stack([x, y, freeform.jet(x, y).z], axis=1), 5)

    nominal = offset(as_nominal(points), 1.5)

    assert nominal.kind == "grid"
    rng = np.random.default_rng(4)
    u, v = rng.uniform(-19, 19, 5000), rng.uniform(-14, 14, 5000)
    # Half a print step in x, y (slopes below 1) and z: 1e-5 mm in all, at most doubled by the spline.
    assert np.abs(nominal.surface.jet(u, v).z - freeform.jet(u, v).z).max() < 2e-5


@pytest.mark.parametrize("side", ["+z", "-z"])
def test_equidistant_points_of_a_torus_lie_on_the_larger_torus(side):
    torus = cf.Torus()
    nominal = offset(as_nominal(nominal_points(torus, half=(16.0, 16.0))), 1.5, OffsetConfig(side=side))
    points = nominal.equidistant.points_mm
    axis_z = -(torus.major_mm + torus.minor_mm)
    rho = np.hypot(points[:, 0], points[:, 2] - axis_z) - torus.major_mm
    profile = np.hypot(rho, points[:, 1])

    # The spline's slopes are good to 1e-9 here: 1.5 mm times that.
    np.testing.assert_allclose(profile, torus.minor_mm + (1.5 if side == "+z" else -1.5), atol=3e-9)


def test_equidistant_points_of_a_formula_are_exact(freeform):
    nominal = offset(freeform, 1.5)
    points = nominal.equidistant.nominal_points_mm
    jet = freeform.jet(points[:, 0], points[:, 1])

    np.testing.assert_allclose(nominal.equidistant.points_mm - points, 1.5 * unit_normal(jet, 1), atol=1e-13)
    assert nominal.quality.surface_error_pv_nm == 0.0
    assert nominal.quality.equidistant_error_pv_nm < 0.1


def test_scattered_points_get_a_smooth_surface_with_a_stated_error(freeform):
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-20, 20, 40_000), rng.uniform(-15, 15, 40_000)

    nominal = offset(as_nominal(np.stack([x, y, freeform.jet(x, y).z], axis=1)), 1.5)

    assert nominal.kind == "scattered"
    u, v = rng.uniform(-19.5, 19.5, 5000), rng.uniform(-14.5, 14.5, 5000)
    error_nm = 1e6 * np.ptp(nominal.surface.jet(u, v).z - freeform.jet(u, v).z)
    assert error_nm < 0.1
    assert nominal.quality.surface_error_pv_nm > error_nm / 10


def test_the_facet_error_of_a_sphere_is_h_squared_k_over_4():
    radius, step = 100.0, 1.0
    sphere = cf.Sphere(radius_mm=-radius)
    nominal = offset(as_nominal(nominal_points(sphere, half=(10.0, 10.0), step=step)), 1e-3)

    # Near the vertex the middle of the diagonal sags h^2 k / 4; slopes to 8 degrees add 2 %.
    assert nominal.quality.facet_error_pv_nm == pytest.approx(1e6 * step**2 / radius / 4.0, rel=0.04)


def test_a_ball_that_is_too_large_is_marked_where_it_does_not_fit():
    bowl = cf.Paraboloid(a_mm=4.0, b_mm=4.0)  # radius of curvature 4 mm at the vertex, growing outwards

    nominal = offset(as_nominal(nominal_points(bowl, half=(4.0, 4.0), step=0.1)), 5.0)

    assert not nominal.quality.regular
    assert nominal.quality.min_concave_radius_mm == pytest.approx(4.0, rel=1e-3)
    assert nominal.quality.min_concave_at_mm == pytest.approx((0.0, 0.0), abs=0.06)
    near = np.hypot(*nominal.equidistant.nominal_points_mm[:, :2].T) < 0.5
    assert not nominal.equidistant.regular[near].any()
    assert nominal.equidistant.regular[~near].any()


def test_a_ball_that_fits_nowhere_is_refused():
    with pytest.raises(GeometryError, match="fits nowhere"):
        offset(as_nominal(nominal_points(cf.Sphere(radius_mm=30.0), half=(10, 10))), 40.0)


def test_a_dome_has_no_concave_radius():
    nominal = offset(as_nominal(nominal_points(cf.Sphere(radius_mm=-60.0), half=(10, 10))), 1.5)

    assert nominal.quality.min_concave_radius_mm is None
    assert nominal.quality.regular


def test_a_nominal_that_stands_upright_is_turned(freeform):
    flat = nominal_points(freeform)
    upright = flat[:, [2, 0, 1]]  # z of the design along the part's x

    nominal = offset(as_nominal(upright), 1.5)

    assert nominal.kind == "grid"
    np.testing.assert_allclose(nominal.surface_from_part.apply(upright), flat, atol=1e-12)
    assert np.linalg.det(nominal.surface_from_part.rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(nominal.equidistant.nominal_points_mm, upright, atol=1e-9)


def test_a_surface_that_folds_back_is_refused():
    rng = np.random.default_rng(6)
    ball = rng.normal(size=(3000, 3))
    ball *= 20.0 / np.linalg.norm(ball, axis=1, keepdims=True)

    with pytest.raises(GeometryError, match="no height field"):
        offset(as_nominal(ball), 1.5)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda p: p[:20], GeometryError, "20 nominal points"),
        (lambda p: np.vstack([p, p[:1] + np.array([0, 0, 0.1])]), GeometryError, "differ in z"),
        (lambda p: np.outer(np.arange(100.0), [1.0, 2.0, 0.5]), GeometryError, "no height field|line"),
    ],
    ids=["too few", "two heights", "a line"],
)
def test_nominal_points_that_carry_no_surface_are_refused(freeform, change, error, words):
    with pytest.raises(error, match=words):
        offset(as_nominal(change(nominal_points(freeform))), 1.5)


def test_measured_points_are_no_nominal(freeform):
    with pytest.raises(WrongStageError, match="measured"):
        offset(PointSet.of(nominal_points(freeform), kind=PointKind.TIP_CENTRE), 1.5)


@pytest.mark.parametrize(("radius", "side"), [(0.0, "+z"), (-1.5, "+z"), (float("nan"), "+z"), (1.5, "up")])
def test_a_wrong_radius_or_side_is_a_usage_error(freeform, radius, side):
    with pytest.raises(UsageError):
        offset(freeform, radius, OffsetConfig(side=side))


def test_a_prescription_that_is_undefined_inside_its_aperture_says_where():
    text = FREEFORM.replace("radius = -60.0", "radius = -18.0").replace("conic = -0.4", "conic = 0.0")

    with pytest.raises(GeometryError, match="not defined at x ="):
        offset(prescription_from_toml(text, "x.toml"), 1.5)


@pytest.mark.parametrize("step", [0.1, 0.5])
def test_a_grid_printed_with_six_decimals_does_not_ring(freeform, step):
    points = np.round(nominal_points(freeform, half=(10.0, 10.0), step=step), 6)

    nominal = offset(as_nominal(points), 1.5)

    rng = np.random.default_rng(7)
    u, v = rng.uniform(-10, 10, (2, 20_000))
    error = nominal.surface.jet(u, v).z - freeform.jet(u, v).z
    assert np.ptp(error) < 1e-6  # the print itself is 1 nm wide
    assert nominal.quality.surface_error_pv_nm == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("term", "off_mm"),
    [
        # Distance of an equidistant point from the exact equidistant surface, by the surface's own geometry.
        (
            'kind = "toroid"\nradius_of_rotation = -80.0\nradius = -40.0\n',
            lambda p: _off_torus(p, 80.0, 40.0),
        ),
        ('kind = "conic"\nradius = 60.0\nconic = -1.0\n', lambda p: _off_paraboloid(p, 60.0)),
    ],
    ids=["torus", "paraboloid"],
)
def test_equidistant_points_of_prescriptions_lie_on_the_exact_surface(term, off_mm):
    text = (
        'schema = "cmm-align/prescription/1"\n[aperture]\nshape = "circle"\nradius = 15.0\n[[term]]\n' + term
    )
    nominal = offset(prescription_from_toml(text, "x.toml"), 1.5)

    # 1e-6 nm is 1e-12 mm: some ulp of 100 mm.
    assert np.abs(off_mm(nominal.equidistant.points_mm)).max() < 1e-12


def _off_torus(points, major, minor):
    """Torus swept about an axis parallel to y through z = -major: profile radius minor about it."""
    rho = np.hypot(points[:, 0], points[:, 2] + major) - (major - minor)
    return np.hypot(rho, points[:, 1]) - (minor + 1.5)


def _off_paraboloid(points, radius):
    """Distance to z = q^2 / 2R by the cubic for the foot, minus the tip radius."""
    off = []
    for q, z in zip(np.hypot(points[:, 0], points[:, 1])[::97], points[::97, 2], strict=True):
        # (u - q) + (u^2 / 2R - z) u / R = 0
        roots = np.roots([1.0 / (2.0 * radius**2), 0.0, 1.0 - z / radius, -q])
        foot = roots[np.abs(roots.imag) < 1e-9].real
        foot = foot - (foot**3 / (2 * radius**2) + (1 - z / radius) * foot - q) / (
            3 * foot**2 / (2 * radius**2) + 1 - z / radius
        )
        off.append(np.hypot(foot - q, foot**2 / (2 * radius) - z).min() - 1.5)
    return np.array(off)
