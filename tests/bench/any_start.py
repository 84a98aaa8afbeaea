"""Parts laid anywhere: ``python tests/bench/any_start.py [POSES]``, 200 unless said otherwise.

The search alone (facets, 5000 points) on many kinds of part, then the whole stage on the demo window.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from table import Row, Stopwatch, show

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from laid_anywhere import (
    LARGEST_MM,
    NEAR_SYMMETRIC,
    NEARER_SYMMETRIC,
    RADIUS_MM,
    SQUARE,
    Table,
    part_points,
    polynomial,
)

import cmm_align as ca
from cmm_align.model import PointKind, PointSet
from cmm_align.numerics.pose_verdicts import near_ties
from cmm_align.pose import Pose
from cmm_align.virtual.window import window

DEMO = window()
BASIN = (0.05, 3.0)
"""rad, mm: nearer than any other minimum, farther than form error moves a part of a window."""
PARTS = {
    "demo window": (DEMO, {}),
    "  its left half": (DEMO, {"box": (-1.0, 0.0, -1.0, 1.0)}),
    "  a quarter": (DEMO, {"box": (0.0, 1.0, 0.0, 1.0)}),
    "  a strip along x": (DEMO, {"box": (-1.0, 1.0, -0.1, 0.1)}),
    "  a tenth of strays": (DEMO, {"strays": 0.1}),
    "near symmetric": (polynomial(NEAR_SYMMETRIC), {"pv_mm": 0.009}),
    "nearer symmetric (or a tie)": (polynomial(NEARER_SYMMETRIC), {"pv_mm": 0.009}),
    "square": (polynomial(SQUARE, 'shape = "rectangle"\nwidth = 60.0\nheight = 60.0'), {}),
    "round": (polynomial(SQUARE, 'shape = "circle"\nradius = 30.0'), {}),
    "  half of it": (polynomial(SQUARE, 'shape = "circle"\nradius = 30.0'), {"box": (-1.0, 0.0, -1.0, 1.0)}),
}


def searches(poses: int) -> list[Row]:
    """Search every kind of part from many poses."""
    rows = []
    for name, (surface, where) in PARTS.items():
        table, points = Table(surface), part_points(surface, **where)
        count = poses if name == "demo window" else max(10, poses // 10)
        right, spent = 0, []
        for seed in range(count):
            with Stopwatch() as watch:
                found = table.find(points, seed)
            spent.append(watch.wall)
            ways = range(1 + len(near_ties(found.candidates)))
            right += any(found.off(k)[0] < BASIN[0] and found.off(k)[1] < BASIN[1] for k in ways)
        time = f"{np.mean(spent):.2f} s, at most {max(spent):.2f} s"
        rows.append(Row(name, f"{count} of {count}, <= 0.6 s", f"{right} of {count}, {time}"))
    return rows


def alignments(poses: int) -> list[Row]:
    """Align the demo window from many poses; hold each result against that from the true pose."""
    nominal = ca.offset(DEMO, RADIUS_MM)
    points = part_points(DEMO, n=100_000)
    best = ca.align(PointSet.of(points, kind=PointKind.TIP_CENTRE), nominal).part_from_machine
    apart, turned, spent = [], [], []
    for seed in range(poses):
        rng = np.random.default_rng(seed)
        turn = Rotation.random(random_state=seed).as_matrix()
        pose = Pose(turn, rng.uniform(-LARGEST_MM, LARGEST_MM, 3), "machine", "part")
        laid = PointSet.of(pose.apply(points), kind=PointKind.TIP_CENTRE)
        try:
            with Stopwatch() as watch:
                found = ca.align(laid, nominal).part_from_machine
        except ca.errors.CmmAlignError as error:
            print(f"pose {seed}: {error}")
            continue
        spent.append(watch.wall)
        apart.append(np.abs(found.apply(pose.apply(points)) - best.apply(points)).max())
        turned.append(Rotation.from_matrix(found.rotation @ turn @ best.rotation.T).magnitude())
    good = np.count_nonzero((np.array(apart) < 1e-4) & (np.array(turned) < 1e-6))
    time = f"{np.mean(spent):.2f} s, at most {max(spent):.2f} s" if spent else "-"
    return [
        Row("align, 1e5 points: within 0.1 um, 1 urad", f"{poses} of {poses}", f"{good} of {poses}"),
        Row("  time", "<= 2 s", time),
    ]


def main() -> None:
    """Print the table."""
    poses = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    show("Any start", searches(poses) + alignments(poses))


if __name__ == "__main__":
    main()
