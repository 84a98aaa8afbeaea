"""What follows from a machine's MPE statement, beside its bars: ``python tests/bench/monte_carlo.py``.

The demo window, scanned with 20 301 points, 27 um of form error and 0.3 um of noise, is measured 1000 times.
"""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import numpy as np
from table import Row, Stopwatch, show

from cmm_align.config import AlignConfig
from cmm_align.model import Alignment, PointKind, PointSet
from cmm_align.numerics.machine_error import common_covariance, error_factors, machine_error
from cmm_align.stages.align import align
from cmm_align.stages.monte_carlo import linear_refit, monte_carlo
from cmm_align.stages.offset import offset

sys.path.append(str(Path(__file__).resolve().parents[1]))
from truth import measured_window

RUNS = 1000
REFITS = 20
ERROR = machine_error(0.7e-3, 1e-3 / 400.0)


def window() -> Alignment:
    """The window as aligned; all its points are kept."""
    truth = measured_window(lines=101, per_line=201, noise_mm=3e-4)
    nominal = offset(truth.surface, truth.tip_radius_mm)
    points = PointSet.of(truth.tip_centre_machine_mm, kind=PointKind.TIP_CENTRE)
    return align(points, nominal, AlignConfig(outliers="keep"))


def lengths() -> list[Row]:
    """The spread of 20 000 simulated lengths beside the statement."""
    rng = np.random.default_rng(1)
    rows = []
    for length in (1.0, 30.0, 100.0):
        u = rng.normal(size=3)
        u /= np.linalg.norm(u)
        p, n = np.array([0.0 * u, length * u]), np.array([-u, u])
        factors, sigma = error_factors(ERROR, p, n)
        e = rng.normal(size=(20_000, len(factors))) @ factors + sigma * rng.normal(size=(20_000, 2))
        bar = 0.5e3 * (0.7e-3 + length / 400e3)
        rows.append(
            Row(f"sigma of a length of {length:g} mm", f"{bar:.4f} um", f"{1e3 * e.sum(axis=1).std():.4f} um")
        )
    return rows


def simulated(alignment: Alignment) -> list[Row]:
    """Time, memory and result of the Monte Carlo."""
    with Stopwatch() as watch:
        found, points = monte_carlo(alignment, "0.7+L/400", RUNS)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    with Stopwatch() as factoring:
        arm = alignment.tip_centre_part_mm - alignment.tip_centre_part_mm.mean(axis=0)
        factors, _ = error_factors(ERROR, arm, alignment.normals)
    few = np.arange(0, len(arm), 20)
    exact = common_covariance(ERROR, arm[few], alignment.normals[few], arm[few], alignment.normals[few])
    wrong = np.abs(factors[:, few].T @ factors[:, few] - exact)
    np.fill_diagonal(wrong, 0.0)
    pose = ", ".join(f"{name} {value:.3g}" for name, value in found.pose_sigma.items())
    return [
        Row(
            f"{RUNS} runs, {len(points.index)} points",
            "a few s",
            f"{watch.wall:.1f} s ({watch.cpu:.1f} s of cores)",
        ),
        Row("  of these, factors", "-", f"{factoring.wall:.1f} s, {len(factors)}"),
        Row("  peak memory of the process", "-", f"{peak:.0f} MB"),
        Row("  covariance left out, share", "<= 0.02", f"{wrong.max() / (0.5 * 0.7e-3) ** 2:.4f}"),
        Row("  pose", "-", pose),
        Row(
            "  PV",
            "-",
            f"{found.pv.measured_um:.2f} um, bias {found.pv.bias_um:.2f}, u {found.pv.std_um:.2f}",
        ),
        Row(
            "  RMS",
            "-",
            f"{found.rms.measured_um:.3f} um, bias {found.rms.bias_um:.3f}, u {found.rms.std_um:.3f}",
        ),
    ]


def refitted(alignment: Alignment) -> list[Row]:
    """Full fits beside the linear ones."""
    rng = np.random.default_rng(2)
    every = np.arange(len(alignment.used))
    refit = linear_refit(alignment, every, alignment.used.astype(float))
    centre = alignment.tip_centre_part_mm[alignment.used].mean(axis=0)
    factors, sigma = error_factors(ERROR, alignment.tip_centre_part_mm - centre, alignment.normals)
    found, _ = monte_carlo(alignment, "0.7+L/400", RUNS)
    whiten = np.linalg.inv(np.linalg.cholesky(np.array(found.covariance)))
    machine = alignment.part_from_machine.inverse().rotate(alignment.normals)
    worst = 0.0
    for _ in range(REFITS):
        errors = rng.normal(size=len(factors)) @ factors + sigma * rng.normal(size=len(every))
        points = PointSet.of(
            alignment.tip_centre_machine_mm + errors[:, None] * machine, kind=PointKind.TIP_CENTRE
        )
        full = align(
            points, alignment.nominal, AlignConfig(outliers="keep"), start=alignment.part_from_machine
        )
        step = full.part_from_machine @ alignment.part_from_machine.inverse()
        moved = np.concatenate([step.rotation_vector_rad(), step.apply(centre[None])[0] - centre])
        linear = refit.to_part @ refit.response @ refit.push @ errors
        worst = max(worst, float(np.linalg.norm(whiten @ (moved - linear))))
    return [Row(f"{REFITS} full fits: pose, in sigmas", "<= 3e-3", f"{worst:.1e}")]


def main() -> None:
    """Print the table."""
    alignment = window()
    show("Monte Carlo from MPE 0.7+L/400", [*lengths(), *simulated(alignment), *refitted(alignment)])


if __name__ == "__main__":
    main()
