"""Filtered maps: the wave asked for stays, the other goes, and the verdict is that of what is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import WINDOW, aligned, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import UsageError, WrongStageError
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map

LONG, SHORT = 60.0, 6.0


def two_waves(x, y):
    return 5e-3 * np.cos(2 * np.pi * x / LONG) + 1e-3 * np.cos(2 * np.pi * x / SHORT)


@pytest.fixture(scope="module")
def part():
    return aligned(WINDOW, two_waves, random_places(WINDOW, 20_000))


def fitted(m, wavelength):
    """Amplitude of a wave along x in the inner half of a map, by least squares."""
    x, _ = np.meshgrid(m.x_mm, m.y_mm)
    inner = np.isfinite(m.deviation_mm) & (np.abs(x) < 0.6 * np.abs(m.x_mm).max())
    waves = [f(2 * np.pi * x[inner] / w) for w in (LONG, SHORT) for f in (np.cos, np.sin)]
    found = np.linalg.lstsq(
        np.column_stack([*waves, np.ones(inner.sum())]), m.deviation_mm[inner], rcond=None
    )[0]
    k = 0 if wavelength == LONG else 2
    return float(np.hypot(found[k], found[k + 1]))


@pytest.mark.parametrize("kind", ["gaussian", "gaussian-order-0", "gaussian-robust", "spline"])
def test_a_low_pass_leaves_the_long_wave_and_a_high_pass_the_short_one(part, kind):
    plain = error_map(part)
    low = error_map(part, ErrorMapConfig(filter=kind, low_pass_mm=18.0))
    high = error_map(part, ErrorMapConfig(filter=kind, high_pass_mm=18.0))
    assert fitted(low, LONG) > 0.9 * fitted(plain, LONG)
    assert fitted(low, SHORT) < 0.1 * fitted(plain, SHORT)
    assert fitted(high, LONG) < 0.1 * fitted(plain, LONG)
    assert fitted(high, SHORT) > 0.9 * fitted(plain, SHORT)
    np.testing.assert_allclose(low.deviation_mm + high.deviation_mm, plain.deviation_mm, atol=1e-12)
    assert low.filter is not None
    assert low.filter.words == f"{kind}, low pass 18 mm"
    assert plain.filter is None


def test_the_verdict_is_that_of_the_filtered_map(part):
    asked = ErrorMapConfig(tolerance_pv_um=4.0, high_pass_mm=18.0)
    assert error_map(part, asked).verdict == "pass"
    assert error_map(part, replace(asked, high_pass_mm=0.0)).verdict == "fail"


def test_a_map_without_its_form_is_no_base_for_a_correction(part):
    with pytest.raises(WrongStageError, match="high pass 18 mm"):
        compensate(error_map(part, ErrorMapConfig(high_pass_mm=18.0)))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"filter": "boxcar", "low_pass_mm": 5.0}, "boxcar"),
        ({"low_pass_mm": 0.5}, "cutoff"),
        ({"low_pass_mm": 500.0}, "cutoff"),
        ({"low_pass_mm": 30.0, "high_pass_mm": 10.0}, "shorter wavelength first"),
    ],
)
def test_cutoffs_that_cannot_be_are_refused_with_the_limits(part, settings, words):
    with pytest.raises(UsageError, match=words):
        error_map(part, ErrorMapConfig(**settings))
