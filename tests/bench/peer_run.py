"""Registration by one library, in a process of its own: ``python peer_run.py METHOD CASE.npz RESULT.npz``.

The case holds `source` (n, 3), `target` (m, 3), `normals` (m, 3) and `source_normals` (n, 3), all centred on
the middle of the target, `starts` (k, 4, 4) to begin from, and `n_threads`. The result holds for each start
the motion after each iteration and the time it was reached, without what the library does once for a
target (its set-up, told apart), and the peak memory. No peer sees our package.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

FAR_MM = 1e3
"""No partner is too far away."""
MOST = 100
"""Iterations that a method may take."""
LOOKS = (1, 2, 3, 4, 5, 6, 8, 10, 14, 20)
"""Iterations after which a method that cannot be watched is looked at."""
CLOSEST_MOST = 200
"""The same for point to point, which creeps."""
EPSILON = 1e-8
"""Smallest step, rad and mm, of a method that stops by it."""


class Case(NamedTuple):
    """What every method is given."""

    source: np.ndarray
    target: np.ndarray
    normals: np.ndarray
    source_normals: np.ndarray
    triangles: np.ndarray
    threads: int


Trace = list[tuple[float, np.ndarray]]
"""Seconds since the start of the solver, and the motion then; the last is the result."""
Solver = Callable[[np.ndarray], Trace]


def open3d_plane(case: Case) -> Solver:
    """Open3D, float64, exact normals; it builds its tree anew in each call, which is taken off.

    The older pipeline: the look-up of the tensor pipeline gathers every vertex within the largest distance,
    and with the distances of such starts takes a thousand times as long.
    """
    import open3d as o3d

    reg = o3d.pipelines.registration
    source, target = (
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(p)) for p in (case.source, case.target)
    )
    target.normals = o3d.utility.Vector3dVector(case.normals)

    def build(_: int) -> float:
        begin = time.perf_counter()
        o3d.geometry.KDTreeFlann(target)
        return time.perf_counter() - begin

    set_up = min(map(build, range(3)))

    def run(start: np.ndarray, most: int) -> tuple[float, np.ndarray]:
        begin = time.perf_counter()
        found = reg.registration_icp(
            source,
            target,
            FAR_MM,
            start,
            reg.TransformationEstimationPointToPlane(),
            reg.ICPConvergenceCriteria(1e-15, 1e-15, most),
        )
        return max(time.perf_counter() - begin - set_up, 0.0), np.array(found.transformation)

    def solve(start: np.ndarray) -> Trace:
        return [run(start, k) for k in LOOKS]

    return solve


def small_gicp(case: Case, kind: str) -> Solver:
    """small_gicp on prepared clouds (normals and covariances are its own: it takes none)."""
    import small_gicp as sg

    source, target = sg.PointCloud(case.source), sg.PointCloud(case.target)
    tree = sg.KdTree(target, num_threads=case.threads)
    sg.estimate_normals_covariances(target, tree, num_neighbors=10, num_threads=case.threads)
    sg.estimate_normals_covariances(source, num_neighbors=10, num_threads=case.threads)

    def solve(start: np.ndarray) -> Trace:
        trace: Trace = []
        for epsilon in (1e-2, 1e-3, 1e-4, EPSILON):
            begin = time.perf_counter()
            found = sg.align(
                target,
                source,
                tree,
                init_T_target_source=start,
                registration_type=kind,
                max_correspondence_distance=FAR_MM,
                num_threads=case.threads,
                max_iterations=MOST,
                rotation_epsilon=epsilon,
                translation_epsilon=epsilon,
            )
            trace.append((time.perf_counter() - begin, np.array(found.T_target_source)))
        return trace

    return solve


def trimesh_icp(case: Case) -> Solver:
    """Take trimesh's closest points on the triangles: exact on them, but point to point."""
    import trimesh

    mesh = trimesh.Trimesh(case.target, case.triangles, process=False)
    mesh.nearest.on_surface(case.source[:2])  # builds its tree

    def solve(start: np.ndarray) -> Trace:
        trace: Trace = []
        now, begin = start, time.perf_counter()
        for _ in range(CLOSEST_MOST // 20):
            now, _, _ = trimesh.registration.icp(
                case.source, mesh, now, threshold=0.0, max_iterations=20, reflection=False, scale=False
            )
            trace.append((time.perf_counter() - begin, np.array(now)))
        return trace

    return solve


def simple_icp(case: Case) -> Solver:
    """simpleICP: planes at the measured points (their exact normals given), the nominal moves onto them."""
    import pandas as pd
    from simpleicp import PointCloud, SimpleICP

    table = dict(zip(("x", "y", "z"), case.source.T, strict=True))
    normals = dict(zip(("nx", "ny", "nz"), case.source_normals.T, strict=True))

    def solve(start: np.ndarray) -> Trace:
        away = np.linalg.inv(start)
        begin = time.perf_counter()
        fixed = PointCloud(pd.DataFrame({**table, **normals, "planarity": np.ones(len(case.source))}))
        there = case.target @ away[:3, :3].T + away[:3, 3]
        moving = PointCloud(there, columns=["x", "y", "z"])
        job = SimpleICP()
        job.add_point_clouds(fixed, moving)
        with contextlib.redirect_stdout(io.StringIO()):
            found = job.run(correspondences=len(case.source), min_change=1e-6, max_iterations=MOST)[0]
        return [(time.perf_counter() - begin, np.linalg.inv(found @ away))]

    return solve


METHODS: dict[str, Callable[[Case], Solver]] = {
    "open3d": open3d_plane,
    "small_gicp": lambda case: small_gicp(case, "GICP"),
    "small_gicp-plane": lambda case: small_gicp(case, "PLANE_ICP"),
    "trimesh": trimesh_icp,
    "simpleicp": simple_icp,
}


def main() -> None:
    """Run a method from all starts."""
    name, case_path, result_path = sys.argv[1:]
    held = np.load(case_path)
    threads = int(held["n_threads"])
    os.environ.update({k: str(threads) for k in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")})
    case = Case(*(held[k] for k in Case._fields[:-1]), threads)
    begin = time.perf_counter()
    solve = METHODS[name](case)
    set_up = time.perf_counter() - begin
    times, motions = [], []
    for start in held["starts"]:
        try:
            trace = solve(start)
        except Exception as error:  # a peer that gives up has failed from this start, no more
            print(f"{name}: {error}", file=sys.stderr)
            trace = [(np.nan, np.full((4, 4), np.nan))]
        times.append([t for t, _ in trace])
        motions.append([m for _, m in trace])
    longest = max(map(len, times))
    for t, m in zip(times, motions, strict=True):
        t.extend([t[-1]] * (longest - len(t)))
        m.extend([m[-1]] * (longest - len(m)))
    np.savez(
        result_path, set_up_s=set_up, times_s=np.array(times), motions=np.array(motions), peak_mb=peak_mb()
    )


def peak_mb() -> float:
    """Return the peak memory of this process alone, MB; NaN where the system does not tell."""
    status = Path("/proc/self/status")  # not getrusage: it counts the parent's memory before the exec, too
    if not status.exists():
        return float("nan")
    line = next(w for w in status.read_text(encoding="utf-8").splitlines() if w.startswith("VmHWM"))
    return int(line.split()[1]) / 1024


if __name__ == "__main__":
    main()
