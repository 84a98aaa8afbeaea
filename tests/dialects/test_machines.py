"""Every machine profile that we ship reads what its machine sends, to the last printed digit."""

from __future__ import annotations

import re
from dataclasses import fields, replace

import numpy as np
import pytest
from dialects.streams import MACHINES, WRITERS, read, saddle_tip_centres_mm, stream_of

from cmm_align.dialects import DIALECTS, MachineProfile, decoded, points_of, read_profile, suspicions
from cmm_align.dialects.profile import COLUMN_WORDS, DEFAULT_COLUMNS, LIMITS

ULP_OF_A_PRODUCT = 2.0**-52
"""inch to mm is one rounding more than the decimals of the truth have."""


def test_every_profile_has_its_stream_and_every_dialect_its_profile():
    names = {path.stem for path in MACHINES.glob("*.toml")}

    assert names == set(WRITERS)
    assert {read_profile(MACHINES / f"{name}.toml").dialect for name in names} == set(DIALECTS)
    assert set(DIALECTS) == set(DEFAULT_COLUMNS) == set(COLUMN_WORDS)


@pytest.mark.parametrize("name", WRITERS)
def test_a_stream_gives_the_points_to_the_last_printed_digit(name):
    stream = stream_of(name)

    points, rejected, _ = points_of(decoded([stream.raw], stream.profile), name, stream.profile)

    rtol = ULP_OF_A_PRODUCT if stream.profile.units == "inch" else 0.0
    np.testing.assert_allclose(points.points_mm, stream.truth_mm, rtol=rtol, atol=0.0)
    assert rejected == ()
    assert points.kind is stream.profile.kind
    assert points.frame == "machine"
    half_a_digit_mm = 0.5 * 10.0 ** -WRITERS[name][0] * (25.4 if stream.profile.units == "inch" else 1.0)
    error_mm = np.abs(points.points_mm - saddle_tip_centres_mm()[:, :3]).max()
    assert error_mm <= half_a_digit_mm * (1.0 + 1e-9)


@pytest.mark.parametrize("name", WRITERS)
def test_a_good_stream_raises_no_suspicion(name):
    stream = stream_of(name)

    assert suspicions(stream.raw, stream.profile) == ()


@pytest.mark.parametrize("name", WRITERS)
def test_the_terminator_any_reads_the_same(name):
    stream = stream_of(name)

    assert (
        read(stream.raw, replace(stream.profile, terminator="any")).points_mm
        == read(stream.raw, stream.profile).points_mm
    )


def test_the_first_example_explains_every_setting_that_several_dialects_have():
    text = (MACHINES / "generic_xyz.toml").read_text(encoding="utf-8")
    explained = set(re.findall(r"^(\w+) = .*#", text, re.MULTILINE)) | {"name"}
    elsewhere = {"rotary_scale", "rotary_band_deg", "hit_code", "worst_quality"}

    assert explained == {field.name for field in fields(MachineProfile)} - elsewhere
    others = "".join(path.read_text(encoding="utf-8") for path in MACHINES.glob("*.toml"))
    assert all(re.search(rf"^{key} = .*#", others, re.MULTILINE) for key in elsewhere)


def test_the_defaults_lie_within_their_limits():
    for field in fields(MachineProfile):
        value = getattr(MachineProfile(), field.name)
        numbers = value if isinstance(value, tuple) else (value,)
        if isinstance(numbers[0], int | float) and not isinstance(numbers[0], bool):
            low, high = LIMITS[field.name]
            assert all(low <= number <= high for number in numbers), field.name
