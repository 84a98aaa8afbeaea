"""How exact each kind of nominal is, beside its bar: ``python tests/bench/nominals.py [--large]``.

The truth is the virtual window's formula; errors are deviations along the normal at random places.
``--large`` adds 1.2e6 scattered points and the whole process on 1021 x 1241 nodes.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from table import Row, Stopwatch, run_process, show

from cmm_align.config import OffsetConfig
from cmm_align.model import PointKind, PointSet
from cmm_align.stages.offset import offset
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.virtual.window import TIP_RADIUS_MM, window

SURFACE = window()
RNG = np.random.default_rng(1)
X, Y = RNG.uniform(-51, 51, 200_000), RNG.uniform(-31, 31, 200_000)
TRUTH = SURFACE.jet(X, Y)
COSINE = unit_normal(TRUTH, 1)[:, 2]


def grid(dx: float, dy: float):
    """Nominal points on a grid."""
    x, y = (
        a.ravel()
        for a in np.meshgrid(
            np.linspace(-51, 51, round(102 / dx) + 1), np.linspace(-31, 31, round(62 / dy) + 1)
        )
    )
    return np.stack([x, y, SURFACE.jet(x, y).z], axis=1)


def built(points, config: OffsetConfig = OffsetConfig()):
    """Run offset on points and time it."""
    with Stopwatch() as watch:
        nominal = offset(PointSet.of(points, kind=PointKind.NOMINAL, frame="part"), TIP_RADIUS_MM, config)
    error_nm = 1e6 * (nominal.surface.jet(X, Y).z - TRUTH.z) * COSINE
    return nominal, error_nm, watch


def on_grids() -> list[Row]:
    """Grids of two densities, exact and printed."""
    rows = []
    for step, bar in ((0.1, "<= 1e-4 nm"), (0.5, "<= 0.01 nm")):
        nominal, error, watch = built(grid(step, step))
        border = (np.abs(X) > 51 - 2 * step) | (np.abs(Y) > 31 - 2 * step)
        stated = nominal.quality.surface_error_pv_nm
        note = f"degree {nominal.surface.degree}, stated {stated:.1e} nm, {watch.wall:.1f} s"
        rows.append(Row(f"grid {step} mm, PV inside", bar, f"{np.ptp(error[~border]):.1e} nm ({note})"))
        rows.append(Row("  within two cells of the border", "<= 1 nm", f"{np.ptp(error[border]):.1e} nm"))
        _, error, _ = built(np.round(grid(step, step), 6))
        rows.append(Row("  printed with 6 decimals", "<= 1 nm", f"{np.ptp(error):.2f} nm"))
    return rows


def facets() -> list[Row]:
    """The facet error at the paper's spacing against its prediction h^2 k / 4 on the diagonal."""
    nominal, _, _ = built(grid(0.1, 0.05))
    jet = SURFACE.jet(X, Y)
    diagonal = [0.1**2 * jet.zxx + s * 2 * 0.1 * 0.05 * jet.zxy + 0.05**2 * jet.zyy for s in (1, -1)]
    predicted = 1e6 * np.abs(np.array(diagonal)[0] * COSINE).max() / 8.0
    return [
        Row(
            "facets at 0.1 x 0.05 mm",
            "prediction +- 20 %",
            f"{nominal.quality.facet_error_pv_nm:.1f} nm, predicted {predicted:.1f} nm",
        )
    ]


def scattered(n: int) -> list[Row]:
    """Scattered points with exact values."""
    x, y = RNG.uniform(-51, 51, n), RNG.uniform(-31, 31, n)
    nominal, error, watch = built(np.stack([x, y, SURFACE.jet(x, y).z], axis=1))
    bar = "<= 0.1 nm, <= 10 s" if n > 1e6 else "<= 0.1 nm"
    stated = nominal.quality.surface_error_pv_nm
    return [
        Row(
            f"scattered, {n:.3g} points",
            bar,
            f"{np.ptp(error):.1e} nm (stated {stated:.1e}), {watch.wall:.1f} s",
        )
    ]


def whole_process() -> list[Row]:
    """The command on the paper's grid."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "nominal.npy"
        np.save(path, grid(0.1, 0.05))
        cost = run_process(
            "offset", str(path), "--tip-radius", "1.5", "-o", str(Path(folder) / "n.h5"), "-q", "--overwrite"
        )
    return [
        Row("offset, 1021 x 1241, whole process", "<= 3 s", f"{cost.seconds:.2f} s, {cost.peak_mb:.0f} MB")
    ]


def main() -> None:
    """Print the table."""
    rows = on_grids() + facets() + scattered(100_000)
    if "--large" in sys.argv:
        rows += scattered(1_200_000) + whole_process()
    show("Nominal surfaces", rows)


if __name__ == "__main__":
    main()
