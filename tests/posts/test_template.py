"""Formats of a user's own: every mistake in their description is named, and what they write comes back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from truth_corrections import ON_ITS_SIDE, Bowl, correction_to

from cmm_align import posts
from cmm_align.config import ExportConfig
from cmm_align.errors import MalformedInputError, MissingFileError, UsageError
from cmm_align.numerics.wheel import Wheel
from cmm_align.posts.template import template_of

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "configs" / "posts").glob("*.toml"))
PLAIN = {"schema": "cmm-align/post/1", "line": "X{x} Y{y} Z{z}"}
WHEEL = Wheel(30.0)


@pytest.fixture(scope="module")
def correction():
    return correction_to(Bowl(60.0, 10.0, 8.0), step_mm=1.0, surface_from_part=ON_ITS_SIDE)


def round_trip(tmp_path, correction, post, wheel=WHEEL, **settings):
    path = tmp_path / f"part{posts.suffix_of('template', post)}"
    job = posts.ExportJob(correction, ExportConfig(**settings), wheel=wheel, name="my part 1")
    posts.write_export(path, "template", job, post)
    up = np.array([1.0, 0.0, 0.0])  # of a part on its side
    return path, posts.read_back(path, "template", wheel, post=post, outward=up)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_comes_back(tmp_path, correction, example):
    post = posts.read_template(str(example))
    path, found = round_trip(tmp_path, correction, post)
    assert "post" in path.suffixes[0]
    away = np.linalg.norm(found.points_mm - np.array([60.0, 0.0, 0.0]), axis=1) - 60.0
    assert np.abs(away).max() <= found.accuracy_mm + 1e-9
    assert found.accuracy_mm <= 1e-5
    assert (found.tool_centres_mm is None) == ("{cx}" not in post.line)


@pytest.mark.parametrize("line", ["G1 X{x} Y{y} Z{z} F200", "{x},{y},{z},{i},{j},{k}", "P{n}:{x}|{y}|{z}"])
@pytest.mark.parametrize("footer", ["", "END", "END\nEND\n"])
@pytest.mark.parametrize("ending", ["lf", "crlf"])
def test_lines_with_digits_signs_and_any_ends(tmp_path, correction, line, footer, ending):
    post = template_of(
        PLAIN
        | {"line": line, "header": "a\nb\n", "footer": footer, "line_ending": ending, "plus_sign": True},
        "p",
    )
    _, found = round_trip(tmp_path, correction, post)
    points, _ = posts.points_and_normals(correction)
    np.testing.assert_allclose(found.points_mm, points, atol=0.5001e-6)


def test_header_and_footer_are_filled_in(tmp_path, correction):
    post = template_of(
        PLAIN | {"header": "({name} {points} {units} {wheel_radius} {feed})\n", "units": "um", "decimals": 4},
        "p",
    )
    path, _ = round_trip(tmp_path, correction, post, feed_mm_min=5.0)
    path.write_bytes(path.read_bytes() + b"X1.0")
    with pytest.raises(MalformedInputError, match="not a whole file"):
        posts.read_back(path, "template", post=post)
    assert path.read_text().splitlines()[0] == "(MY_PART_1 357 um 30000 5000)"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"line": "X{x} Y{y} Z{zz}"}, "unknown placeholder {zz} in line; expected one of x, y, z, i, j, k"),
        ({"header": "{points} {what}"}, "unknown placeholder {what} in header; expected one of name, points"),
        ({"line": "X{x} Y{y}"}, "one line with {x}, {y}, {z}"),
        ({"line": "{x}{y}{z}"}, "something between the numbers"),
        ({"line": "{x}1{y} {z}"}, "something between the numbers"),
        ({"line": "{x} {y} {z} {x}"}, "each placeholder once"),
        ({"line": "{x} {y} {z} }"}, "a loose brace"),
        ({"header": "Größe"}, "not ASCII"),
        ({"order": "zigzag"}, "rows or raster-x"),
        ({"decimal_sign": ";"}, ". or ,"),
        ({"suffix": ".h5"}, "suffix"),
        ({"suffix": "/../x"}, "suffix"),
        ({"decimals": "6"}, "a int"),
        ({"colour": "red"}, "unknown key 'colour'"),
        ({"schema": "other"}, "no description"),
    ],
)
def test_a_wrong_description_is_refused(change, words):
    with pytest.raises(MalformedInputError) as caught:
        template_of(PLAIN | change, "post.toml")
    assert words in str(caught.value)


@pytest.mark.parametrize(("units", "least"), [("mm", 6), ("um", 3), ("inch", 8), ("m", 9)])
def test_too_few_decimals_are_refused_and_the_fewest_are_taken(units, least):
    assert template_of(PLAIN | {"units": units}, "p").decimals == least
    with pytest.raises(UsageError, match="more than 1 nm"):
        template_of(PLAIN | {"units": units, "decimals": least - 1}, "p")


def test_normals_too_coarse_for_the_wheel_are_refused(tmp_path, correction):
    post = template_of(PLAIN | {"line": "{x} {y} {z} {i} {j} {k}", "normal_decimals": 6}, "p")
    with pytest.raises(UsageError, match="6 decimals of normals"):
        round_trip(tmp_path, correction, post)
    assert list(tmp_path.iterdir()) == []


def test_tool_centres_want_a_wheel_and_a_file_its_form(tmp_path, correction):
    post = template_of(PLAIN | {"line": "{cx} {cy} {cz}"}, "p")
    with pytest.raises(UsageError, match="needs the wheel"):
        round_trip(tmp_path, correction, post, wheel=None)
    path, _ = round_trip(tmp_path, correction, post)
    with pytest.raises(MalformedInputError, match="lines like"):
        posts.read_back(path, "template", WHEEL, post=template_of(PLAIN, "p"))
    with pytest.raises(MalformedInputError, match="a direction outwards"):
        posts.read_back(path, "template", WHEEL, post=post)


def test_a_missing_description_is_an_input_error(tmp_path):
    with pytest.raises(MissingFileError):
        posts.read_template(str(tmp_path / "none.toml"))
