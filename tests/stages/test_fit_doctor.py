from pathlib import Path

import closed_forms as cf
import numpy as np
import pytest

from cmm_align.model import Nominal
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.linearisation import Placement
from cmm_align.numerics.rigid_fit import fit
from cmm_align.pose import Pose
from cmm_align.stages.fit_doctor import Evidence, diagnose, explain_failure
from cmm_align.stages.mistakes import mistakes_of
from cmm_align.stages.offset import surface_digest
from cmm_align.surfaces.distance import smooth_measure
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.virtual.cmm import machine_from_part, scan_lines
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.window import window

MIRROR = Path(__file__).resolve().parents[2] / "sample_data" / "mirror_m2"
R = 1.5
HOME = Pose.identity("machine", "part")
FILE = Pose.identity("part", "machine")
WEAK = """
schema = "cmm-align/prescription/1"
[aperture]
shape = "rectangle"
width = 100.0
height = 60.0
[[term]]
kind = "conic"
radius = -400.0
conic = 0.0
[[term]]
kind = "xy_polynomial"
normalization_radius = 50.0
coefficients = { "2,0" = 0.15, "3,0" = 0.1, "2,1" = 0.08, "0,3" = -0.06 }
"""


def bare(surface, radius=R, side=1):
    flat = Pose.identity("surface", "part")
    return Nominal(surface, side, radius, flat, surface_digest(surface, side, flat))


def part(surface, deviation=None, *, noise=3e-4, keep=None):
    """Contact points and normals of a part with form error and noise."""
    x, y = scan_lines(surface.bounds, lines=11, per_line=30)
    if keep is not None:
        x, y = x[keep(x, y)], y[keep(x, y)]
    jet = surface.jet(x, y)
    normals = unit_normal(jet, 1)
    error = (deviation or form_error(surface).at)(x, y)
    height = error + noise * np.random.default_rng(3).standard_normal(len(x))
    return np.column_stack([x, y, jet.z]) + height[:, None] * normals, normals


def looked_at(points, nominal, pose=HOME, *, contact=False):
    """Fit from near the truth, as align would end, and ask the doctor; the points come in `pose`."""
    centre = points.mean(axis=0)
    centred = points - centre
    length = float(np.sqrt(np.mean(np.sum(centred**2, axis=1))))
    settings = FitSettings(nominal.surface.bounds.diagonal_mm, length, 1e-7, 50, 0.5, 1e-8)
    measure = smooth_measure(nominal.surface, nominal.side, 0.0 if contact else nominal.tip_radius_mm)
    place = fit(measure, centred, Placement(np.eye(3), centre), settings).placement
    part_from_part = Pose(place.rotation, place.position_mm - place.rotation @ centre, "part", "part")
    found = part_from_part @ pose.inverse()
    return diagnose(pose.apply(points), nominal, found, FILE, contact=contact)


def clear(diagnosis):
    return [f.name for f in diagnosis.clear]


@pytest.fixture(scope="module")
def steep():
    return window()


@pytest.fixture(scope="module")
def weak():
    return prescription_from_toml(WEAK, "weak")


@pytest.fixture(scope="module")
def mirror():
    surface = prescription_from_toml((MIRROR / "nominal.toml").read_text(), "mirror")
    return surface, np.loadtxt(MIRROR / "points.csv", delimiter=",", skiprows=2)


MISTAKES = {
    "contact-points": (0.0, R, 1, False),
    "diameter": (R, 2 * R, 1, False),
    "wrong-side": (R, R, -1, False),
    "wrong-side-diameter": (R, 2 * R, -1, False),
    "tip-centres": (R, R, 1, True),
    "compensated-twice": (-R, R, 1, True),
    "compensated-outwards": (2 * R, R, 1, True),
}
"""Where the points truly lie; radius, side and kind as stated."""


@pytest.mark.parametrize("pose", [HOME, machine_from_part()], ids=["own frame", "elsewhere"])
@pytest.mark.parametrize("name", MISTAKES)
def test_on_a_steep_part_the_shape_tells_every_mistake(name, pose, steep):
    height, radius, side, contact = MISTAKES[name]
    contacts, normals = part(steep)

    seen = looked_at(contacts + height * normals, bare(steep, radius, side), pose, contact=contact)

    assert clear(seen) == [name]
    assert abs(seen.free_offset_mm - height * side) < 2 * seen.free_offset_u_mm


@pytest.mark.parametrize("name", MISTAKES)
def test_on_a_weak_part_only_its_own_frame_tells(name, weak):
    height, radius, side, contact = MISTAKES[name]
    contacts, normals = part(weak)
    points, nominal = contacts + height * normals, bare(weak, radius, side)

    home = looked_at(points, nominal, contact=contact)
    away = looked_at(points, nominal, machine_from_part(), contact=contact)

    assert clear(home) == [name]
    assert home.start_offset_mm == pytest.approx(height * side, abs=0.02 * R)
    assert [f.evidence for f in away.findings] == [Evidence.UNTOLD]
    assert not np.isfinite(away.free_offset_u_mm)


@pytest.mark.parametrize(
    ("name", "radius", "side", "contacts"),
    [
        ("wrong-side", 19.05, -1, False),
        ("diameter", 38.1, 1, False),
        ("contact-points", 19.05, 1, True),
    ],
)
def test_the_real_mirror_in_its_own_frame(name, radius, side, contacts, mirror):
    surface, tips = mirror
    if contacts:
        jet = surface.jet(tips[:, 0], tips[:, 1])
        tips = tips - 19.05 * unit_normal(jet, 1)

    seen = looked_at(tips, bare(surface, radius, side))

    assert clear(seen) == [name]
    assert "RMS does not choose" in seen.clear[0].words


def test_the_real_mirror_itself_is_no_mistake_although_the_other_side_fits_better(mirror):
    surface, tips = mirror

    home = looked_at(tips, bare(surface, 19.05))
    away = looked_at(tips, bare(surface, 19.05), Pose(np.eye(3), np.array([0, 0, 500.0]), "machine", "part"))

    assert home.findings == ()
    assert home.other_side_rms_mm < home.rms_mm
    assert [f.name for f in away.findings] == ["untold"]


@pytest.mark.parametrize("pose", [HOME, machine_from_part()], ids=["own frame", "elsewhere"])
@pytest.mark.parametrize("contact", [False, True])
def test_good_data_never_give_a_clear_finding(pose, contact, steep, weak):
    for surface in (steep, weak):
        for noise, keep in (
            (3e-4, None),
            (3e-3, None),
            (3e-4, lambda x, y: x > 0),
            (3e-4, lambda x, y: y < 0),
        ):
            contacts, normals = part(surface, noise=noise, keep=keep)

            seen = looked_at(
                contacts + (0.0 if contact else R) * normals, bare(surface), pose, contact=contact
            )

            assert clear(seen) == []
    for surface in (cf.Plane(), cf.Sphere(radius_mm=-50.0), cf.Paraboloid(), cf.Cylinder()):
        contacts, normals = part(surface, lambda x, y: 0.003 * np.sin(x / 4.0))

        seen = looked_at(contacts + (0.0 if contact else R) * normals, bare(surface), pose, contact=contact)

        assert clear(seen) == []


@pytest.mark.parametrize("pv", [0.027, -0.027])
def test_power_is_a_suspicion_and_no_mistake(pv, steep):
    contacts, normals = part(steep, lambda x, y: pv * ((x / 51) ** 2 + (y / 31) ** 2) / 2)

    seen = looked_at(contacts + R * normals, bare(steep))

    assert clear(seen) == []
    assert all(f.evidence is Evidence.SUSPECT for f in seen.findings)
    assert seen.power_correlation > 0.9


@pytest.mark.parametrize("by", [1e-3, 1e3])
def test_the_verdict_does_not_depend_on_the_scale(by):
    surface = cf.Torus(half_mm=20.0 * by, major_mm=80.0 * by, minor_mm=25.0 * by)
    contacts, normals = part(surface, lambda x, _y: 1e-3 * by * np.sin(x / (4.0 * by)), noise=3e-4 * by)
    nominal = bare(surface, R * by)

    assert clear(looked_at(contacts + R * by * normals, nominal)) == []
    assert clear(looked_at(contacts, nominal)) == ["contact-points"]


def test_compensation_along_z_is_a_shift_and_named_so(steep):
    contacts, normals = part(steep)
    points = contacts + R * normals - [0.0, 0.0, R]

    said_contacts = looked_at(points, bare(steep), contact=True)
    said_centres = looked_at(points, bare(steep))

    assert clear(said_contacts) == ["tip-centres"]
    assert "along one axis" in said_contacts.clear[0].words
    assert clear(said_centres) == []


def test_a_worn_ball_is_told_with_its_likeness_to_power(steep):
    contacts, normals = part(steep, lambda x, _y: 0.0 * x)

    seen = looked_at(contacts + 0.97 * R * normals, bare(steep))

    assert [f.name for f in seen.findings] == ["worn-ball"]
    assert seen.findings[0].evidence is Evidence.SUSPECT
    assert "correlate at 0.9" in seen.findings[0].words


def test_the_same_points_give_the_same_answer(steep):
    contacts, _ = part(steep)

    assert looked_at(contacts, bare(steep)) == looked_at(contacts, bare(steep))


def test_the_table_has_no_two_mistakes_at_one_place():
    for contact in (False, True):
        places = [m.offset_mm for m in mistakes_of(R, contact=contact)]

        assert len(set(places)) == len(places)
        assert (0.0 if contact else R) not in places


@pytest.mark.parametrize(
    ("change", "name", "words"),
    [
        (lambda p: p / 25.4, "units", "points are in inch"),
        (lambda p: p * 25.4, "units", "nominal is in inch"),
        (lambda p: p / 10.0, "units", "points are in cm"),
        (lambda p: p / 1000.0, "units", "points are in m,"),
        (lambda p: p * 1000.0, "units", "points are in um"),
        (lambda p: p * [1, 1, -1], "flipped-axis", "z of the points is flipped"),
        (lambda p: p * [1, -1, 1], "flipped-axis", "y of the points is flipped"),
        (lambda p: p[:, [1, 0, 2]], "swapped-axes", "x and y of the points are swapped"),
        (lambda p: p[:, [2, 1, 0]], "swapped-axes", "x and z of the points are swapped"),
        (lambda p: machine_from_part().apply(p * [1, 1, -1]), "mirrored", "mirrored"),
        (lambda p: p * [1, -1, -1], "turned", "180 degrees"),
    ],
)
def test_a_gross_failure_is_explained(change, name, words, steep):
    contacts, normals = part(steep)

    found = explain_failure(change(contacts + R * normals), bare(steep))

    assert found[0].name == name
    assert words in found[0].words


def test_a_mirrored_fit_that_converged_is_noticed(steep):
    contacts, normals = part(steep)

    seen = looked_at((contacts + R * normals) * [1, -1, 1], bare(steep))

    assert "flipped-axis" in clear(seen)


def test_points_of_something_else_are_not_explained(steep):
    cloud = np.random.default_rng(7).uniform(-30, 30, (500, 3))

    assert explain_failure(cloud, bare(steep)) == ()


def test_a_handful_of_points_is_not_judged(steep):
    contacts, normals = part(steep)

    assert looked_at((contacts + R * normals)[::40], bare(steep)).findings == ()
