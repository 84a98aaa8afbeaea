"""Made-up compensations for the gate: a random steep part, its map, its correction, what a file may say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from truth_maps import Quadric, aligned, random_places

from cmm_align.model import Correction, DeviationMap
from cmm_align.numerics.grid_field import interpolated
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.stages.compensate import compensate
from cmm_align.stages.error_map import error_map
from cmm_align.stages.gate import Gate, ReadBack
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array

DECIMALS = 6
ON_ITS_SIDE = Pose(
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    np.array([1.0, 2.0, 3.0]),
    "surface",
    "part",
)
GOOD = {"rectangle": {}, "ellipse": {"ellipse": True}, "-z": {"side": -1}}
NOISE_MM = 0.0003


@dataclass(frozen=True)
class Example:
    """A measured part and its correction; arrays row by row over the nodes inside, frame `part`."""

    surface: Quadric
    form: Callable[[Array, Array], Array]
    map: DeviationMap
    correction: Correction
    seed: int

    def on_nodes(self, total_mm: Array) -> Array:
        """Points of the nominal with a total correction along the normal, shape (n, 3)."""
        c, inside = self.correction, np.isfinite(self.correction.total_correction_mm)
        x, y = np.meshgrid(c.x_mm, c.y_mm)
        jet = self.surface.jet(x, y)
        z = jet.z + c.nominal.side * np.sqrt(1.0 + jet.zx**2 + jet.zy**2) * total_mm
        surface = np.column_stack([x[inside], y[inside], z[inside]])
        return c.nominal.surface_from_part.inverse().apply(surface)

    @property
    def normals(self) -> Array:
        """Of the commanded surface."""
        c = self.correction
        return c.nominal.surface_from_part.inverse().rotate(
            c.commanded_normal[np.isfinite(c.total_correction_mm)]
        )

    @property
    def nominal_normals(self) -> Array:
        """Of the nominal at the same places."""
        c = self.correction
        n = unit_normal(self.surface.jet(*np.meshgrid(c.x_mm, c.y_mm)), c.nominal.side)
        return c.nominal.surface_from_part.inverse().rotate(n[np.isfinite(c.total_correction_mm)])

    def told_normals(self, gate: Gate) -> Array:
        """Of the commanded surface by a spline, at the nodes."""
        c = self.correction
        x, y = np.meshgrid(c.x_mm, c.y_mm)
        inside = np.isfinite(c.total_correction_mm)
        return c.nominal.surface_from_part.inverse().rotate(gate.told.normals_at(x[inside], y[inside]))

    def reground(self) -> DeviationMap:
        """The map after an ideal machine has ground the correction."""
        c = self.correction
        full = np.where(np.isfinite(c.correction_mm), c.correction_mm, 0.0)
        return _mapped(
            self.surface,
            lambda x, y: self.form(x, y) + interpolated(c.x_mm, c.y_mm, full, x, y),
            self.seed + 1000,
            c.nominal.side,
            c.nominal.surface_from_part,
        )

    def between(self) -> tuple[Gate, ReadBack]:
        """A correction in closed form, and a file of points between its nodes."""
        c = self.correction
        inside = np.isfinite(c.total_correction_mm)
        field = np.where(inside, -self.form(*np.meshgrid(c.x_mm, c.y_mm)), np.nan)
        exact = replace(c, correction_mm=field, total_correction_mm=field)
        iy, ix = np.nonzero(inside[1:, 1:] & inside[1:, :-1] & inside[:-1, 1:] & inside[:-1, :-1])
        rng = np.random.default_rng(self.seed)
        x = c.x_mm[ix] + rng.uniform(0.0, 1.0, len(ix)) * (c.x_mm[1] - c.x_mm[0])
        y = c.y_mm[iy] + rng.uniform(0.0, 1.0, len(iy)) * (c.y_mm[1] - c.y_mm[0])
        jet = self.surface.jet(x, y)
        w = np.sqrt(1.0 + jet.zx**2 + jet.zy**2)
        points = np.column_stack([x, y, jet.z - c.nominal.side * w * self.form(x, y)])
        file = replace(
            read_of(self),
            points_mm=np.round(points, DECIMALS),
            reach_mm=5.0,
        )
        return Gate(self.map, exact), file


def example(
    seed: int, *, side: int = 1, turned: bool = False, flat: bool = False, ellipse: bool = False
) -> Example:
    """A random part of 40 x 30 mm with slopes over 30 degrees (or below 8), form error of some um, noise."""
    rng = np.random.default_rng(seed)
    steepest = np.tan(np.deg2rad(rng.uniform(3.0, 7.0) if flat else rng.uniform(33.0, 55.0)))
    way = rng.uniform(0.0, 2.0 * np.pi)
    tilt = rng.uniform(0.0, 0.4) * steepest
    c, d = (
        rng.choice([-1.0, 1.0], 2) * rng.uniform(0.6, 1.0, 2) * (steepest - tilt) / (2.0 * np.array([20, 15]))
    )
    surface = Quadric(20.0, 15.0, tilt * np.cos(way), tilt * np.sin(way), float(c), float(d), round=ellipse)
    waves = rng.uniform(0.5, 1.5, (4, 2)) * np.pi / 20.0
    phases, sizes = rng.uniform(0.0, 2.0 * np.pi, 4), rng.uniform(0.002, 0.006, 4)

    def form(x: Array, y: Array) -> Array:
        """Four waves longer than 26 mm."""
        return np.asarray(
            sum(a * np.cos(k[0] * x + k[1] * y + p) for a, k, p in zip(sizes, waves, phases, strict=True))
        )

    turn = ON_ITS_SIDE if turned else None
    found = _mapped(surface, form, seed, side, turn)
    return Example(surface, form, found, compensate(found), seed)


def read_of(case: Example, change: Callable[[Array, Example], Array] | None = None) -> ReadBack:
    """What is read back of a text of points, after a mistake of its writer."""
    points = case.on_nodes(case.correction.total_correction_mm)
    if change is not None:
        points = change(points, case)
    turn = case.correction.nominal.surface_from_part
    return ReadBack(
        "xyz",
        np.round(points, DECIMALS),
        None,
        Pose(turn.rotation, turn.translation_mm, "surface", "file"),
        np.sqrt(3.0) * 0.5 * 10.0**-DECIMALS,
    )


def _mapped(surface: Quadric, form, seed: int, side: int, turn: Pose | None) -> DeviationMap:
    found = aligned(
        surface,
        form,
        random_places(surface, 1500, seed),
        side=side,
        seed=seed,
        noise_mm=NOISE_MM,
        surface_from_part=turn,
    )
    rng = np.random.default_rng(seed + 77)
    posed = Pose(
        rotation_from_vector(rng.uniform(-0.4, 0.4, 3)), rng.uniform(5.0, 30.0, 3), "part", "machine"
    )
    return error_map(replace(found, part_from_machine=posed))


def _total(case: Example) -> Array:
    return case.correction.total_correction_mm


def _n_z(case: Example) -> Array:
    jet = case.surface.jet(*np.meshgrid(case.correction.x_mm, case.correction.y_mm))
    return np.asarray(1.0 / np.sqrt(1.0 + jet.zx**2 + jet.zy**2))


MISTAKES: dict[str, Callable[[Array, Example], Array]] = {
    "wrong sign": lambda _p, case: case.on_nodes(_total(case) - 2.0 * case.correction.correction_mm),
    "e_n as dz": lambda _p, case: case.on_nodes(_total(case) * _n_z(case)),
    "without this pass": lambda _p, case: case.on_nodes(_total(case) - case.correction.correction_mm),
    "x and y swapped": lambda p, _case: p[:, [1, 0, 2]],
    "y and z swapped": lambda p, _case: p[:, [0, 2, 1]],
    "x mirrored": lambda p, _case: p * [-1.0, 1.0, 1.0],
    "z turned over": lambda p, _case: p * [1.0, 1.0, -1.0],
    "frame of the CMM": lambda p, case: case.map.alignment.part_from_machine.inverse().apply(p),
    "inches": lambda p, _case: p / 25.4,
}
"""What the writer of a file does to points, or writes in place of them."""

WORDS = {
    "wrong sign": "wrong sign",
    "e_n as dz": "e_n written as dz",
    "without this pass": "correction",
    "x and y swapped": "x and y swapped",
    "y and z swapped": "y and z swapped",
    "x mirrored": "x mirrored",
    "z turned over": "z with the wrong sign",
    "frame of the CMM": "frame of the CMM",
    "inches": "inches",
}
"""What the gate says of each."""
