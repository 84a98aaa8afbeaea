"""Our fit beside the methods it replaces: ``python tests/bench/reference_methods.py [--paper]``.

20 000 tip centres of the demo window with 0.3 um of noise, without and with form error, against a nominal of
40 000 nodes (``--paper``: the grid of the paper, 1021 x 1241 nodes, 0.1 x 0.05 mm). The form error has its
rigid motion taken out, so that the true pose is the one that least squares should find. Every method starts
from the same poses; its pose is then judged by smooth deviations, never by its own residual.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from table import Row, Stopwatch, show

import cmm_align as ca
from cmm_align.config import AlignConfig
from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.stages.bidirectional import bidirectional
from cmm_align.stages.reference_methods import METHODS, reference_pose
from cmm_align.surfaces.distance import smooth_measure
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.virtual.cmm import machine_from_part
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.window import TIP_RADIUS_MM, window

SURFACE = window()
NOISE_MM = 3e-4
N = 20_000
CHECKS = 5000
ONE_DEG = np.radians(1.0) * np.ones(3) / np.sqrt(3)
STARTS = {
    "1 mm, 1 deg": Pose(rotation_from_vector(ONE_DEG), np.ones(3) / np.sqrt(3), "machine", "part"),
    "20, 10, 20 mm and deg": machine_from_part(),
}


@dataclass(frozen=True)
class Case:
    """Points in the part's own frame, with what is true of them."""

    points_mm: np.ndarray
    check_points_mm: np.ndarray
    check_deviation_mm: np.ndarray


def tips(x, y, deviation):
    """Feet, normals and tip centres over known places."""
    jet = SURFACE.jet(x, y)
    normals = unit_normal(jet, 1)
    feet = np.stack([x, y, jet.z], axis=1)
    return feet, normals, feet + (TIP_RADIUS_MM + deviation)[:, None] * normals


def case(pv_mm: float) -> Case:
    """Measured points, and points between them that no method sees."""
    rng = np.random.default_rng(11)
    x, y = rng.uniform(-50, 50, N + CHECKS), rng.uniform(-30, 30, N + CHECKS)
    deviation = form_error(SURFACE, pv_mm=pv_mm).at(x, y) if pv_mm else np.zeros(N + CHECKS)
    _, normals, centres = tips(x, y, deviation)
    rows = np.hstack([np.cross(centres, normals), normals])
    deviation = deviation - rows @ np.linalg.lstsq(rows[:N], deviation[:N], rcond=None)[0]
    noise = NOISE_MM * rng.standard_normal(N)
    return Case(
        tips(x[:N], y[:N], deviation[:N] + noise)[2],
        tips(x[N:], y[N:], deviation[N:])[2],
        deviation[N:],
    )


def judged(part_from_machine: Pose, start: Pose, data: Case) -> str:
    """Hold a pose against the truth: the part's edge, its rotation, and deviations at unseen points."""
    left = part_from_machine @ start
    b = SURFACE.bounds
    corners = np.array([[x, y, 0.0] for x in (b.x_min, b.x_max) for y in (b.y_min, b.y_max)])
    edge = np.linalg.norm(left.apply(corners) - corners, axis=1).max()
    seen = smooth_measure(SURFACE, 1, TIP_RADIUS_MM).distance(left.apply(data.check_points_mm), None)[0]
    error = seen.distance_mm - data.check_deviation_mm
    error = error[np.isfinite(error)]
    return (
        f"{1e3 * edge:11.4f} um {1e6 * np.linalg.norm(left.rotation_vector_rad()):11.3f} urad   "
        f"PV {1e3 * np.ptp(error):10.5f} RMS {1e3 * np.sqrt(np.mean(error**2)):10.5f} um"
    )


def settling(costs: tuple[float, ...]) -> int:
    """Iterations until the residual is within 1 % of its last value."""
    return int(np.argmax(np.array(costs) <= 1.02 * costs[-1]))


def compared(nominal: Nominal, pv_mm: float) -> list[Row]:
    """All methods from all starts on one set of points."""
    rows = []
    data = case(pv_mm)
    for words, start in STARTS.items():
        rows.append(Row(f"form error {1e3 * pv_mm:g} um PV, start {words}", "", ""))
        measured = PointSet.of(start.apply(data.points_mm), kind=PointKind.TIP_CENTRE)
        for method in METHODS:
            with Stopwatch() as watch:
                found = reference_pose(method, measured, nominal)
            ended = "" if found.converged else "+"
            rows.append(
                Row(
                    f"  {method}",
                    f"{found.iterations}{ended} ({settling(found.cost_history_mm2)}) it, {watch.wall:6.2f} s",
                    judged(found.part_from_machine, start, data),
                )
            )
        with Stopwatch() as watch:
            ours = ca.align(measured, nominal, AlignConfig(search="never", outliers="keep"))
        told = f"{ours.report.iterations} it, {watch.wall:6.2f} s"
        rows.append(Row("  smooth (ours)", told, judged(ours.part_from_machine, start, data)))
    return rows


def both_ways(nominal: Nominal) -> list[Row]:
    """The bidirectional check of our own result."""
    data = case(0.027)
    found = ca.align(PointSet.of(data.points_mm, kind=PointKind.TIP_CENTRE), nominal)
    with Stopwatch() as watch:
        check = bidirectional(found)
    forward, backward = 1e3 * check.forward.rms_mm, 1e3 * check.backward.rms_mm
    differ = (check.difference_rms_mm, check.facets_rms_mm, check.rest_rms_mm)
    moves = (check.reverse_rms_mm, check.expected_rms_mm, check.unexplained_rms_mm)
    return [
        Row(f"bidirectional check, {watch.wall:.2f} s", "consistent", str(check.consistent)),
        Row("  forward, backward: RMS", "-", f"{forward:.3f}, {backward:.3f} um"),
        Row("  difference: seen, facets explain, rest", "rest << seen", told_um(differ)),
        Row(
            "  reverse motion: seen, expected, unexplained",
            f"<= {1e3 * check.allowed_rms_mm:.4f} um",
            told_um(moves),
        ),
    ]


def told_um(values_mm: tuple[float, ...]) -> str:
    """Write lengths in um."""
    return ", ".join(f"{1e3 * value:.5f}" for value in values_mm) + " um RMS"


def main() -> None:
    """Print the table."""
    nominal = ca.offset(SURFACE, TIP_RADIUS_MM)
    if "--paper" in sys.argv:
        x, y = (a.ravel() for a in np.meshgrid(np.linspace(-51, 51, 1021), np.linspace(-31, 31, 1241)))
        points = np.stack([x, y, SURFACE.jet(x, y).z], axis=1)
        nominal = ca.offset(PointSet.of(points, kind=PointKind.NOMINAL, frame="part"), TIP_RADIUS_MM)
    rows = [row for pv_mm in (0.0, 0.027) for row in compared(nominal, pv_mm)]
    print("iterations: to the end, + not converged (and to within 1 % of the last residual)")
    print("pose error: at the edge, angle; error of deviations at points that no method saw")
    show("Reference methods", rows + both_ways(nominal))


if __name__ == "__main__":
    main()
