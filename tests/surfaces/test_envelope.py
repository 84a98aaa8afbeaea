"""What the ball reaches: nothing flagged where it reaches, exact centres where it does not."""

from dataclasses import dataclass

import closed_forms as cf
import numpy as np
import pytest

from cmm_align.config import OffsetConfig
from cmm_align.model import PointKind, PointSet
from cmm_align.numerics.ball_envelope import ball_rest
from cmm_align.stages.offset import offset
from cmm_align.surfaces.envelope import (
    Reach,
    edge_band_mm,
    near_edge,
    reach,
    tight_places,
    tightest,
)
from cmm_align.surfaces.equidistant import grid_nodes
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.surfaces.protocol import Jet

R = 1.5


@dataclass(frozen=True)
class Wave(cf.ClosedForm):
    """z = a sin(k x), curved up to a k^2."""

    half_mm: float = 4.0
    amplitude_mm: float = 0.4
    length_mm: float = 4.0

    def jet(self, x, y):
        k, a, zero = 2 * np.pi / self.length_mm, self.amplitude_mm, np.zeros(np.shape(x))
        s, c = np.sin(k * x), np.cos(k * x)
        return Jet(a * s, a * k * c, zero, -a * k**2 * s, zero, zero)


@dataclass(frozen=True)
class Trough(cf.ClosedForm):
    """Two planes that meet along y in a valley rounded within 0.02 mm: z = tan(40 deg) hypot(x, 0.02)."""

    half_mm: float = 3.0

    def jet(self, x, y):
        t, w, zero = np.tan(np.deg2rad(40.0)), np.hypot(x, 0.02), np.zeros(np.shape(x))
        return Jet(t * w, t * x / w, zero, t * 0.02**2 / w**3, zero, zero)


def net(surface, side=1, step=0.1):
    b = surface.bounds
    x = np.arange(b.x_min, b.x_max + step / 2, step)
    y = np.arange(b.y_min, b.y_max + step / 2, step)
    px, py = np.meshgrid(x, y)
    known = surface.contains(px.ravel(), py.ravel()).reshape(px.shape)
    return grid_nodes(surface, side, x, y, known)


def reached(surface, radius=R, side=1, step=0.1, edge_proud_mm=0.0):
    nodes = net(surface, side, step)
    tight = tight_places(nodes.points_mm, nodes.concave_per_mm, nodes.slope, radius)
    return nodes, reach(
        surface,
        side,
        radius,
        nodes.points_mm,
        nodes.normals,
        nodes.concave_per_mm,
        tight,
        edge_proud_mm,
        step,
    )


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    "surface",
    [cf.Plane(), cf.Sphere(), cf.Cylinder(), cf.Paraboloid(a_mm=30.0, b_mm=-45.0), cf.Torus()],
    ids=lambda s: type(s).__name__,
)
def test_where_the_surface_is_smooth_nothing_is_flagged_and_the_centres_are_the_offset(surface, side):
    nodes, found = reached(surface, side=side, step=0.5)

    assert (found.code == Reach.REACHED).all()
    np.testing.assert_array_equal(found.centre_mm, nodes.points_mm + R * nodes.normals)


@pytest.mark.parametrize("side", [1, -1])
def test_in_narrow_valleys_exactly_the_nodes_that_another_place_shadows_are_flagged(side):
    surface = Wave()
    nodes, found = reached(surface, side=side, step=0.1)
    fine = np.linspace(-4.0, 4.0, 40_001)
    profile = np.stack([fine, surface.jet(fine, fine).z], axis=1)
    row = np.flatnonzero(nodes.points_mm[:, 1] == nodes.points_mm[0, 1])
    offset_points = (nodes.points_mm + R * nodes.normals)[row][:, [0, 2]]
    nearest = np.array([np.sqrt(np.min(np.sum((profile - o) ** 2, axis=1))) for o in offset_points])

    held_off = found.code[row] > Reach.EDGE
    sure = np.abs(nearest - R) > 1e-7
    np.testing.assert_array_equal(held_off[sure], nearest[sure] < R)
    assert held_off.any()
    assert not held_off.all()
    tight = R * nodes.concave_per_mm >= 1.0
    assert (found.code[tight] == Reach.TIGHT).all()
    assert (found.code == Reach.SHADOWED).any()  # flanks that the ball could follow, were it alone there


def test_in_a_trough_the_centres_lie_on_the_planes_one_radius_off():
    nodes, found = reached(Trough(), step=0.05)
    held_off = found.code > Reach.EDGE
    c = np.cos(np.deg2rad(40.0))
    x, _, z = found.centre_mm[held_off].T

    # The flanks of a hyperbola lie under its asymptotes, by 0.02^2 tan / 2x at a contact 1 mm out.
    np.testing.assert_allclose(z, np.abs(x) * np.tan(np.deg2rad(40.0)) + R / c, atol=4e-4)
    reach_mm = R * np.sin(np.deg2rad(40.0))
    inner = np.abs(nodes.points_mm[:, 0]) < reach_mm - 0.06
    assert held_off[inner].all()
    assert not held_off[np.abs(nodes.points_mm[:, 0]) > reach_mm + 0.06].any()


def test_where_it_reaches_the_envelope_is_the_offset_and_the_centres_go_on_smoothly():
    surface = Wave()
    nodes, found = reached(surface, step=0.08)
    k = np.flatnonzero(nodes.points_mm[:, 1] == nodes.points_mm[0, 1])
    k = k[np.abs(nodes.points_mm[k, 0]) < 2.0]
    o = (nodes.points_mm + R * nodes.normals)[k]

    rest = ball_rest(surface.jet, surface.contains, 1, R, o[:, 0], o[:, 1])

    np.testing.assert_allclose(found.centre_mm[k][:, 2], rest.height_mm, atol=1e-9)
    # Steps between neighbours are those of the offset points: nothing jumps where the ball leaves.
    assert np.linalg.norm(np.diff(found.centre_mm[k], axis=0), axis=1).max() < 0.08 * (1 + R * 1.0) * 1.5


def test_a_ball_too_large_for_a_bowl_hangs_on_a_circle():
    bowl = cf.Paraboloid(half_mm=3.0, a_mm=1.0, b_mm=1.0)
    nodes, found = reached(bowl, step=0.1)
    middle = np.argmin(np.hypot(*nodes.points_mm[:, :2].T))

    assert found.code[middle] == Reach.TIGHT
    assert found.centre_mm[middle, 2] == pytest.approx((R**2 + 1.0) / 2.0, abs=1e-9)
    # The ball touches where its radius is that of the normal to the axis: rho^2 = r^2 - R^2, all outside.
    rho = np.hypot(*nodes.points_mm[:, :2].T)
    np.testing.assert_array_equal(found.code <= Reach.EDGE, rho > np.sqrt(R**2 - 1.0))


def test_the_tightest_place_is_found_between_nodes():
    nodes = net(Wave(), step=0.31)
    found = tightest(Wave(), 1, nodes.points_mm, nodes.concave_per_mm, 0.31)

    assert 1.0 / found.curvature_per_mm == pytest.approx(1.0 / (0.4 * (np.pi / 2) ** 2), rel=1e-6)
    assert np.cos(np.pi / 2 * (found.x_mm - 3.0)) == pytest.approx(1.0, abs=1e-4)  # a bottom of the wave


def test_the_edge_band_is_where_a_proud_edge_would_be_touched_first():
    plane = cf.Plane(half_mm=10.0, a=0.0, b=0.0)
    nodes, found = reached(plane, step=0.05, edge_proud_mm=0.01)
    room = 10.0 - np.abs(nodes.points_mm[:, :2]).max(axis=1)
    # A ball at d from an edge that stands h proud: it clears it if r - sqrt(r^2 - d^2) > h.
    band = np.sqrt(2.0 * R * 0.01 - 0.01**2)

    clear = np.abs(room - band) > 0.002
    np.testing.assert_array_equal((found.code == Reach.EDGE)[clear], (room < band)[clear])


def test_the_band_is_wider_in_a_bowl_and_never_wider_than_the_ball():
    width = edge_band_mm(R, np.array([-0.1, 0.0, 0.3, 0.66, 0.9]), 0.01)

    assert (np.diff(width) >= 0.0).all()
    assert width[-1] == R


@pytest.mark.parametrize(
    "aperture",
    ['shape = "circle"\nradius = 10.0', 'shape = "annulus"\nouter_radius = 10.0\ninner_radius = 3.0'],
)
def test_round_borders_have_a_band_too(aperture):
    surface = prescription_from_toml(
        f'schema = "cmm-align/prescription/1"\nunits = "mm"\n[aperture]\n{aperture}\n[[term]]\n'
        'kind = "conic"\nradius = -60.0\n',
        "round.toml",
    )
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-10, 10, 161), np.linspace(-10, 10, 161)))
    rho = np.hypot(x, y)
    inside = surface.contains(x, y)

    near = near_edge(surface, x, y, np.full(len(x), 0.4))

    inner = 3.0 if "annulus" in aperture else -1.0
    room = np.minimum(10.0 - rho, np.where(inner > 0, rho - inner, np.inf))
    clear = inside & (np.abs(room - 0.4) > 0.02)
    np.testing.assert_array_equal(near[clear], (room < 0.4)[clear])


def test_offset_says_what_is_not_reached_and_fits_its_surface_to_the_rest():
    wave = Wave(amplitude_mm=0.4, half_mm=4.0)
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-4, 4, 81), np.linspace(-4, 4, 41)))
    points = PointSet.of(np.stack([x, y, wave.jet(x, y).z], axis=1), kind=PointKind.NOMINAL, frame="part")

    narrow, wide = offset(points, R), offset(points, 0.8, OffsetConfig(edge_proud_um=0.0))

    assert narrow.quality.n_not_reached > 0
    assert narrow.quality.max_held_off_mm > 1e-3
    assert narrow.quality.min_concave_radius_mm == pytest.approx(1.0132, abs=2e-3)
    assert narrow.quality.n_not_reached == np.count_nonzero(narrow.equidistant.reach > Reach.EDGE)
    assert (narrow.equidistant.reach[~narrow.equidistant.regular] == Reach.TIGHT).all()
    assert wide.quality.n_not_reached == wide.quality.n_edge == 0
    assert wide.quality.max_held_off_at_mm is None
