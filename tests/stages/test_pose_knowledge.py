"""What a fit knows of its pose: closed forms of a plane, motions at any scale, many fits."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import closed_forms as cf
import numpy as np
import pytest

from cmm_align.io.hdf5_library import h5py
from cmm_align.io.records import read_record, write_record
from cmm_align.model import Nominal
from cmm_align.model.pose_knowledge import PoseKnowledge
from cmm_align.numerics.observability import Spectrum, spectrum
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.stages.pose_knowledge import Spots, border_of, pose_knowledge
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.surfaces.protocol import Bounds, Jet
from cmm_align.virtual.window import window

MIRROR = Path(__file__).resolve().parents[2] / "sample_data" / "mirror_m2"
UPRIGHT = Pose.identity("surface", "part")
ON_ITS_SIDE = Pose(rotation_from_vector(np.array([0.4, -1.1, 0.7])), np.zeros(3), "surface", "part")
SIGMA_MM = 1e-3


def prescription(aperture, terms):
    return prescription_from_toml(
        f'schema = "cmm-align/prescription/1"\n[aperture]\n{aperture}\n{terms}', "x"
    )


def bowed(amplitude_mm):
    """A sphere of R 100 mm, 40 mm across, with some freeform on it."""
    terms = f'"3,0" = {amplitude_mm}, "1,2" = {-2 * amplitude_mm}, "2,0" = {amplitude_mm}'
    return prescription(
        'shape = "circle"\nradius = 20.0',
        '[[term]]\nkind = "conic"\nradius = -100.0\n[[term]]\nkind = "xy_polynomial"\n'
        f"normalization_radius = 20.0\ncoefficients = {{ {terms} }}",
    )


def mirror():
    return prescription_from_toml((MIRROR / "nominal.toml").read_text(encoding="utf-8"), "mirror")


@dataclass(frozen=True)
class Scaled:
    """A surface made larger in all three directions."""

    surface: object
    factor: float
    kind: str = "prescription"

    @property
    def bounds(self):
        return Bounds(*(self.factor * v for v in self.surface.bounds))

    def contains(self, x, y):
        return self.surface.contains(x / self.factor, y / self.factor)

    def jet(self, x, y):
        j = self.surface.jet(x / self.factor, y / self.factor)
        return Jet(j.z * self.factor, j.zx, j.zy, *(d / self.factor for d in j[3:]))


@dataclass(frozen=True)
class HalfFlat(cf.ClosedForm):
    """A plane for x < 0 that rises into a freeform for x > 0: z = a x^3 (1 + y / b)."""

    a: float = 1e-4
    b: float = 30.0

    def jet(self, x, y):
        p, tilt = np.maximum(x, 0.0), 1.0 + y / self.b
        return Jet(
            self.a * p**3 * tilt,
            3 * self.a * p**2 * tilt,
            self.a * p**3 / self.b,
            6 * self.a * p * tilt,
            3 * self.a * p**2 / self.b,
            np.zeros(np.shape(x)),
        )


class Fit(NamedTuple):
    """A fit of points with independent errors, the textbook way."""

    nominal: Nominal
    rows: np.ndarray
    spectral: Spectrum
    covariance: np.ndarray
    centroid_mm: np.ndarray
    length_mm: float

    def knowledge(self, covariance=None, n_used=None, sigma_mm=SIGMA_MM):
        return pose_knowledge(
            self.nominal,
            self.spectral,
            self.covariance if covariance is None else covariance,
            self.centroid_mm,
            self.length_mm,
            n_used or len(self.rows),
            sigma_mm,
        )


def fitted(surface, x, y, *, frame=UPRIGHT, radius_mm=0.0):
    """Return the fit of points over (x, y)."""
    jet = surface.jet(x, y)
    back = frame.inverse()
    points, normals = back.apply(np.stack([x, y, jet.z], axis=1)), back.rotate(unit_normal(jet, 1))
    centroid = points.mean(axis=0)
    arm = points - centroid
    length = float(np.sqrt(np.mean(np.sum(arm**2, axis=1))))
    rows = np.hstack([np.cross(arm, normals), normals])
    scale = np.array([length] * 3 + [1.0] * 3)
    found = spectrum((rows / scale).T @ (rows / scale) / len(rows), 1e-8)
    keep = found.motions[:, ~found.free] / scale[:, None]
    covariance = SIGMA_MM**2 / len(rows) * (keep / found.values[~found.free]) @ keep.T
    return Fit(Nominal(surface, 1, radius_mm, frame, ""), rows, found, covariance, centroid, length)


def raster(surface, n=25, low=(-1.0, -1.0), high=(1.0, 1.0)):
    b = surface.bounds
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(low[0], high[0], n), np.linspace(low[1], high[1], n)))
    x = 0.5 * (b.x_min + b.x_max + 0.99 * u * (b.x_max - b.x_min))
    y = 0.5 * (b.y_min + b.y_max + 0.99 * v * (b.y_max - b.y_min))
    inside = surface.contains(x, y)
    return x[inside], y[inside]


# The plane: everything in closed form.


def test_the_edge_of_a_plane_is_known_as_the_textbook_says():
    plane = cf.Plane(a=0.0, b=0.0)
    x, y = raster(plane)
    knows = fitted(plane, x, y).knowledge()

    # var z(x, y) = s^2 / N (1 + x^2 / <x^2> + y^2 / <y^2>), at the corner.
    corner = SIGMA_MM / np.sqrt(len(x)) * np.sqrt(1 + 20.0**2 / np.mean(x**2) + 20.0**2 / np.mean(y**2))
    assert knows.edge_sigma_um == pytest.approx(1e3 * corner, rel=1e-9)
    assert np.abs(knows.edge_at_mm[:2]) == pytest.approx([20.0, 20.0], rel=1e-8)
    assert knows.edge_shift_sigma_um == np.inf
    assert knows.weak == ()
    assert knows.correlations == ()


def test_points_at_the_corners_hold_the_tilt_of_a_plane_best():
    plane = cf.Plane(a=0.0, b=0.0)
    x, y = raster(plane, high=(1.0, 0.5), low=(-1.0, -0.5))  # narrow in y: the turn about x is weakest
    fit = fitted(plane, x, y)
    knows = fit.knowledge()

    assert knows.helped.endswith("along x")
    assert len(knows.helpful) == 3
    for place in knows.helpful:
        assert abs(place.at_mm[1]) == pytest.approx(20.0 * (1 - 1 / 24), rel=1e-12)
    # Long way round: the same points beside the others in one least squares.
    rows = fit.rows[:, [0, 1, 5]]
    for k, count in ((1, 1), (3, 1), (3, knows.points_each)):
        more = [[p.at_mm[1], -p.at_mm[0], 1.0] for p in knows.helpful[:k]]
        stack = np.vstack([rows, *[more] * count])
        sigma = SIGMA_MM * np.sqrt(np.linalg.inv(stack.T @ stack)[0, 0])
        reach = 1e3 * 20.0 * sigma  # at y = 20 mm
        told = knows.helpful[k - 1]
        assert (told.after_one_um if count == 1 else told.after_many_um) == pytest.approx(reach, rel=1e-9)
    assert knows.points_each == round(0.01 * len(x))


def test_with_a_million_points_three_more_do_nothing_and_one_percent_does_something():
    surface = bowed(0.01)
    fit = fitted(surface, *raster(surface))
    n = 1_000_000
    knows = fit.knowledge(covariance=fit.covariance * len(fit.rows) / n, n_used=n)
    last = knows.helpful[-1]

    assert knows.points_each == 10_000
    # Three rows of norm below 3 (arms under two lengths) among a million, of an eigenvalue of 1e-7 at least.
    assert 1.0 - last.after_one_um / knows.helped_um < 1e-3
    assert last.after_many_um < 0.97 * knows.helped_um
    assert "10000 each" in knows.words()[-1]


def test_where_some_points_count_for_one_the_gain_is_the_same_and_the_sigma_larger():
    surface = bowed(0.1)
    fit = fitted(surface, *raster(surface, n=81))
    apart, alike = fit.knowledge(), fit.knowledge(covariance=10.0 * fit.covariance)

    assert apart.points_each > 10
    assert alike.helped_um == pytest.approx(np.sqrt(10.0) * apart.helped_um, rel=1e-9)
    for one, other in zip(apart.helpful, alike.helpful, strict=True):
        assert other.at_mm == one.at_mm
        assert other.after_many_um == pytest.approx(np.sqrt(10.0) * one.after_many_um, rel=1e-9)


# Weak motions.


@pytest.mark.parametrize("factor", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(
    ("surface", "weak"),
    [
        (window(), 0),
        (bowed(0.1), 1),
        (bowed(0.01), 3),
        (cf.Sphere(), 0),
        (cf.Paraboloid(a_mm=100.0, b_mm=100.0), 2),
    ],
    ids=["demo window", "0.1 mm of freeform", "10 um of freeform", "sphere", "paraboloid"],
)
def test_weak_motions_are_found_at_any_scale_and_not_invented(surface, weak, factor):
    large = Scaled(surface, factor)
    found = fitted(large, *(factor * v for v in raster(surface))).knowledge().weak

    assert len(found) == weak
    assert all(motion.times_worse > 200.0 for motion in found)


@pytest.mark.parametrize("factor", [1e-3, 1.0, 1e3])
def test_the_mirror_is_loose_sideways_and_about_z(factor):
    x, y = np.loadtxt(MIRROR / "points.csv", delimiter=",", skiprows=2)[:, :2].T
    fit = fitted(Scaled(mirror(), factor), factor * x, factor * y)
    weak = fit.knowledge().weak

    assert [("along x" in m.words, "along y" in m.words) for m in weak[:2]] == [(True, False), (False, True)]
    assert all("nearly a translation" in m.words for m in weak[:2])
    assert "nearly" not in weak[2].words
    sideways = 1e3 * np.sqrt(np.diag(fit.covariance)[3:5])
    # At the edge: more than at the centroid, and not by more than the turn that goes with it.
    assert sideways[0] < weak[0].sigma_um < 2.0 * sideways[0]
    assert sideways[1] < weak[1].sigma_um < 2.0 * sideways[1]
    assert weak[2].sigma_um == pytest.approx(
        1e-3 * weak[2].sigma_urad * factor * np.hypot(3100.0, 3100.0 + 912.0), rel=0.03
    )


def test_sigmas_are_those_of_many_fits(rng):
    surface = bowed(0.05)
    x, y = raster(surface, n=15)
    fit = fitted(surface, x, y)
    knows = fit.knowledge()
    poses = rng.normal(0.0, SIGMA_MM, (20_000, len(x))) @ np.linalg.pinv(fit.rows).T
    border = border_of(fit.nominal)
    arm = border.points_mm - fit.centroid_mm

    normal = np.einsum("sk,nk->sn", poses, np.hstack([np.cross(arm, border.normals), border.normals]))
    moved = [np.cross(poses[:, :3], a) + poses[:, 3:] for a in arm]
    shift = max(np.linalg.eigvalsh(np.cov(m.T))[-1] for m in moved)
    # 20 000 draws tell a sigma to 0.5 %; the largest of 64 is looked for.
    assert knows.edge_sigma_um == pytest.approx(1e3 * normal.std(axis=0).max(), rel=0.02)
    assert knows.edge_shift_sigma_um == pytest.approx(1e3 * np.sqrt(shift), rel=0.02)
    turn = next(m for m in knows.weak if "nearly" not in m.words)
    assert turn.words.endswith("1.000)") or turn.words.endswith("along z")
    assert turn.sigma_urad == pytest.approx(1e6 * poses[:, 2].std(), rel=0.02)
    assert turn.sigma_um == pytest.approx(1e-3 * turn.sigma_urad * 20.0, rel=0.03)


def test_nothing_changes_when_the_part_lies_on_its_side():
    surface = bowed(0.01)
    x, y = raster(surface)
    upright = fitted(surface, x, y).knowledge()
    lying = fitted(surface, x, y, frame=ON_ITS_SIDE).knowledge()

    # Rounding, times the ratio of the eigenvalues (1e7), times a few.
    assert lying.edge_sigma_um == pytest.approx(upright.edge_sigma_um, rel=1e-8)
    assert lying.edge_shift_sigma_um == pytest.approx(upright.edge_shift_sigma_um, rel=1e-8)
    values = [[m.times_worse for m in k.weak] for k in (upright, lying)]
    # Within a group of alike motions the axes of the part choose the directions.
    assert np.sum(1.0 / np.square(values[0])) == pytest.approx(np.sum(1.0 / np.square(values[1])), rel=1e-6)
    for place in lying.helpful:
        at = ON_ITS_SIDE.apply(np.array([place.at_mm]))
        assert at[0, 2] == pytest.approx(surface.jet(at[:, 0], at[:, 1]).z[0], abs=1e-9)


# Correlations.


def test_motions_that_look_alike_are_named_and_others_are_not():
    fit = fitted(window(), *raster(window()))
    sigma = np.array([1e-5, 2e-5, 3e-5, 1e-3, 2e-3, 3e-3])
    rho = np.eye(6)
    rho[1, 3] = rho[3, 1] = 0.98
    rho[0, 2] = rho[2, 0] = -0.96
    rho[4, 5] = rho[5, 4] = 0.94
    found = fit.knowledge(covariance=rho * np.outer(sigma, sigma)).correlations

    assert [(c.first, c.second) for c in found] == [("ry", "tx"), ("rx", "rz")]
    assert [c.rho for c in found] == pytest.approx([0.98, -0.96], rel=1e-12)
    assert found[0].words == "a shift along x and a turn about y look alike"
    assert found[1].words == "a turn about x and a turn about z look alike"


# Further points where nothing was measured.


def test_a_free_motion_is_told_best_where_the_part_was_not_measured():
    surface = HalfFlat()
    half = fitted(surface, *raster(surface, high=(-0.1, 1.0)))
    knows = half.knowledge()

    assert half.spectral.free.sum() == 3
    assert knows.edge_sigma_um == np.inf
    assert knows.edge_at_mm[0] > 0.0
    assert knows.helped_um == np.inf
    assert len(knows.helpful) == 3
    assert all(place.at_mm[0] > 0.0 for place in knows.helpful)
    assert knows.helpful[0].after_many_um == np.inf  # three motions need three places
    assert np.isfinite(knows.helpful[-1].after_many_um)
    # Long way round: all points in one least squares, which has no free motion left.
    spots = np.array([p.at_mm for p in knows.helpful])
    more = Spots(spots, unit_normal(surface.jet(*spots.T[:2]), 1)).rows(half.centroid_mm, half.length_mm)
    scale = np.array([half.length_mm] * 3 + [1.0] * 3)
    stack = np.vstack([half.rows / scale, *[more] * knows.points_each])
    axis_mm = np.array([float(v) for v in knows.helped.split("(")[1].split(")")[0].split(",")])
    turn = np.concatenate([[0.0, 0.0, half.length_mm], np.cross([0, 0, 1], half.centroid_mm - axis_mm)])
    turn /= np.linalg.norm(turn)
    sigma = SIGMA_MM * np.sqrt(turn @ np.linalg.inv(stack.T @ stack) @ turn)
    arm = border_of(half.nominal).points_mm[:, :2] - axis_mm[:2]
    reach = np.linalg.norm(arm, axis=1).max() * turn[2] / half.length_mm
    assert not spectrum(stack.T @ stack, 1e-8).free.any()
    # The axis is printed to 1 um, and the guess of a radian has a share of (sigma / length)^2.
    assert knows.helpful[-1].after_many_um == pytest.approx(1e3 * sigma * reach, rel=1e-3)


def test_a_symmetry_of_the_whole_nominal_needs_no_points():
    surface = cf.Sphere()
    knows = fitted(surface, *raster(surface, high=(-0.1, 1.0))).knowledge()

    assert np.isfinite(knows.edge_sigma_um)
    assert np.isfinite(knows.helped_um)
    assert knows.edge_shift_sigma_um == np.inf


def test_places_keep_off_the_edge_that_the_ball_would_touch():
    surface = prescription('shape = "circle"\nradius = 20.0', '[[term]]\nkind = "conic"\nradius = -40.0')
    knows = fitted(surface, *raster(surface), radius_mm=15.0).knowledge()

    # sqrt(2 r h / (1 + r / R)) = 0.467 mm for an edge 10 um proud.
    for place in knows.helpful:
        assert np.hypot(*place.at_mm[:2]) < 20.0 - 0.467 * np.cos(np.pi / 8)


@pytest.mark.parametrize(
    ("aperture", "farthest"),
    [
        ('shape = "rectangle"\nwidth = 60.0\nheight = 20.0', np.hypot(30.0, 10.0)),
        ('shape = "circle"\nradius = 20.0', 20.0),
        ('shape = "annulus"\ninner_radius = 15.0\nouter_radius = 20.0', 20.0),
    ],
)
def test_the_border_is_where_the_nominal_ends(aperture, farthest):
    surface = prescription(aperture, '[[term]]\nkind = "conic"\nradius = -400.0')
    border = border_of(Nominal(surface, 1, 0.0, UPRIGHT, ""))
    x, y = border.points_mm[:, :2].T

    assert np.hypot(x, y).max() == pytest.approx(farthest, rel=1e-8)
    assert len(x) == 64
    assert surface.contains(x, y).all()
    assert not surface.contains(x * (1 + 1e-6), y * (1 + 1e-6)).any()


def test_a_fit_without_residuals_says_so_with_zeros():
    fit = fitted(window(), *raster(window()))
    knows = fit.knowledge(covariance=np.zeros((6, 6)), sigma_mm=0.0)

    assert knows.edge_sigma_um == 0.0
    assert knows.correlations == ()
    assert knows.helpful == ()


def test_it_survives_a_file():
    surface = HalfFlat()
    knows = fitted(surface, *raster(surface, high=(-0.1, 1.0))).knowledge()

    with h5py.File("memory", "w", driver="core", backing_store=False) as file:
        write_record(file.create_group("knows"), knows)
        again = read_record(file, "/knows", PoseKnowledge)

    assert again == knows
    assert again.words() == knows.words()
