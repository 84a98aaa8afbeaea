"""Root causes: named where one is there, with the sign and the size that it has; none where none is."""

from dataclasses import replace

import numpy as np
import pytest
from truth_maps import PLANE, Quadric, aligned, form_error_mm, random_places

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import UnitsError, UsageError
from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.model.root_causes import CANNOT_TELL
from cmm_align.numerics.correlated_fit import tables
from cmm_align.pose import Pose
from cmm_align.stages import root_causes as stage
from cmm_align.stages.align import align
from cmm_align.stages.error_map import error_map
from cmm_align.stages.root_causes import axis_from_text, root_causes
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.virtual.cmm import machine_from_part, scan_lines
from cmm_align.virtual.window import window

NOISE_MM = 3e-4
DEMO = window()
ARCSEC = np.pi / 648000.0
INSIDE = Quadric(half_x=50.0, half_y=30.0)
CAP = Quadric(half_x=40.0, half_y=40.0, c=0.005, d=0.005, round=True)


def made(error, n=2500, seed=1, surface=DEMO):
    """Exact deviations of a part, plus noise."""
    return aligned(surface, error, random_places(INSIDE, n, seed), noise_mm=NOISE_MM, seed=seed)


def frame(x, y, surface=DEMO):
    """Foot points about their centroid, and normals."""
    jet = surface.jet(x, y)
    p = np.stack([x, y, jet.z], axis=1)
    return p - p.mean(axis=0), unit_normal(jet, 1)


def named(found):
    """Name, value and standard uncertainty of everything that may be the first cause."""
    cause = found.causes[0]
    return {m.name: (m.value, m.u) for m in (cause, *cause.alternatives)}


def ogive(x, y):
    return 12e-3 * np.sum(np.stack([x, y], axis=1) * frame(x, y)[1][:, :2], axis=1) / np.hypot(x, y)


def scale_x(x, y):
    p, n = frame(x, y)
    return 300e-6 * p[:, 0] * n[:, 0]


def square_xy(x, y):
    p, n = frame(x, y)
    return 80.0 * ARCSEC * p[:, 1] * n[:, 0]


def thermal(x, y):
    p, n = frame(x, y)
    return 300e-6 * np.sum(p * n, axis=1)


@pytest.mark.parametrize(
    ("name", "error", "value"),
    [
        ("wheel radius", lambda x, _: 0.03 + 0 * x, -30.0),
        ("thermal scale", thermal, 300.0),
        ("wheel offset", ogive, -12.0),
        ("scale of x", scale_x, 300.0),
        ("squareness of x and y", square_xy, 80.0),
    ],
)
def test_a_single_cause_is_named_with_its_sign_and_size(name, error, value):
    found = root_causes(made(error))
    assert len(found.causes) == 1
    got, u = named(found)[name]
    assert got == pytest.approx(value, abs=3.5 * u)
    assert u < 0.1 * abs(value)
    first = found.causes[0]
    assert first.share > 0.5
    assert first.rms_without_um == pytest.approx(NOISE_MM * 1e3, rel=0.06)  # 1 / sqrt(2 n) is 1.4 %
    assert found.dominant is first
    assert 1.0 - (first.rms_without_um / found.rms_um) ** 2 == pytest.approx(first.share, rel=1e-9)


def test_a_stylus_that_was_entered_too_small_is_to_be_made_larger_by_as_much():
    # Tip centres of a ball of 1.52 mm, aligned with 1.5 mm: every contact point seems 20 um too high.
    x, y = scan_lines(DEMO.bounds, lines=25, per_line=61)
    jet = DEMO.jet(x, y)
    n = unit_normal(jet, 1)
    noise = NOISE_MM * np.random.default_rng(3).standard_normal(len(x))
    tips = machine_from_part().apply(np.stack([x, y, jet.z], axis=1) + (1.52 + noise)[:, None] * n)
    nominal = Nominal(DEMO, 1, 1.5, Pose.identity("surface", "part"), "0" * 64)
    found = root_causes(align(PointSet.of(tips, kind=PointKind.TIP_CENTRE), nominal))
    stylus, wheel = named(found)["stylus radius"], named(found)["wheel radius"]
    assert stylus[0] == pytest.approx(20.0, abs=3.5 * stylus[1])
    assert wheel[0] == pytest.approx(-stylus[0])  # e = const is both; the wheel would be too small
    assert "the data cannot tell which" in found.words
    assert "set that first" in found.words


@pytest.mark.parametrize(("order", "name", "angle"), [(2, "two", 31.0), (3, "three", 100.0)])
def test_clamping_has_its_pv_and_the_angle_of_a_lobe(order, name, angle):
    def error(x, y):
        w = (x + 1j * y) / np.hypot(50.0, 30.0)
        return 2e-3 * (w**order * np.exp(-1j * order * np.radians(angle))).real

    alignment = made(error)
    cause = root_causes(alignment).causes[0]
    pv = np.ptp(error(*random_places(INSIDE, 2500, 1))) * 1e3
    assert cause.name == f"clamping, {name} lobes"
    assert cause.value == pytest.approx(pv, abs=3.5 * cause.u)
    assert cause.angle_deg == pytest.approx(angle, abs=3.5 * cause.u_angle_deg)


def test_drift_and_the_axes_of_the_machine_are_told_in_the_frame_of_the_machine():
    x, y = scan_lines(DEMO.bounds, lines=25, per_line=61)
    bare = aligned(DEMO, lambda x, _: 0 * x, (x, y))
    pose = machine_from_part().inverse()
    n = pose.inverse().rotate(bare.normals)
    tips = pose.inverse().apply(bare.tip_centre_part_mm)
    time = np.linspace(-0.5, 0.5, len(x))
    noise = NOISE_MM * np.random.default_rng(3).standard_normal(len(x))
    for name, e, value in (
        ("drift along z", 8e-3 * time * n[:, 2], 8.0),
        ("measuring machine's scale of x", 90e-6 * (tips - tips.mean(axis=0))[:, 0] * n[:, 0], 90.0),
    ):
        moved = replace(
            bare,
            part_from_machine=pose,
            tip_centre_machine_mm=tips,
            deviation_mm=e + noise,
            contact_part_mm=bare.contact_part_mm + (e + noise)[:, None] * bare.normals,
        )
        got, u = named(root_causes(moved))[name]
        assert got == pytest.approx(value, abs=3.5 * u)


def test_on_a_cap_of_100_mm_radii_and_scale_are_one_combination():
    # Radius 100 mm: beyond the rigid motion all of them are the same shape.
    places = random_places(CAP, 2500)
    found = root_causes(aligned(CAP, lambda x, _: 0.03 + 0 * x, places, noise_mm=NOISE_MM))
    assert len(found.causes) == 1
    members = named(found)
    assert {"wheel radius", "stylus radius", "thermal scale"} <= set(members)
    assert members["stylus radius"][0] == pytest.approx(30.0, abs=3.5 * members["stylus radius"][1])
    assert members["thermal scale"][0] == pytest.approx(-300.0, rel=0.2)  # 30 um on 100 mm
    even = [m.name for m in found.causes[0].alternatives if m.times_less_likely <= CANNOT_TELL]
    assert "stylus radius" in even
    assert found.causes[0].name == "wheel radius"


def test_two_causes_at_once_are_both_found():
    def error(x, y):
        w = (x + 1j * y) / np.hypot(50.0, 30.0)
        return scale_x(x, y) + 8e-3 * (w**3).real

    found = root_causes(made(error))
    assert {c.name for c in found.causes} == {"scale of x", "clamping, three lobes"}
    for cause in found.causes:
        if cause.name == "scale of x":
            assert cause.value == pytest.approx(300.0, abs=3.5 * cause.u)
    assert found.rms_without_um == pytest.approx(NOISE_MM * 1e3, rel=0.06)


def test_shares_add_up_to_what_all_causes_explain_together():
    def error(x, y):
        w = (x + 1j * y) / np.hypot(50.0, 30.0)
        return scale_x(x, y) + 8e-3 * (w**3).real + 0.03

    found = root_causes(made(error))
    assert {"scale of x", "clamping, three lobes", "wheel radius"} == {c.name for c in found.causes}
    explained = 1.0 - (found.rms_without_um / found.rms_um) ** 2
    assert sum(c.share for c in found.causes) == pytest.approx(explained, rel=1e-9)


def random_form(seed, length_mm):
    rng = np.random.default_rng(seed)
    k, phase = rng.standard_normal((200, 2)) / length_mm, rng.uniform(0, 2 * np.pi, (200, 1))
    return lambda x, y: 5e-4 * np.cos(k[:, :1] * x + k[:, 1:] * y + phase).sum(axis=0)


@pytest.mark.parametrize("length_mm", [8.0, 20.0, 60.0])
def test_form_error_without_a_cause_names_none(length_mm):
    for seed in range(2):
        found = root_causes(made(random_form(seed, length_mm), seed=seed))
        assert found.causes == ()
        assert found.words == "no single setting explains the deviations"
        assert found.correlation_mm > 0.0


def test_noise_alone_names_none():
    for seed in range(2):
        found = root_causes(made(lambda x, _: 0 * x, seed=seed))
        assert found.causes == ()
        assert found.rms_without_um == found.rms_um


def test_rigid_motions_change_nothing():
    plain = made(ogive)
    p, n = frame(*random_places(INSIDE, 2500, 1))
    e = plain.deviation_mm + np.sum(
        (np.cross([2e-5, -1e-5, 3e-5], p) + np.array([1e-3, -2e-3, 4e-3])) * n, axis=1
    )
    contact = plain.contact_part_mm + (e - plain.deviation_mm)[:, None] * plain.normals
    a = root_causes(plain)
    b = root_causes(replace(plain, deviation_mm=e, contact_part_mm=contact))
    assert [c.name for c in a.causes] == [c.name for c in b.causes]
    assert b.causes[0].value == pytest.approx(a.causes[0].value, rel=1e-6)
    assert b.rms_um == pytest.approx(a.rms_um, rel=1e-9)


def test_the_axis_of_rotation_can_be_told():
    def error(x, y):
        away = np.stack([x - 20.0, y + 5.0], axis=1)
        return 12e-3 * np.sum(away * frame(x, y)[1][:, :2], axis=1) / np.hypot(*away.T)

    m = error_map(made(error), ErrorMapConfig(cause_axis="20, -5mm"))
    got, u = named(m.root_causes)["wheel offset"]
    assert m.root_causes.axis_mm == (20.0, -5.0)
    assert got == pytest.approx(-12.0, abs=3.5 * u)
    assert m.root_causes.causes[0].name == "wheel offset"


def test_an_axis_that_is_none_is_refused():
    assert axis_from_text(" ") is None
    with pytest.raises(UsageError, match="two lengths"):
        axis_from_text("1,2,3")
    with pytest.raises(UnitsError):
        axis_from_text("a,b")


def test_what_a_motion_hides_is_said():
    found = root_causes(aligned(PLANE, form_error_mm, random_places(PLANE, 1000), noise_mm=NOISE_MM))
    assert {"wheel radius", "stylus radius", "scale of x"} <= set(found.hidden)
    assert not set(found.hidden) & set(found.looked_for)


def test_too_few_points_and_perfect_parts_say_why():
    few = root_causes(made(ogive, n=30))
    assert few.causes == ()
    assert few.words == "not looked for: 30 points, at least 36 are needed"
    perfect = root_causes(aligned(DEMO, lambda x, _: 0 * x, random_places(INSIDE, 500)))
    assert perfect.reason.startswith("no deviations")
    line = (np.linspace(-50, 50, 400), 1e-9 * np.sin(np.arange(400.0)))
    assert root_causes(aligned(DEMO, ogive, line)).reason == ""
    assert root_causes(aligned(DEMO, ogive, random_places(INSIDE, 500))).causes[0].name == "wheel offset"


def test_a_map_with_its_filter_still_tells_of_the_points_as_they_are():
    alignment = made(ogive)
    a = error_map(alignment).root_causes
    b = error_map(alignment, ErrorMapConfig(high_pass_mm=20.0)).root_causes
    assert a == b


def test_a_cause_is_not_named_by_one_that_is_alike_to_another():
    x = np.linspace(-1.0, 1.0, 40)
    columns = np.stack([x**2, -(x**2), x**3], axis=1)
    values = columns[:, 0] + columns[:, 2]
    everything = np.column_stack([columns, values])
    problem = stage._Problem(
        signatures=(),
        owner=tuple(np.array([k]) for k in range(3)),
        tables=tables(x[:, None], np.ones(40), np.ones((40, 1)), columns, values),
        candidates=(0, 1, 2),
        gram=everything.T @ everything / 40,
        columns=columns,
    )
    assert stage._named(problem, [0, 2], -np.inf) == [0, 2]
