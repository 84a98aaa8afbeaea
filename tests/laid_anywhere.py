"""Parts laid on the table in any orientation and place, and whether a search has found them again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.linearisation import Placement
from cmm_align.numerics.pose_search import search
from cmm_align.pose import Pose
from cmm_align.surfaces.distance import facet_measure, light_net
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.virtual.cmm import tip_centres
from cmm_align.virtual.form_error import form_error

RADIUS_MM = 1.5
NEAR_SYMMETRIC = '"2,0" = -6e-3, "0,2" = -2e-3, "3,0" = 2e-5, "1,2" = 3e-5'
NEARER_SYMMETRIC = '"2,0" = -6e-3, "0,2" = -2e-3, "3,0" = 2e-8, "1,2" = 3e-8'
SQUARE = '"2,0" = -5e-3, "0,2" = -4.6e-3, "3,0" = 2e-5, "1,2" = -1e-5'
LARGEST_MM = 1000.0


def polynomial(coefficients, shape='shape = "rectangle"\nwidth = 100.0\nheight = 60.0'):
    """Return a window from the coefficients of its polynomial."""
    return prescription_from_toml(
        f'schema = "cmm-align/prescription/1"\n[aperture]\n{shape}\n[[term]]\nkind = "xy_polynomial"\n'
        f"coefficients = {{ {coefficients} }}\n",
        "window.toml",
    )


def places(surface, n=5000, seed=1, box=(-1.0, 1.0, -1.0, 1.0)):
    """Return n places in a box, in half widths of the surface's bounds, where the surface is."""
    b, rng = surface.bounds, np.random.default_rng(seed)
    u, v = rng.uniform(box[0], box[1], 3 * n), rng.uniform(box[2], box[3], 3 * n)
    x = 0.5 * (b.x_min + b.x_max + 0.99 * u * (b.x_max - b.x_min))
    y = 0.5 * (b.y_min + b.y_max + 0.99 * v * (b.y_max - b.y_min))
    there = np.flatnonzero(surface.contains(x, y))[:n]
    return x[there], y[there]


def part_points(surface, pv_mm=0.027, strays=0.0, **where):
    """Return tip centres in the part's own frame, with form error, 0.3 um of noise and some strays."""
    x, y = places(surface, **where)
    error = form_error(surface, pv_mm=pv_mm).at
    points = tip_centres(surface, error, x, y, RADIUS_MM, pose=Pose.identity("machine", "part"))
    rng = np.random.default_rng(7)
    hit = rng.permutation(len(points))[: round(strays * len(points))]
    points[hit, 2] += rng.choice([-1.0, 1.0], len(hit)) * rng.uniform(0.1, 10.0, len(hit))
    return points


@dataclass(frozen=True)
class Found:
    """What a search said of a part that was laid somewhere."""

    candidates: tuple
    true_rotation: np.ndarray
    true_position_mm: np.ndarray
    points_mm: np.ndarray
    settings: FitSettings

    def off(self, k=0):
        """How far candidate k is from where the part lies: rad, and mm at the centroid."""
        at = self.candidates[k].placement
        turn = Rotation.from_matrix(at.rotation @ self.true_rotation.T).magnitude()
        return float(turn), float(np.linalg.norm(at.position_mm - self.true_position_mm))


class Table:
    """A surface whose light net is ready, onto which parts are searched."""

    def __init__(self, surface):
        self.net = light_net(surface, 1, RADIUS_MM)
        self.measure = facet_measure(self.net, 1)
        self.size = surface.bounds.diagonal_mm

    def settings(self, centred):
        length = float(np.sqrt(np.mean(np.sum(centred**2, axis=1))))
        return FitSettings(self.size, length, 1e-12, 50, np.radians(30.0), 1e-8)

    def search(self, centred, start=None):
        """Return the candidates for centred points."""
        return search(self.measure, centred, self.net.points_mm, self.settings(centred), start=start)

    def find(self, points, seed):
        """Lay the points somewhere (all of SO(3), up to a metre away) and search for them."""
        rng = np.random.default_rng(seed)
        turn = Rotation.random(random_state=seed).as_matrix()
        machine = points @ turn.T + rng.uniform(-LARGEST_MM, LARGEST_MM, 3)
        centroid = machine.mean(axis=0)
        centred = machine - centroid
        found = self.search(centred, Placement(np.eye(3), centroid))
        return Found(found, turn.T, points.mean(axis=0), centred, self.settings(centred))
