"""The correction: its sign on both sides, Z against normal, and what it must refuse."""

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import PLANE, SLOPE_45, WINDOW, Quadric, aligned, form_error_mm, random_places

from cmm_align.config import CompensateConfig
from cmm_align.errors import InputError, UsageError, WrongStageError
from cmm_align.model import CorrectionStatus
from cmm_align.numerics.grid_field import interpolated
from cmm_align.stages.compensate import compensate, map_digest
from cmm_align.stages.error_map import error_map


def bump_mm(x, y):
    return 0.02 * np.exp(-(x**2 + y**2) / (2 * 15.0**2))


def measured(surface, error, *, n=6000, side=1, seed=0, noise_mm=0.0):
    return error_map(
        aligned(surface, error, random_places(surface, n, seed), side=side, seed=seed + 9, noise_mm=noise_mm)
    )


def reground(surface, error, correction):
    """What is left of an error after cutting exactly what was commanded."""
    full = np.where(np.isfinite(correction.correction_mm), correction.correction_mm, 0.0)

    def left(x, y):
        return error(x, y) + interpolated(correction.x_mm, correction.y_mm, full, x, y)

    return left


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("surface", [PLANE, SLOPE_45, WINDOW], ids=["plane", "45 degrees", "window"])
def test_excess_material_lowers_the_material_by_e_over_n_z(surface, side):
    c = compensate(measured(surface, bump_mm, side=side))
    xg, yg = np.meshgrid(c.x_mm, c.y_mm)
    jet = surface.jet(xg, yg)
    n_z = side / np.sqrt(1.0 + jet.zx**2 + jet.zy**2)
    np.testing.assert_allclose(c.commanded_z_mm, jet.z + c.correction_mm / n_z, atol=1e-12, equal_nan=True)
    middle = np.unravel_index(np.argmin(np.hypot(xg, yg)), xg.shape)
    assert c.correction_mm[middle] == pytest.approx(-0.02, rel=0.03)
    assert side * (c.commanded_z_mm - jet.z)[middle] < 0.0  # into the material, away from the probe


def test_on_a_slope_of_45_degrees_dz_is_larger_by_the_root_of_two():
    c = compensate(measured(SLOPE_45, bump_mm))
    dz = c.commanded_z_mm - np.meshgrid(c.x_mm, c.y_mm)[0]
    inside = np.isfinite(dz)
    np.testing.assert_allclose(dz[inside], np.sqrt(2.0) * c.correction_mm[inside], atol=1e-12)


@pytest.mark.parametrize("side", [1, -1])
def test_a_surface_point_moved_by_the_correction_lies_on_the_commanded_surface(side):
    """Independent route: nominal + correction * n, against the commanded height at its own (x, y)."""
    c = compensate(measured(WINDOW, bump_mm, side=side))
    x, y = random_places(Quadric(half_x=45.0, half_y=25.0), 500, seed=4)
    jet = WINDOW.jet(x, y)
    scale = side / np.sqrt(1.0 + jet.zx**2 + jet.zy**2)
    n = np.stack([-jet.zx * scale, -jet.zy * scale, scale])
    moved = np.stack([x, y, jet.z]) + interpolated(c.x_mm, c.y_mm, c.correction_mm, x, y) * n
    height = interpolated(
        c.x_mm, c.y_mm, c.commanded_z_mm - WINDOW.jet(*np.meshgrid(c.x_mm, c.y_mm)).z, *moved[:2]
    )
    # the shift aside is 20 um * 0.7, on which the correction changes by 1 um/mm at most: 0.02 um
    np.testing.assert_allclose(moved[2], WINDOW.jet(*moved[:2]).z + height, atol=5e-5)


@pytest.mark.parametrize("side", [1, -1])
def test_commanded_normals_are_those_of_the_commanded_surface(side):
    c = compensate(
        measured(WINDOW, lambda x, y: 2e-5 * (x**2 - y**2), side=side),
        CompensateConfig(max_correction_um=1e3),
    )
    zy, zx = np.gradient(c.commanded_z_mm, c.y_mm, c.x_mm)
    direct = side * np.stack([-zx, -zy, np.ones_like(zx)], axis=-1) / np.sqrt(1 + zx**2 + zy**2)[..., None]
    inner = (slice(4, -4), slice(4, -4))
    assert np.nanmax(np.abs(c.commanded_normal[inner] - direct[inner])) < 1e-5
    length = np.linalg.norm(c.commanded_normal, axis=-1)
    np.testing.assert_allclose(length[np.isfinite(length)], 1.0, atol=1e-12)


def test_one_virtual_pass_lowers_pv_at_least_fourfold_and_the_prediction_comes_true():
    first = measured(WINDOW, form_error_mm, n=20_000, noise_mm=3e-4)
    known = CompensateConfig(transfer="1", u_transfer=0.0, repeatability_um=0.0)
    c = compensate(first, known)
    second = measured(WINDOW, reground(WINDOW, form_error_mm, c), n=20_000, noise_mm=3e-4, seed=5)
    assert second.statistics.pv_mm < first.statistics.pv_mm / 4.0
    assert second.point_statistics.rms_mm == pytest.approx(c.predicted.rms_mm, rel=0.1)
    assert 3e-4 < c.predicted.rms_mm < 3.5e-4  # the noise of the points, and that of the map
    assert c.worth_another_pass
    assert "worth it" in c.reason
    again = compensate(second, known, previous=c)
    assert not again.worth_another_pass
    assert "not worth it" in again.reason


def test_passes_add_up_on_what_was_commanded_not_on_the_nominal():
    gain = CompensateConfig(gain=0.7)
    first = measured(WINDOW, bump_mm)
    one = compensate(first, gain)
    second = measured(WINDOW, reground(WINDOW, bump_mm, one), seed=7)
    two = compensate(second, gain, previous=one)
    x, y = random_places(Quadric(half_x=45.0, half_y=25.0), 500, seed=3)
    total = interpolated(two.x_mm, two.y_mm, two.total_correction_mm, x, y)
    np.testing.assert_allclose(total, -(1 - 0.3**2) * bump_mm(x, y), atol=2e-4)  # 1 % of the bump
    assert (one.pass_number, two.pass_number) == (1, 2)
    assert two.applied_maps == (map_digest(first),)


def test_the_surface_is_complete_over_the_aperture_and_says_what_was_continued():
    x, y = random_places(WINDOW, 20_000)
    keep = (np.hypot(x, y) > 6.0) & (np.abs(x) < 48.0) & (np.abs(y) < 28.0)
    m = error_map(aligned(WINDOW, form_error_mm, (x[keep], y[keep])))
    c = compensate(m)
    xg, yg = np.meshgrid(c.x_mm, c.y_mm)
    inside = WINDOW.contains(xg, yg)
    for array in (c.correction_mm, c.commanded_z_mm, c.commanded_normal[..., 2]):
        np.testing.assert_array_equal(np.isfinite(array), inside)
    assert c.extended[inside & ((np.abs(xg) > 48.5) | (np.abs(yg) > 28.5))].all()
    assert c.extended[np.hypot(xg, yg) < 5.0].all()
    assert not c.extended[inside & (np.hypot(xg, yg) > 7.5) & (np.abs(xg) < 47.0) & (np.abs(yg) < 27.0)].any()
    with_data = c.correction_mm[inside & ~c.extended]
    assert with_data.min() <= np.nanmin(c.correction_mm)
    assert with_data.max() >= np.nanmax(c.correction_mm)
    assert c.x_mm[0] <= -51.0 + 1e-9
    assert c.x_mm[-1] >= 51.0 - 1e-9


def test_the_gain_scales_the_correction():
    m = measured(WINDOW, bump_mm)
    half, full = compensate(m, CompensateConfig(gain=0.5)), compensate(m)
    with_data = half.status == CorrectionStatus.MEASURED
    np.testing.assert_allclose(half.correction_mm[with_data], 0.5 * full.correction_mm[with_data], atol=1e-15)


@pytest.mark.parametrize("gain", [0.0, -1.0, 1.21, float("nan")])
def test_a_gain_out_of_range_is_refused(gain):
    with pytest.raises(UsageError, match="gain"):
        compensate(measured(PLANE, bump_mm, n=500), CompensateConfig(gain=gain))


def test_a_correction_over_the_limit_names_place_and_size():
    with pytest.raises(InputError, match=r"19\.\d um at \(") as caught:
        compensate(measured(PLANE, bump_mm), CompensateConfig(max_correction_um=15.0))
    assert "at most 15 um" in str(caught.value)


def test_a_map_is_never_applied_twice_and_another_part_is_refused():
    m = measured(PLANE, bump_mm, n=1000)
    one = compensate(m)
    with pytest.raises(WrongStageError, match="twice"):
        compensate(m, previous=one)
    flat = measured(PLANE, lambda x, y: 0.0 * x, n=1000, seed=3)
    two = compensate(flat, previous=one)
    with pytest.raises(WrongStageError, match="twice"):
        compensate(m, previous=two)
    other = replace(one, nominal=replace(one.nominal, digest="1" * 64))
    with pytest.raises(WrongStageError, match="another nominal"):
        compensate(measured(PLANE, bump_mm, n=1000, seed=3), previous=other)


def test_an_aperture_far_larger_than_the_data_is_refused():
    huge = Quadric(half_x=5e5, half_y=5e5)
    with pytest.raises(InputError, match="aperture"):
        compensate(error_map(aligned(huge, bump_mm, random_places(WINDOW, 2000))))


def test_inputs_stay_as_they_were():
    m = measured(WINDOW, bump_mm, n=1000)
    before = m.deviation_mm.copy()
    compensate(m)
    np.testing.assert_array_equal(m.deviation_mm, before)
