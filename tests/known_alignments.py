"""Data whose alignment is known beforehand: caps with a wrong ball, symmetric parts, strays, far starts."""

from __future__ import annotations

from dataclasses import dataclass

import closed_forms as cf
import numpy as np
from scipy.spatial.transform import Rotation

from cmm_align.config import AlignConfig
from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.pose import Pose
from cmm_align.stages.align import align
from cmm_align.stages.offset import surface_digest
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.surfaces.protocol import Bounds, Jet

RADIUS_MM = 1.5
HOME = Pose.identity("machine", "part")
CAP_DEG = (30.0, 45.0, 60.0, 70.0)
CAP_MM = 50.0
_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


def nominal_of(surface, radius_mm=RADIUS_MM):
    """A nominal straight from a surface, probe on its +z side, without the equidistant net."""
    flat = Pose.identity("surface", "part")
    return Nominal(surface, 1, radius_mm, flat, surface_digest(surface, 1, flat))


def tips(surface, x, y, deviation_mm=0.0, radius_mm=RADIUS_MM):
    """Tip centres over places: the foot points are known, and so are the deviations."""
    jet = surface.jet(x, y)
    height = radius_mm + np.broadcast_to(deviation_mm, x.shape)
    return np.stack([x, y, jet.z], axis=1) + height[:, None] * unit_normal(jet, 1)


def measured(points, pose=HOME):
    return PointSet.of(pose.apply(points), kind=PointKind.TIP_CENTRE)


def motion_between(found, other, points):
    """The motion from where `other` lays points to where `found` does: rad, then mm at the centroid."""
    centre = other.apply(points).mean(axis=0)
    between = found @ other.inverse()
    return np.r_[between.rotation_vector_rad(), between.apply(centre[None])[0] - centre]


# A ball of the wrong radius on a spherical cap


@dataclass(frozen=True)
class CapError:
    """What a radius error dr does to a fit on a cap, in units of dr."""

    shift: float
    """Lift of the part along z."""
    pv: float


def cap_theory(half_angle_deg):
    """The closed form: least squares of ``dr - t cos(theta)`` over the area of the cap."""
    c = np.cos(np.radians(half_angle_deg))
    m1, m2 = (1.0 + c) / 2.0, (1.0 + c + c * c) / 3.0
    return CapError(m1 / m2, m1 / m2 * (1.0 - c))


def cap_measured(half_angle_deg, dr_mm=1e-3, n=4000):
    """The same by aligning tip centres, spread evenly by area, of a ball that is `dr_mm` too large."""
    half = np.radians(half_angle_deg)
    rim = 1.01 * CAP_MM * np.sin(half)  # the fit moves the outermost feet
    surface = prescription_from_toml(
        f'schema = "cmm-align/prescription/1"\n[aperture]\nshape = "circle"\nradius = {rim}\n'
        f'[[term]]\nkind = "conic"\nradius = {-CAP_MM}\nconic = 0.0\n',
        "cap.toml",
    )
    height = 1.0 - (1.0 - np.cos(half)) * np.arange(n) / (n - 1.0)  # equal areas have equal heights
    out = CAP_MM * np.sqrt(1.0 - height**2)
    turn = _GOLDEN * np.arange(n)
    points = tips(surface, out * np.cos(turn), out * np.sin(turn), dr_mm)
    found = align(measured(points), nominal_of(surface))
    top = np.array([[0.0, 0.0, RADIUS_MM]])
    lowered = (top - found.part_from_machine.apply(top))[0, 2]
    return CapError(lowered / dr_mm, float(np.ptp(found.deviation_mm)) / dr_mm)


# Parts whose free motions are known


@dataclass(frozen=True)
class Extrusion(cf.ClosedForm):
    """z = x^2 / 2a + b x^3: slides along y."""

    a_mm: float = 60.0
    b_per_mm2: float = 1e-4

    def jet(self, x, y):
        zero = np.zeros(np.shape(x))
        z = x * x / (2 * self.a_mm) + self.b_per_mm2 * x**3
        slope = x / self.a_mm + 3 * self.b_per_mm2 * x * x
        return Jet(z, slope, zero, 1 / self.a_mm + 6 * self.b_per_mm2 * x, zero, zero)


@dataclass(frozen=True)
class WeakFreeform(cf.ClosedForm):
    """A paraboloid of revolution with three lobes that hold its turn: 8 um at 20 mm from the axis."""

    a_mm: float = 60.0
    lobes_per_mm2: float = 1e-6

    def jet(self, x, y):
        base, k = cf.Paraboloid(a_mm=self.a_mm, b_mm=self.a_mm).jet(x, y), self.lobes_per_mm2
        return Jet(
            base.z + k * (x**3 - 3 * x * y * y),
            base.zx + 3 * k * (x * x - y * y),
            base.zy - 6 * k * x * y,
            base.zxx + 6 * k * x,
            base.zxy - 6 * k * y,
            base.zyy - 6 * k * x,
        )


@dataclass(frozen=True)
class Scaled:
    """A surface in another size."""

    surface: cf.ClosedForm
    by: float
    kind: str = "prescription"

    @property
    def bounds(self):
        return Bounds(*(self.by * v for v in self.surface.bounds))

    def contains(self, x_mm, y_mm):
        return self.surface.contains(x_mm / self.by, y_mm / self.by)

    def jet(self, x, y):
        j = self.surface.jet(x / self.by, y / self.by)
        return Jet(self.by * j.z, j.zx, j.zy, j.zxx / self.by, j.zxy / self.by, j.zyy / self.by)


SYMMETRIES = {
    "plane": (cf.Plane(a=0.0, b=0.0), ("translation along x", "translation along y", "rotation along z")),
    "dome": (
        cf.Sphere(radius_mm=-50.0),
        ("rotation along x", "rotation along y", "rotation along z"),
    ),
    "bowl": (cf.Sphere(radius_mm=50.0), ("rotation along x", "rotation along y", "rotation along z")),
    "cylinder": (cf.Cylinder(), ("translation along y", "rotation along y")),
    "revolution": (cf.Paraboloid(), ("rotation along z",)),
    "torus": (cf.Torus(), ("rotation along y",)),
    "extrusion": (Extrusion(), ("translation along y",)),
    "weakly freeform": (WeakFreeform(), ()),
    "freeform": (cf.Paraboloid(b_mm=-90.0), ()),
}
"""Parts and their free motions."""
SCALES = (1e-3, 1.0, 1e3)


def aligned_symmetry(name, by, search="auto", n=1500):
    """Align a part of known symmetry in another size, laid a little off; return the alignment."""
    surface = Scaled(SYMMETRIES[name][0], by)
    x, y = 19.0 * by * np.random.default_rng(1).uniform(-1.0, 1.0, (2, n))
    turn, shift = Rotation.from_rotvec([0.009, -0.005, 0.03]).as_matrix(), by * np.array([0.5, 0.3, -0.4])
    radius = RADIUS_MM * by
    data = measured(tips(surface, x, y, radius_mm=radius), Pose(turn, shift, "machine", "part"))
    return align(data, nominal_of(surface, radius), AlignConfig(search=search))


def named(words):
    """Free motions without the place of their axis."""
    return tuple(sorted(f"{w.split()[0]} along {w.rsplit('along ', 1)[1]}" for w in words))


# Strays


def with_strays(surface, *, share=0.3, low_mm=0.1, high_mm=5.0, noise_mm=3e-4, n=6000, seed=11):
    """Clean and spoilt deviations at random places, and who is spoilt: errors of both signs."""
    rng, b = np.random.default_rng(seed), surface.bounds
    x, y = rng.uniform(0.98 * b.x_min, 0.98 * b.x_max, n), rng.uniform(0.98 * b.y_min, 0.98 * b.y_max, n)
    clean = rng.normal(0.0, noise_mm, n)
    stray = rng.permutation(n) < share * n
    error = rng.choice([-1.0, 1.0], n) * np.exp(rng.uniform(np.log(low_mm), np.log(high_mm), n))
    return x, y, clean, np.where(stray, clean + error, clean), stray


# Far starts


def far_start(seed, reach_mm, reach_deg):
    """A part laid at random within a reach along and about every axis."""
    rng = np.random.default_rng(seed)
    shift = rng.uniform(-1.0, 1.0, 3) * reach_mm
    angles = rng.uniform(-1.0, 1.0, 3) * reach_deg
    return Pose(Rotation.from_euler("xyz", angles, degrees=True).as_matrix(), shift, "machine", "part")


def without_search(points, nominal, pose):
    """Align a part from where it lies."""
    return align(measured(points, pose), nominal, AlignConfig(search="never"))
