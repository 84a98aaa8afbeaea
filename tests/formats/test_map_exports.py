"""A map in other programs' formats, read back by readers that share no code with the writers."""

import importlib.util
import struct
from dataclasses import replace

import numpy as np
import pytest
from truth_maps import WINDOW, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import UsageError
from cmm_align.formats import map_csv, x3p, zygo_dat
from cmm_align.stages.error_map import error_map


def made(side=1):
    x, y = random_places(WINDOW, 3000)
    keep = np.hypot(x - 10.0, y) > 9.0
    a = aligned(WINDOW, form_error_mm, (x[keep], y[keep]), side=side, noise_mm=3e-4)
    return error_map(a, ErrorMapConfig(spacing_mm=2.0))


@pytest.fixture(scope="module")
def a_map():
    return made()


def test_the_table_holds_the_known_nodes_to_its_printed_digits(a_map, tmp_path):
    map_csv.write(a_map, tmp_path / "m.csv")
    text = (tmp_path / "m.csv").read_text()
    head = [line for line in text.splitlines() if line.startswith("#")]
    assert "frame=surface" in head[0]
    assert "along the outward normal" in head[1]
    assert a_map.method in head[3]
    table = np.genfromtxt(text.splitlines()[len(head) :], delimiter=",", names=True)
    known = np.isfinite(a_map.deviation_mm)
    x_grid, y_grid = np.meshgrid(a_map.x_mm, a_map.y_mm)
    assert len(table) == known.sum() < known.size
    np.testing.assert_allclose(table["x_mm"], x_grid[known], atol=0.51e-6)
    np.testing.assert_allclose(table["y_mm"], y_grid[known], atol=0.51e-6)
    for name, field in (
        ("deviation_um", a_map.deviation_mm),
        ("sag_deviation_um", a_map.sag_deviation_mm),
        ("u_um", a_map.sigma_mm),
    ):
        np.testing.assert_allclose(table[name], 1e3 * field[known], atol=0.51e-4)


@pytest.mark.parametrize("side", [1, -1])
def test_x3p_is_read_back_by_its_library_in_metres_and_in_place(side, tmp_path):
    x3pio = pytest.importorskip("x3pio")
    m = made(side)
    x3p.write(m, tmp_path / "m.x3p", time_utc="2026-01-31T12:00:00Z")
    found = x3pio.read(tmp_path / "m.x3p")
    np.testing.assert_array_equal(np.isnan(found.layers[0].z), np.isnan(m.sag_deviation_mm))
    np.testing.assert_allclose(1e3 * found.layers[0].z, m.sag_deviation_mm, rtol=1e-15)
    assert found.header.x.increment == pytest.approx(2e-3)
    assert found.metadata.date.year == 2026
    assert "along +z" in found.metadata.comment
    assert f"{'+' if side > 0 else '-'} = excess" in found.metadata.comment
    there = np.argwhere(np.isfinite(m.sag_deviation_mm))[0]
    points = found.layers[0].points()[tuple(there)]
    np.testing.assert_allclose(1e3 * points[:2], [m.x_mm[there[1]], m.y_mm[there[0]]], atol=1e-9)


def parsed_metropro(raw: bytes):
    """Read a MetroPro file as its manual lays it out; heights in m, row 0 at the top."""
    magic, kind, size = struct.unpack(">IHI", raw[:10])
    assert (magic, kind, size) == (0x881B036F, 1, 834)
    width, height, n_bytes = struct.unpack(">HHI", raw[68:76])
    assert len(raw) == size + n_bytes == size + 4 * width * height
    scale, wavelength = struct.unpack(">ff", raw[164:172])
    obliquity = struct.unpack(">f", raw[176:180])[0]
    lateral = struct.unpack(">f", raw[184:188])[0]
    counts = {0: 4096, 1: 32768, 2: 131072}[struct.unpack(">H", raw[218:220])[0]]
    phase = np.array(struct.unpack(f">{width * height}i", raw[size:]), float).reshape(height, width)
    phase[phase >= 2147483640] = np.nan
    return phase * scale * wavelength * obliquity / counts, lateral, raw[80:162].rstrip(b"\0").decode()


def test_metropro_holds_the_sag_to_half_a_count_top_row_first(a_map, tmp_path):
    zygo_dat.write(a_map, tmp_path / "m.dat", time_s=0)
    found, lateral, comment = parsed_metropro((tmp_path / "m.dat").read_bytes())
    count_m = 0.5 * 632.8e-9 / 32768
    np.testing.assert_array_equal(np.isnan(found[::-1]), np.isnan(a_map.sag_deviation_mm))
    np.testing.assert_allclose(1e3 * found[::-1], a_map.sag_deviation_mm, atol=0.51e3 * count_m)
    assert lateral == pytest.approx(2e-3, rel=1e-7)
    assert "along +z" in comment


def test_pixels_that_are_not_square_are_refused_with_the_spacing_that_helps(a_map, tmp_path):
    stretched = replace(a_map, x_mm=1.01 * a_map.x_mm)
    with pytest.raises(UsageError, match="square pixels") as caught:
        zygo_dat.write(stretched, tmp_path / "m.dat", time_s=0)
    assert "--spacing 2.02mm" in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_without_x3pio_the_command_that_installs_it_is_named(a_map, monkeypatch, tmp_path):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(UsageError, match=r"pip install 'cmm-align\[x3p\]'"):
        x3p.write(a_map, tmp_path / "m.x3p", time_utc="2026-01-31T12:00:00Z")
    assert not list(tmp_path.iterdir())
