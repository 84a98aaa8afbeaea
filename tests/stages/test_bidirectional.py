from dataclasses import replace

import closed_forms as cf
import h5py
import numpy as np
import pytest
import truth

from cmm_align.config import AlignConfig
from cmm_align.errors import GeometryError
from cmm_align.io.records import read_record, write_record
from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.model.bidirectional import Bidirectional
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.stages.align import align
from cmm_align.stages.bidirectional import bidirectional
from cmm_align.surfaces.geometry import principal_curvatures, slope, unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml

RADIUS = 1.5
DOME = prescription_from_toml(truth.DOME, "dome.toml")
STEP = 0.8
FLAT = Pose.identity("surface", "part")
HOME = Pose.identity("part", "machine")
EVALUATE = AlignConfig(max_iterations=0)


def bare(surface=DOME, side=1, turn=FLAT):
    return Nominal(surface, side, RADIUS, turn, "0" * 64)


def net(step=STEP, half=(29.0, 19.0)):
    x, y = (np.arange(-h, h + 1e-9, step) for h in half)
    return tuple(a.ravel() for a in np.meshgrid(x, y))


def tips(nominal, x, y, deviation=0.0, radius=RADIUS):
    jet = nominal.surface.jet(x, y)
    height = radius + np.broadcast_to(deviation, x.shape)
    points = np.stack([x, y, jet.z], axis=1) + height[:, None] * unit_normal(jet, nominal.side)
    return nominal.surface_from_part.inverse().apply(points)


def at_home(points, nominal, kind=PointKind.TIP_CENTRE, config=EVALUATE, start=HOME):
    return align(PointSet.of(points, kind=kind), nominal, config, start=start)


def best(points, nominal, outliers="reject"):
    return at_home(points, nominal, config=AlignConfig(outliers=outliers))


def bump(x, y, height=0.02):
    return height * np.exp(-((x - 8.0) ** 2 + (y + 4.0) ** 2) / (2 * 4.0**2))


@pytest.fixture(scope="module")
def clean():
    """Points without any error, at the true pose."""
    return bidirectional(at_home(tips(bare(), *net()), bare()))


def test_without_noise_both_directions_agree_within_the_facets(clean):
    x, y = net()
    jet = DOME.jet(x, y)
    k = np.abs(np.stack(principal_curvatures(jet, 1))).max()
    # On the slope the longest edge of a facet is the diagonal of a cell, sqrt(2 + S^2) h at most, and longer
    # by 1 + r k on the equidistant surface, where the curvature is k / (1 + r k).
    bound = (2 + slope(jet).max() ** 2) * STEP**2 * k * (1 + RADIUS * k) / 8

    assert clean.forward.pv_mm < 1e-12
    assert clean.backward.min_mm >= -bound
    assert clean.backward.max_mm <= 1e-9  # facets of a dome hang below it: too little material
    assert clean.facets_max_mm <= bound
    # Curvature changes by some per cent over a facet; what is left of its error is of that order.
    assert clean.rest_rms_mm < 0.05 * clean.facets_rms_mm
    assert clean.consistent, clean.words
    assert clean.covered == 1.0
    assert clean.n_measured == clean.forward.n == len(x)
    np.testing.assert_allclose(clean.spacing_mm, STEP, rtol=0.1)


def test_the_error_of_the_facets_falls_with_the_square_of_their_size(clean):
    wide = bidirectional(at_home(tips(bare(), *net(2 * STEP)), bare()))

    np.testing.assert_allclose(wide.facets_rms_mm / clean.facets_rms_mm, 4.0, rtol=0.05)
    np.testing.assert_allclose(wide.difference_rms_mm / clean.difference_rms_mm, 4.0, rtol=0.05)


@pytest.mark.parametrize("side", [1, -1])
def test_a_bump_is_positive_in_both_directions(side):
    x, y = net()
    nominal = bare(side=side)

    found = bidirectional(at_home(tips(nominal, x, y, bump(x, y)), nominal))

    for way in (found.forward, found.backward, found.interpolated):
        # Linear between points: off by h^2 e'' / 4 at most, e'' = 0.02 / 16 per mm, and by the facets.
        np.testing.assert_allclose(way.max_mm, 0.02, atol=STEP**2 * 0.02 / 64 + found.facets_max_mm)
        np.testing.assert_allclose(way.max_at_mm, [8.0, -4.0], atol=2 * RADIUS)
    # A ball below the dome is on its hollow side, where facets stand in front of the surface.
    assert np.sign(found.difference_mean_mm) == -side
    assert found.agree, found.words


def test_a_part_laid_off_is_seen_from_both_sides_and_the_reverse_motion_says_by_how_much(clean):
    x, y = net()
    nominal = bare()
    points = tips(nominal, x, y)
    off = Pose(
        rotation_from_vector(np.array([3e-4, -2e-4, 5e-4])), np.array([0.02, -0.01, 0.015]), "part", "part"
    )

    found = bidirectional(at_home(points, nominal, start=off @ HOME))

    assert not found.at_rest
    assert not found.consistent
    assert "left by the alignment" in found.words
    assert found.forward.rms_mm > 0.01
    np.testing.assert_allclose(found.backward.rms_mm, found.forward.rms_mm, rtol=0.1)
    # The nominal must follow the cloud, but for what facets pull at it with or without the offset.
    centre = points.mean(axis=0)
    shift = off.apply(centre[None])[0] - centre
    np.testing.assert_allclose(found.reverse_translation_mm, shift, atol=2 * clean.reverse_edge_mm)
    np.testing.assert_allclose(
        found.reverse_rotation_rad, off.rotation_vector_rad(), atol=2 * clean.reverse_edge_mm / 30
    )
    # What the facets do not explain is the whole offset, seen in the deviations.
    np.testing.assert_allclose(found.unexplained_rms_mm, found.forward.rms_mm, rtol=0.02)


def test_noise_drops_out_of_the_difference_and_facets_average_it(rng, clean):
    x, y = net()
    sigma = 3e-3
    points = tips(bare(), x, y, rng.normal(0.0, sigma, x.size))

    found = bidirectional(best(points, bare(), outliers="keep"))

    n = found.backward.n
    # Mean of b1^2 + b2^2 + b3^2 over a triangle is one half; the mean square of n values scatters by
    # sqrt(2 / n), and neighbours share vertices (some six facets a point).
    np.testing.assert_allclose(found.interpolated.rms_mm, sigma / np.sqrt(2), rtol=3 * np.sqrt(6 * 2 / n))
    assert found.backward.rms_mm < np.hypot(found.interpolated.rms_mm, clean.backward.rms_mm) * 1.05
    # Noise tilts facets by sigma / h: the share of the noise that enters.
    entered = found.interpolated.rms_mm * 2 * sigma / STEP
    np.testing.assert_allclose(found.difference_rms_mm, clean.difference_rms_mm, atol=entered)
    assert found.consistent, found.words


def test_form_error_in_an_uneven_scan_moves_the_reverse_fit_as_expected(rng):
    x, y = (rng.uniform(-h, h, 6000) for h in (29.0, 19.0))
    x = 29.0 - 58.0 * np.abs((x - 29.0) / 58.0) ** 1.5  # far denser to the right
    points = tips(bare(), x, y, 0.01 * np.sin(x / 9.0) * np.cos(y / 7.0))

    found = bidirectional(best(points, bare(), outliers="keep"))

    assert found.expected_rms_mm > 10 * found.allowed_rms_mm
    assert found.unexplained_rms_mm <= found.allowed_rms_mm
    assert found.consistent, found.words


def test_contact_points_are_measured_against_the_nominal_itself():
    x, y = net()
    points = tips(bare(), x, y, radius=0.0)

    found = bidirectional(at_home(points, bare(), kind=PointKind.CONTACT))

    assert found.forward.pv_mm < 1e-12
    assert found.backward.max_mm <= 1e-9
    assert found.consistent, found.words


@pytest.mark.parametrize("surface", [cf.Plane(), cf.Sphere(radius_mm=-90.0)], ids=["plane", "sphere"])
def test_motions_that_nothing_tells_do_not_disturb(surface, rng):
    x, y = net(half=(18.0, 18.0))
    nominal = bare(surface)
    points = tips(nominal, x, y, rng.normal(0.0, 3e-4, x.size))

    found = bidirectional(best(points, nominal, outliers="keep"))

    assert found.consistent, found.words
    # A plane has no facet error, and the dome of the sphere h^2 k / 4: both move by no more, and by noise.
    assert found.reverse_edge_mm < 2 * STEP**2 / 90.0 / 4 + 3e-4


def test_the_frame_of_the_reverse_motion_is_the_part(clean):
    lying = Pose(
        np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]), np.zeros(3), "surface", "part"
    )
    nominal = bare(turn=lying)

    found = bidirectional(at_home(tips(nominal, *net()), nominal))

    back = lying.inverse()
    np.testing.assert_allclose(
        found.reverse_translation_mm, back.rotate(np.array([clean.reverse_translation_mm]))[0], atol=1e-8
    )
    np.testing.assert_allclose(
        found.reverse_rotation_rad, back.rotate(np.array([clean.reverse_rotation_rad]))[0], atol=1e-9
    )


@pytest.mark.parametrize(
    "reason",
    [{"criterion": "minimum-zone"}, {"weights": "area"}, {"locked": ("tx",)}, {"n_fiducials": 3}],
    ids=lambda reason: next(iter(reason)),
)
def test_a_pose_moved_on_purpose_is_not_held_against_the_alignment(reason):
    off = Pose(np.eye(3), np.array([0.004, 0.0, 0.002]), "part", "part")
    laid = at_home(tips(bare(), *net(1.5)), bare(), start=off @ HOME)
    told = replace(laid, report=replace(laid.report, **reason))

    assert not bidirectional(laid).at_rest
    assert bidirectional(told).consistent
    assert bidirectional(laid, best_fit=False).consistent
    assert not bidirectional(told, best_fit=True).at_rest


def test_of_many_points_an_even_sample_is_taken(monkeypatch):
    monkeypatch.setattr("cmm_align.stages.bidirectional.MOST_POINTS", 2000)

    found = bidirectional(at_home(tips(bare(), *net()), bare()))

    assert found.forward.n == 2000
    assert found.n_measured == len(net()[0])
    np.testing.assert_allclose(found.spacing_mm, np.sqrt(58.0 * 38.0 / 2000), rtol=0.1)
    assert found.consistent, found.words


def test_a_gap_is_left_out():
    x, y = net()
    hole = np.hypot(x, y) < 6.0

    found = bidirectional(at_home(tips(bare(), x[~hole], y[~hole]), bare()))

    # The points next to the hole stand within a diagonal of a cell from it; facets that reach into it are no
    # longer than `SLIVER` allows.
    share = np.pi * 6.0**2 / (58.0 * 38.0)
    outwards, inwards = np.hypot(STEP, STEP) / 6.0, SLIVER_MM / 6.0
    assert 1.0 - share * (1.0 + outwards) ** 2 <= found.covered <= 1.0 - share * (1.0 - inwards) ** 2
    assert found.consistent, found.words


SLIVER_MM = 4.0 * np.hypot(STEP, STEP) * 1.2
"""Longest edge of a facet that is kept, on the slope."""


def test_an_outlier_does_not_stand_as_a_spike_in_the_facets():
    x, y = net()
    wrong = np.zeros(x.size)
    wrong[x.size // 2] = 1.0

    found = bidirectional(best(tips(bare(), x, y, wrong), bare()))

    assert found.n_measured == x.size - 1
    assert np.abs([found.backward.max_mm, found.backward.min_mm]).max() < 0.01


def test_points_on_one_line_are_refused():
    alignment = at_home(tips(bare(), *net()), bare())
    line = alignment.used & (np.abs(alignment.tip_centre_part_mm[:, 1]) < 0.1)
    few = np.zeros_like(line)
    few[:4] = True

    for used in (few, np.zeros_like(line)):
        with pytest.raises(GeometryError, match="triangulated"):
            bidirectional(replace(alignment, used=used))
    straight = alignment.tip_centre_part_mm.copy()
    straight[:, 1] = 2.0 * straight[:, 0]
    with pytest.raises(GeometryError, match="triangulated"):
        bidirectional(replace(alignment, tip_centre_part_mm=straight))


def test_the_result_can_be_kept_in_a_file(clean, tmp_path):
    with h5py.File(tmp_path / "kept.h5", "w") as file:
        write_record(file.create_group("bidirectional"), clean)

    with h5py.File(tmp_path / "kept.h5") as file:
        assert read_record(file, "/bidirectional", Bidirectional) == clean
