"""Grid sag of Zemax in and out, CODE V interferograms out: row order, units, holes, contradictions."""

from __future__ import annotations

import numpy as np
import pytest

from cmm_align import files
from cmm_align.errors import MalformedInputError, OutputExistsError, UnitsError, UsageError, WrongStageError
from cmm_align.formats.codev_int import read_heights
from cmm_align.formats.source import load

X, Y = np.arange(-9.0, 13.0, 2.0) + 0.5, np.arange(-6.0, 9.0, 1.5)
XX, YY = np.meshgrid(X, Y)


def height(x, y):
    return 0.003 * x * x - 0.002 * y * y + 2e-4 * x * x * y + 0.01 * y


SLOPES = (0.006 * XX + 4e-4 * XX * YY, -0.004 * YY + 2e-4 * XX * XX + 0.01, 4e-4 * XX)


def dat(order=1, slopes=(1, 1), first=None, comment=""):
    """A file made by hand: upper left corner first, x fastest."""
    nx, ny = len(X), len(Y)
    head = first or f"{nx} {ny} 2.0 1.5 0 {X.mean()} {Y.mean()}"
    lines = [comment + head]
    for j in range(ny)[::-1]:
        for i in range(nx):
            z = height(X[i], Y[j if order == 1 else ny - 1 - j])
            zx, zy, zxy = (s[j, i] for s in SLOPES)
            lines.append(f"{z:.9f} {slopes[0] * zx:.9f} {slopes[1] * zy:.9f} {zxy:.9f}")
    return "\n".join([*lines, ""])


def read(tmp_path, text, **options):
    path = tmp_path / "sag.dat"
    path.write_text(text)
    return files.read_nominal_any(path, **options)


@pytest.mark.parametrize("comment", ["", "! a comment\n\n! another\n"])
def test_the_upper_left_corner_comes_first(comment, tmp_path):
    points = read(tmp_path, dat(comment=comment))
    x, y, z = points.points_mm.T
    assert (points.kind, points.frame) == ("nominal", "part")
    assert len(points) == XX.size
    np.testing.assert_allclose(z, height(x, y), atol=0.51e-9)
    assert (x.min(), x.max(), y.min(), y.max()) == (X[0], X[-1], Y[0], Y[-1])


@pytest.mark.parametrize(("flag", "scale"), [(0, 1.0), (1, 10.0), (2, 25.4), (3, 1000.0)])
def test_the_unit_flag_scales_lengths_and_not_slopes(flag, scale, tmp_path):
    text = dat(first=f"{len(X)} {len(Y)} 2.0 1.5 {flag} {X.mean()} {Y.mean()}")
    x, y, z = read(tmp_path, text).points_mm.T / scale
    np.testing.assert_allclose(z, height(x, y), atol=1e-9)
    with pytest.raises(UnitsError):
        read(tmp_path, text, units="um")


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (dat(order=-1), "dz/dx and dz/dy contradict"),
        (dat(slopes=(1, -1)), "the rows look reversed"),
        (dat(slopes=(-1, 1)), "the columns look reversed"),
        (dat(slopes=(1000, 1000)), "contradict"),
    ],
)
def test_slopes_that_contradict_the_heights_are_refused(text, cause, tmp_path):
    with pytest.raises(MalformedInputError, match=cause) as caught:
        read(tmp_path, text)
    assert "contradict the heights" in caught.value.what


def test_slopes_of_zero_are_not_stated_and_decide_nothing(tmp_path):
    assert len(read(tmp_path, dat(slopes=(0, 0)))) == XX.size


@pytest.mark.parametrize("derivatives", [None, SLOPES])
def test_what_is_written_comes_back(derivatives, tmp_path):
    z = height(XX, YY)
    z[0, 0] = z[4, 3] = np.nan
    path = tmp_path / "out.dat"
    files.write_grid(path, X, Y, z, derivatives=derivatives)
    assert path.read_text().splitlines()[0] == "11 10 2 1.5 0 1.5 0.75"
    points = files.read_nominal_any(path).points_mm
    expected = np.column_stack([XX.ravel(), YY.ravel(), z.ravel()])[np.isfinite(z).ravel()]
    np.testing.assert_allclose(points, expected, atol=0.51e-9)
    with pytest.raises(OutputExistsError):
        files.write_grid(path, X, Y, z)
    with pytest.raises(WrongStageError, match="these are nominal points"):
        files.read_measured(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (dat().rsplit("\n", 2)[0], r"109 points; expected 11 x 10 = 110"),
        (dat().replace("\n", "\n1 2 3 4\n", 1), r"111 points"),
        (dat()[:-3].rsplit(" ", 1)[0] + " oops\n", r"sag\.dat:111: .*oops"),
        (dat(first="4 4 1 1 0 0 0"), "4 x 4 points"),
        (dat(first="11 10 0 1 0 0 0"), "0 x 1 mm apart"),
    ],
)
def test_a_damaged_file_says_where(text, message, tmp_path):
    with pytest.raises(MalformedInputError, match=message):
        read(tmp_path, text)


def test_the_binary_namesake_of_zygo_is_told_apart(tmp_path):
    path = tmp_path / "sag.dat"
    path.write_bytes(b"\x88\x1b\x03\x6f" + bytes(900))
    with pytest.raises(MalformedInputError, match="Zygo interferometer"):
        files.read_nominal_any(path)


def test_codev_heights_are_image_rows_of_whole_numbers(tmp_path):
    z = height(XX, YY)
    z[2, 1] = np.nan
    path = tmp_path / "out.int"
    files.write_grid(path, X, Y, z, "codev", title="a saddle " * 20)
    lines = path.read_text().splitlines()
    assert len(lines[0]) <= 80
    assert lines[1].startswith("GRD 11 10 SUR WVL 1.0 SSZ ")
    grid = read_heights(load(path))
    assert grid.content == "SUR"
    np.testing.assert_allclose(grid.z_mm, z, atol=0.51 * np.nanmax(np.abs(z)) / 32767)
    top_left = int(lines[2].split()[0])
    assert top_left == round(z[-1, 0] / np.nanmax(np.abs(z)) * 32767)
    with pytest.raises(MalformedInputError, match="11 x 10 heights without the distance"):
        files.read_nominal_any(path)


def test_codev_heights_of_zero_are_written(tmp_path):
    files.write_grid(tmp_path / "flat.int", X, Y, np.zeros_like(XX), "codev", title="! not a comment")
    assert (read_heights(load(tmp_path / "flat.int")).z_mm == 0.0).all()


@pytest.mark.parametrize(
    "text",
    [
        "title\nGRD 3 2 SUR WVL 1.0 SSZ 1\n1 2 3\n4 5\n",
        "title\nGRD 3 2 SUR WVL 1.0 SSZ 1\n1 2 3\n4 5 x\n",
        "title\nGRD 3 2 SUR WVL 1.0\n1 2 3 4 5 6\n",
        "title\nGRD 3 2 SUR WVL 1.0 SSZ 0\n1 2 3 4 5 6\n",
    ],
)
def test_a_damaged_codev_file_is_refused(text, tmp_path):
    (tmp_path / "a.int").write_text(text)
    with pytest.raises(MalformedInputError, match=r"a\.int.*expected"):
        read_heights(load(tmp_path / "a.int"))


@pytest.mark.parametrize(
    ("x", "y", "z", "form"),
    [
        (X[:4], Y, np.zeros((10, 4)), "zemax"),
        (X**3, Y, np.zeros((10, 11)), "zemax"),
        (X, Y, np.zeros((11, 10)), "zemax"),
        (X, Y, np.zeros(3), "codev"),
        (X, Y, np.zeros((10, 11)), "png"),
    ],
)
def test_grids_that_a_form_cannot_hold_are_refused(x, y, z, form, tmp_path):
    with pytest.raises(UsageError):
        files.write_grid(tmp_path / "out", x, y, z, form)
    assert not (tmp_path / "out").exists()
