"""What the best fit hid: signs and directions from points that were moved, uncertainties from many fits."""

import numpy as np
import pytest

from cmm_align.errors import InputError
from cmm_align.io.hdf5_library import h5py
from cmm_align.io.records import read_record, write_record
from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.model.removed_motion import MotionLimits, RemovedMotion, words
from cmm_align.numerics.observability import Spectrum
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.stages.align import align
from cmm_align.stages.removed_motion import removed_motion
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.virtual.cmm import scan_lines, tip_centres
from cmm_align.virtual.window import TIP_RADIUS_MM, window

RADIUS_MM = 20.0
ARCMIN = np.pi / 180.0 / 60.0
UPRIGHT = Pose.identity("surface", "part")
ON_ITS_SIDE = Pose(rotation_from_vector(np.array([0.4, -1.1, 0.7])), np.zeros(3), "surface", "part")
BY_DATUM = Pose.identity("part", "machine")
LAID = Pose(
    rotation_from_vector(np.array([0.5, 2.0, -1.0])), np.array([300.0, -20.0, 7.0]), "part", "machine"
)
ALL_TOLD = Spectrum(np.ones(6), np.eye(6), np.zeros(6, dtype=bool))
LENGTH_MM = 12.0


def disc(frame=UPRIGHT, side=1, centre=(0.0, 0.0)):
    """A flat disc: its height is that of the frame."""
    text = f'schema = "cmm-align/prescription/1"\n[aperture]\nshape = "circle"\nradius = {RADIUS_MM}\n'
    text += f'centre = [{centre[0]}, {centre[1]}]\n[[term]]\nkind = "xy_polynomial"\n'
    return Nominal(
        prescription_from_toml(text + 'coefficients = { "1,0" = 0.0 }\n', "disc"), side, 1.0, frame, ""
    )


def motion(nominal, turn_rad, shift_mm):
    """Return the motion of a surface in frame `part`: turned about the aperture's centre, then shifted."""
    back = nominal.surface_from_part.inverse()
    b = nominal.surface.bounds
    centre = back.apply(np.array([0.5 * (b.x_min + b.x_max), 0.5 * (b.y_min + b.y_max), 0.0]))
    turn = rotation_from_vector(back.rotate(np.asarray(turn_rad, dtype=float)))
    return Pose(turn, centre - turn @ centre + back.rotate(np.asarray(shift_mm, dtype=float)), "part", "part")


def hid(nominal, moved, start=BY_DATUM, **more):
    """Return what a perfect fit hid of a surface that was moved in the datum frame."""
    given = {"spectral": ALL_TOLD, "centroid_mm": np.zeros(3), "length_mm": LENGTH_MM, **more}
    return removed_motion(
        moved.inverse() @ start,
        start,
        nominal,
        given.pop("covariance", np.zeros((6, 6))),
        given.pop("limits", MotionLimits()),
        **given,
    )


# Signs, through the whole fit.


@pytest.mark.parametrize("shift", [[0.0, 0.0, 0.010], [0.030, 0.0, 0.0], [0.0, -0.020, -0.005]])
def test_a_surface_that_lies_higher_in_the_datum_frame_is_thicker(shift):
    surface = window()
    x, y = scan_lines(surface.bounds, lines=15, per_line=21)
    as_designed = Pose.identity("machine", "part")
    points = tip_centres(surface, lambda u, v: 0.0 * u, x, y, TIP_RADIUS_MM, noise_mm=0.0, pose=as_designed)
    nominal = Nominal(surface, 1, TIP_RADIUS_MM, UPRIGHT, "window")

    found = align(PointSet.of(points + shift, kind=PointKind.TIP_CENTRE), nominal)
    removed = removed_motion(
        found.part_from_machine,
        BY_DATUM,
        nominal,
        found.covariance,
        spectral=ALL_TOLD,
        centroid_mm=points.mean(axis=0),
        length_mm=LENGTH_MM,
    )

    assert removed.thickness.change_um == pytest.approx(1e3 * shift[2], abs=1e-6)
    assert removed.decentre.shift_um == pytest.approx(1e3 * np.hypot(*shift[:2]), abs=1e-6)
    if any(shift[:2]):
        np.testing.assert_allclose(
            removed.decentre.towards, np.array([*shift[:2], 0.0]) / np.hypot(*shift[:2]), atol=1e-6
        )
    assert removed.wedge.angle_arcmin == pytest.approx(0.0, abs=1e-6)
    assert removed.clocking.angle_arcmin == pytest.approx(0.0, abs=1e-6)


# Closed forms.


@pytest.mark.parametrize("start", [BY_DATUM, LAID], ids=["machine frame", "initial pose"])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("frame", [UPRIGHT, ON_ITS_SIDE], ids=["upright", "on its side"])
@pytest.mark.parametrize("degrees", [0.0, 37.0, 90.0, 200.0])
def test_wedge_has_the_edge_thickness_difference_of_the_moved_surface(degrees, frame, side, start):
    nominal = disc(frame, side, centre=(5.0, -3.0))
    a = np.radians(degrees)
    moved = motion(nominal, 10.0 * ARCMIN * np.array([np.cos(a), np.sin(a), 0.0]), [0, 0, 0])
    wedge = hid(nominal, moved, start).wedge

    # Second route: the two ends of the diameter, moved; proud is towards the probe.
    back = frame.inverse()
    middle = back.apply(np.array([5.0, -3.0, 0.0]))
    ends = middle + RADIUS_MM * np.outer([1.0, -1.0], wedge.towards)
    proud = side * (moved.apply(ends) - ends) @ back.rotate(np.array([0.0, 0.0, 1.0]))
    assert wedge.angle_arcmin == pytest.approx(10.0, rel=1e-9)
    assert proud[0] > 0.0 > proud[1]
    # sin against tan of 10 arcmin differ by 4e-6; 64 places on a circle span a diameter to 1e-3.
    assert wedge.etd_um == pytest.approx(1e3 * (proud[0] - proud[1]), rel=2e-3)
    assert wedge.etd_um == pytest.approx(1e3 * 2.0 * RADIUS_MM * np.tan(10.0 * ARCMIN), rel=2e-3)


def test_the_wedge_of_a_window_reaches_over_its_side():
    nominal = Nominal(window(), 1, TIP_RADIUS_MM, UPRIGHT, "")
    about_y = motion(nominal, [0.0, -2.0 * ARCMIN, 0.0], [0, 0, 0])
    wedge = hid(nominal, about_y).wedge

    # A turn about -y lifts what lies at +x; the window is 102 mm wide.
    assert wedge.towards == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
    assert wedge.etd_um == pytest.approx(1e3 * 102.0 * np.tan(2.0 * ARCMIN), rel=1e-9)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("frame", [UPRIGHT, ON_ITS_SIDE], ids=["upright", "on its side"])
def test_shift_and_clocking_come_back_as_they_were_put_in(frame, side):
    nominal = disc(frame, side, centre=(5.0, -3.0))
    removed = hid(nominal, motion(nominal, [0.0, 0.0, -4.0 * ARCMIN], [0.03, 0.04, 0.007]), LAID)

    assert removed.thickness.change_um == pytest.approx(side * 7.0, abs=1e-6)
    assert removed.decentre.shift_um == pytest.approx(50.0, abs=1e-6)
    np.testing.assert_allclose(
        removed.decentre.towards, frame.inverse().rotate(np.array([0.6, 0.8, 0.0])), atol=1e-8
    )
    assert removed.clocking.angle_arcmin == pytest.approx(-4.0, rel=1e-9)
    # An aperture takes in what lies outside by 1e-9 of its size.
    assert removed.clocking.edge_um == pytest.approx(-1e3 * RADIUS_MM * 4.0 * ARCMIN, rel=1e-8)
    assert removed.wedge.angle_arcmin == pytest.approx(0.0, abs=1e-9)
    assert removed.verdict == "none"


def test_a_part_that_was_not_moved_has_no_motion_to_remove():
    removed = hid(disc(), motion(disc(), [0, 0, 0], [0, 0, 0]))

    assert removed.wedge.towards == removed.decentre.towards == (0.0, 0.0, 0.0)
    assert removed.wedge.etd_um == removed.thickness.change_um == 0.0
    assert len(words(removed)) == 4


# Uncertainty, by many fits.


@pytest.mark.parametrize("frame", [UPRIGHT, ON_ITS_SIDE], ids=["upright", "on its side"])
def test_uncertainties_are_the_scatter_of_many_fits(frame, rng):
    nominal = disc(frame, centre=(5.0, -3.0))
    root = rng.normal(size=(6, 6)) * np.array([1e-5] * 3 + [1e-3] * 3)[:, None]
    centroid = np.array([3.0, 8.0, -2.0])
    # Turned as far as is read at all, so that the change of frames on the way counts.
    moved = motion(nominal, [0.03, -0.05, 0.04], [0.5, -0.2, 0.1])
    removed = hid(nominal, moved, LAID, covariance=root @ root.T, centroid_mm=centroid)
    fit = moved.inverse() @ LAID

    back = frame.inverse()
    middle = back.apply(np.array([5.0, -3.0, 0.0]))
    readings = []
    for error in rng.normal(size=(2000, 6)) @ root.T:
        turn = rotation_from_vector(error[:3])
        wrong = Pose(turn, centroid - turn @ centroid + error[3:], "part", "part") @ fit
        hidden = LAID @ wrong.inverse()
        readings.append(
            [frame.rotate(hidden.rotation_vector_rad()), frame.rotate(hidden.apply(middle) - middle)]
        )
    turns, shifts = np.array(readings).transpose(1, 0, 2)

    def worst(values):
        return np.sqrt(np.linalg.eigvalsh(np.cov(values.T))[-1])

    # 2000 draws tell a sigma to 1.6 %; eight are compared, so four of those are allowed.
    assert removed.wedge.u_arcmin == pytest.approx(worst(turns[:, :2]) / ARCMIN, rel=0.064)
    assert removed.clocking.u_arcmin == pytest.approx(turns[:, 2].std() / ARCMIN, rel=0.064)
    assert removed.decentre.u_um == pytest.approx(1e3 * worst(shifts[:, :2]), rel=0.064)
    assert removed.thickness.u_um == pytest.approx(1e3 * shifts[:, 2].std(), rel=0.064)
    assert removed.wedge.u_etd_um == pytest.approx(removed.wedge.u_arcmin * ARCMIN * 4e4, rel=2e-3)
    assert removed.clocking.u_edge_um == pytest.approx(removed.clocking.u_arcmin * ARCMIN * 2e4, rel=1e-8)


@pytest.mark.parametrize("frame", [UPRIGHT, ON_ITS_SIDE], ids=["upright", "on its side"])
def test_an_error_of_the_fit_changes_the_readings_by_what_is_stated(frame, rng):
    nominal = disc(frame, centre=(5.0, -3.0))
    centroid = np.array([3.0, 8.0, -2.0])
    moved = motion(nominal, [0.03, -0.05, 0.04], [0.5, -0.2, 0.1])
    middle = frame.inverse().apply(np.array([5.0, -3.0, 0.0]))
    error = 1e-6 * rng.normal(size=6)

    def reading(sign):
        turn = rotation_from_vector(sign * error[:3])
        wrong = Pose(turn, centroid - turn @ centroid + sign * error[3:], "part", "part")
        hidden = moved @ wrong.inverse()
        return np.concatenate(
            [frame.rotate(hidden.rotation_vector_rad()), frame.rotate(hidden.apply(middle) - middle)]
        )

    change = 0.5 * (reading(1.0) - reading(-1.0))
    removed = hid(nominal, moved, covariance=np.outer(error, error), centroid_mm=centroid)
    # Central differences with steps of 1e-6: 1e-12 of curvature, and rounding of 1e-15 over 1e-6.
    assert removed.wedge.u_arcmin == pytest.approx(np.hypot(*change[:2]) / ARCMIN, rel=1e-6)
    assert removed.clocking.u_arcmin == pytest.approx(abs(change[2]) / ARCMIN, rel=1e-6)
    assert removed.decentre.u_um == pytest.approx(1e3 * np.hypot(*change[3:5]), rel=1e-6)
    assert removed.thickness.u_um == pytest.approx(1e3 * abs(change[5]), rel=1e-6)


# Verdicts.


@pytest.mark.parametrize(
    ("change_um", "u_um", "verdict"),
    [
        (7.0, 1.8, "pass"),
        (7.0, 1.9, "undecided"),
        (-7.0, 1.8, "pass"),
        (13.0, 1.8, "fail"),
        (-13.0, 1.9, "undecided"),
        (10.0, 0.0, "pass"),
    ],
)
def test_a_guard_band_lies_on_both_sides_of_a_limit(change_um, u_um, verdict):
    covariance = np.diag([0, 0, 0, 0, 0, (1e-3 * u_um) ** 2])
    removed = hid(
        disc(),
        Pose(np.eye(3), np.array([0, 0, 1e-3 * change_um]), "part", "part"),
        covariance=covariance,
        limits=MotionLimits(thickness_um=10.0 + 1e-9),
    )

    assert removed.thickness.verdict == verdict
    assert removed.verdict == verdict
    assert removed.wedge.verdict == "none"
    assert verdict in words(removed)[3]


@pytest.mark.parametrize(
    ("shift_um", "limit_um", "verdict"), [((3.0, 0.0), 10.0, "undecided"), ((50.0, 0.0), 10.0, "fail")]
)
def test_a_shift_passes_only_if_it_is_known_in_every_direction(shift_um, limit_um, verdict):
    covariance = np.diag([0, 0, 0, 0.1e-3, 30e-3, 0]) ** 2  # well known along x, badly along y
    shift = np.array([*shift_um, 0.0]) * 1e-3
    removed = hid(
        disc(),
        Pose(np.eye(3), shift, "part", "part"),
        covariance=covariance,
        limits=MotionLimits(decentre_um=limit_um),
    )

    assert removed.decentre.verdict == verdict
    assert removed.decentre.u_um == pytest.approx(30.0, rel=1e-9)


@pytest.mark.parametrize("how", ["free", "locked"])
def test_what_the_fit_did_not_tell_is_undecided_and_never_passes(how):
    axis = np.array([0.0, 0.0, LENGTH_MM, 0.0, -30.0, 0.0])  # the turn about z through (30, 0)
    axis /= np.linalg.norm(axis)
    told = np.linalg.svd(axis[None])[2][1:].T
    spectral = Spectrum(np.ones(5), told, np.zeros(5, dtype=bool))
    if how == "free":
        motions = np.column_stack([axis, told])
        spectral = Spectrum(np.array([0.0, 1, 1, 1, 1, 1]), motions, np.arange(6) == 0)
    removed = hid(
        disc(),
        motion(disc(), [0, 0, 0], [0, 0, 0]),
        spectral=spectral,
        limits=MotionLimits(1.0, 1.0, 1.0, 1.0),
    )

    # A turn about an axis beside the aperture moves its centre along y too; tilt and height are known.
    verdicts = [
        part.verdict for part in (removed.wedge, removed.decentre, removed.clocking, removed.thickness)
    ]
    assert verdicts == ["pass", "undecided", "undecided", "pass"]
    assert removed.verdict == "undecided"
    assert removed.clocking.u_arcmin == removed.decentre.u_um == np.inf
    assert "u inf" in words(removed)[2]


@pytest.mark.parametrize(
    ("turn", "shift", "applies"),
    [
        (np.radians(4.9), 0.0, True),
        (np.radians(5.1), 0.0, False),
        (0.0, 5.6, True),  # the disc's box has a diagonal of 56.6 mm
        (0.0, 5.7, False),
    ],
)
def test_a_start_that_is_no_datum_frame_gives_a_reason_instead_of_numbers(turn, shift, applies):
    moved = motion(disc(), [0.0, turn, 0.0], [shift, 0.0, 0.0])
    removed = hid(disc(), moved, limits=MotionLimits(wedge_arcmin=1e4))

    assert removed.applies is applies
    if not applies:
        assert removed.wedge is None
        assert removed.verdict == "undecided"
        assert "--initial" in removed.reason
        assert words(removed) == (removed.reason,)
        assert hid(disc(), moved).verdict == "none"


def test_frames_that_do_not_belong_together_are_refused():
    with pytest.raises(InputError, match="compose"):
        hid(disc(), motion(disc(), [0, 0, 0], [0, 0, 0]), Pose.identity("surface", "machine"))


@pytest.mark.parametrize("turn", [0.001, 0.2])
def test_it_survives_a_file(turn):
    removed = hid(disc(), motion(disc(), [turn, 0, 0], [0.1, 0.2, 0.3]), limits=MotionLimits(1.0, 2.0))

    with h5py.File("memory", "w", driver="core", backing_store=False) as file:
        write_record(file.create_group("removed"), removed)
        again = read_record(file, "/removed", RemovedMotion)

    assert again == removed
    assert words(again) == words(removed)
