"""Where a map is known and how well: holes, missing rows, L-shaped and uneven scans against their truth."""

from functools import cache

import numpy as np
import pytest
from truth_maps import WINDOW, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.stages.error_map import error_map
from cmm_align.stages.map_grid import points_apart

NOISE_MM = 1e-3
HALF_STEP = 0.51  # the rule, and a hundredth for directions that are not sampled
DIRECTIONS = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)


def lines(missing=()):
    """31 scan lines 2 mm apart, with some left out."""
    y = np.delete(np.linspace(-30.0, 30.0, 31), list(missing))
    x, y = np.meshgrid(np.linspace(-50.0, 50.0, 150), y)
    return x.ravel(), y.ravel()


def random_where(keep, n=2500):
    def places(seed):
        x, y = random_places(WINDOW, n, seed)
        kept = keep(x, y, np.random.default_rng(seed + 500).random(n))
        return x[kept], y[kept]

    return places


CASES = {
    "everywhere": random_where(lambda x, y, u: u < 2.0),
    "a hole of 3 mm": random_where(lambda x, y, u: np.hypot(x - 5.0, y - 3.0) > 3.0),
    "a hole of 7 mm": random_where(lambda x, y, u: np.hypot(x - 5.0, y - 3.0) > 7.0),
    "a hole of 15 mm": random_where(lambda x, y, u: np.hypot(x - 5.0, y - 3.0) > 15.0),
    "an L": random_where(lambda x, y, u: (x < 0.0) | (y < 0.0)),
    "dense and sparse": random_where(lambda x, y, u: (x < 0.0) | (u < 0.15)),
    "scan lines": lambda seed: lines(),
    "a line missing": lambda seed: lines([12]),
    "four lines missing": lambda seed: lines([8, 9, 10, 20]),
}


@cache
def made(name, seed=0):
    x, y = CASES[name](seed)
    return x, y, error_map(aligned(WINDOW, form_error_mm, (x, y), noise_mm=NOISE_MM, seed=seed + 100))


def outside_hull(x, y, m):
    """How far each known node lies outside the hull of the points in its window, in steps."""
    step_x, step_y = np.diff(m.x_mm)[0], np.diff(m.y_mm)[0]
    towards = np.stack([np.cos(DIRECTIONS), np.sin(DIRECTIONS)])
    found = []
    for iy, ix in np.argwhere(np.isfinite(m.deviation_mm)):
        u, v = (x - m.x_mm[ix]) / step_x, (y - m.y_mm[iy]) / step_y
        near = (np.abs(u) < 1.5) & (np.abs(v) < 1.5)
        found.append(-np.min((np.stack([u[near], v[near]], axis=1) @ towards).max(axis=0)))
    return np.maximum(found, 0.0)


@pytest.mark.parametrize("name", CASES)
def test_no_node_lies_more_than_half_a_step_outside_the_points_that_make_it(name):
    away = outside_hull(*made(name))
    assert away.max() <= HALF_STEP
    assert np.mean(away > 0.1) < 0.08  # the border of the data, no more


@pytest.mark.parametrize("name", CASES)
def test_the_stated_uncertainty_is_that_of_the_errors_at_the_nodes(name):
    z2, n = [], []
    for seed in range(4):
        _, _, m = made(name, seed)
        known = np.isfinite(m.deviation_mm)
        truth = form_error_mm(*np.meshgrid(m.x_mm, m.y_mm))[known]
        z2.append(np.mean(((m.deviation_mm[known] - truth) / m.sigma_mm[known]) ** 2))
        n.append(known.sum() / 4.0)  # neighbours share most of nine cells: about a quarter is independent
    # the mean square of N independent values is 1 +- sqrt(2 / N); 6 % more for what the form adds
    assert np.mean(z2) == pytest.approx(1.0, abs=0.06 + 3.0 * np.sqrt(2.0 / np.sum(n)))


@pytest.mark.parametrize(("radius", "name"), [(7.0, "a hole of 7 mm"), (15.0, "a hole of 15 mm")])
def test_a_hole_stays_a_hole_and_all_around_it_is_known(radius, name):
    _, _, m = made(name)
    r = np.hypot(*(g - c for g, c in zip(np.meshgrid(m.x_mm, m.y_mm), (5.0, 3.0), strict=True)))
    known = np.isfinite(m.deviation_mm)
    assert not known[r < radius - 0.75 * m.spacing_mm].any()
    assert known[(r > radius + m.spacing_mm) & (r < radius + 10.0)].all()


def test_a_single_missing_line_is_bridged_and_three_are_not():
    assert np.isfinite(made("a line missing")[2].deviation_mm).all()
    _, _, m = made("four lines missing")
    gap = np.abs(m.y_mm - (-12.0)) < 2.0  # the middle of lines 8, 9 and 10
    assert gap.any()
    assert np.isnan(m.deviation_mm[gap]).all()
    assert np.isfinite(m.deviation_mm[m.y_mm > 0.0]).all()


@pytest.mark.parametrize("n", [300, 1000, 20_000])
def test_the_rms_of_the_map_is_that_of_the_form_over_the_part(n):
    x, y = np.meshgrid(np.linspace(-51.0, 51.0, 511), np.linspace(-31.0, 31.0, 311))
    truth = np.sqrt(np.mean(form_error_mm(x, y) ** 2))
    ratio = []
    for seed in range(6 if n < 5000 else 2):
        places = random_places(WINDOW, n, seed)
        m = error_map(aligned(WINDOW, form_error_mm, places, noise_mm=0.3e-3, seed=seed))
        ratio.append(m.statistics.rms_mm / truth)
    # a quadratic over three steps h flattens waves by about (h k)^4: 2 % where h = 5 mm, nothing at 1 mm
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.03 if n < 5000 else 0.01)


def test_points_on_the_very_border_count_as_single_points_but_not_twice_in_the_map():
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(-51.0, 51.0, 26), np.linspace(-31.0, 31.0, 16)))
    fine = np.meshgrid(np.linspace(-51.0, 51.0, 511), np.linspace(-31.0, 31.0, 311))
    truth = np.sqrt(np.mean(form_error_mm(*fine) ** 2))
    m = error_map(aligned(WINDOW, form_error_mm, (x, y)))
    assert (
        m.point_statistics.rms_mm > 1.1 * truth
    )  # an eighth of the points stand for a sixteenth of the area
    assert m.statistics.rms_mm == pytest.approx(truth, rel=0.02)


def test_a_sparse_half_makes_the_grid_coarser_and_one_too_sparse_is_told_and_had_on_request():
    assert made("dense and sparse")[2].coverage > 0.95
    assert made("dense and sparse")[2].spacing_mm > 1.2 * made("everywhere")[2].spacing_mm
    x, y = random_where(lambda x, y, u: (x < 0.0) | (u < 0.03), n=8000)(0)
    again = aligned(WINDOW, form_error_mm, (x, y), noise_mm=NOISE_MM, seed=100)
    m = error_map(again)
    assert m.coverage < 0.65
    n_apart, spacing_mm = points_apart(m)
    assert 0.5 * np.sum(x > 0.0) < n_apart <= np.sum(x > -m.spacing_mm)
    coarse = error_map(again, ErrorMapConfig(spacing_mm=spacing_mm))
    assert coarse.coverage > 0.95
    assert points_apart(coarse)[0] < 0.1 * n_apart
    assert points_apart(made("everywhere")[2])[0] < 3
