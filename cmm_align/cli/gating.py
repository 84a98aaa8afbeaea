"""The gate of `compensate`: exports are written, read back and judged before any of them gets its name."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from cmm_align.errors import GateError
from cmm_align.units import UM_PER_MM, mm_per

if TYPE_CHECKING:
    from cmm_align.cli.exporting import Plan
    from cmm_align.model import Correction, DeviationMap, GateCheck, GatedExport, GateReport
    from cmm_align.numerics.wheel import Wheel
    from cmm_align.pose import Pose
    from cmm_align.posts import Prepared
    from cmm_align.stages.gate import ReadBack, ReadBackField
    from cmm_align.stages.wheel_check import DepthCheck, WheelCheck

SKIPPED: Final = (
    "NO GATE (--no-gate): nobody has checked sign, frame and rounding of the exported files; "
    "do not grind them before you have"
)

_WHOLE_GRID: Final = {"xyz", "xyzijk", "zemax"}
_FIELD_ACCURACY_MM: Final = 1e-9


def written(
    stack: ExitStack,
    plan: Plan,
    exports: Sequence[tuple[Path, Prepared]],
    deviation_map: DeviationMap,
    correction: Correction,
    placed: Correction,
    wheel: Wheel | None,
    *,
    overwrite: bool,
    skip: bool,
) -> GateReport:
    """Write the exports under temporary names and judge them; they get their names when `stack` ends well.

    Parameters
    ----------
    stack : ExitStack
    plan : Plan
    exports : sequence of (Path, Prepared)
    deviation_map : DeviationMap
    correction : Correction
        As it lies in frame `part`.
    placed : Correction
        The same in the frame of the files.
    wheel : Wheel or None
        Axis in the frame of the files.
    overwrite : bool
    skip : bool
        Whether nothing is to be judged.

    Raises
    ------
    GateError
        If a file would not make the part better; none is written then.
    OutputError
        If one cannot be written.
    """
    from cmm_align.io.atomic import atomic_path
    from cmm_align.model import GateReport
    from cmm_align.stages.gate import Gate, refuse

    gate = None if skip else Gate(deviation_map, correction)
    found = []
    for name, (path, one) in zip(plan.names, exports, strict=True):
        temporary = stack.enter_context(atomic_path(path, overwrite))
        with temporary.open("wb") as stream:
            stream.writelines(one.blocks)
        if gate is not None:
            read = read_back(temporary, path, name, plan, placed, wheel)
            found.append(gate.judge(read))
            refuse(found[-1], str(path))
    return GateReport(skip, tuple(found))


def read_back(
    path: Path, named: Path, name: str, plan: Plan, placed: Correction, wheel: Wheel | None
) -> ReadBack | ReadBackField:
    """Return what a file makes a machine do; `named` is what it will be called, the rest as for `written`.

    Raises
    ------
    GateError
        If it states another frame than it was to be written in.
    """
    import numpy as np

    from cmm_align import posts
    from cmm_align.pose import Pose
    from cmm_align.stages.gate import ReadBack, ReadBackField

    if name == "dwell":
        removal = posts.read_dwell(path)
        x, y = np.meshgrid(removal.x_mm, removal.y_mm)
        on = removal.inside
        return ReadBackField(name, x[on], y[on], removal.correction_mm[on], _FIELD_ACCURACY_MM)
    pose = surface_from_file(placed)
    outward = pose.inverse().rotate(np.array([[0.0, 0.0, float(placed.nominal.side)]]))[0]
    found = posts.read_back(path, name, wheel, post=plan.post, outward=outward)
    expected = placed.nominal.surface_from_part.source
    if found.frame not in {"surface", expected} and name != "template":
        raise GateError(
            f"the gate holds this file back: it states the frame of the {found.frame}",
            where=str(named),
            expected=f"the frame of the {expected}",
            remedy="nothing was written",
        )
    whole = name in _WHOLE_GRID or (
        plan.post is not None and name == "template" and plan.post.order == "rows"
    )
    centres = None if _states_contacts(plan, name) else found.tool_centres_mm
    return ReadBack(
        kind=name,
        points_mm=found.points_mm,
        normals=found.normals,
        surface_from_file=Pose.identity("surface", "file") if found.frame == "surface" else pose,
        accuracy_mm=min(found.accuracy_mm, mm_per("nm")) if centres is not None else found.accuracy_mm,
        centres_mm=centres,
        wheel=wheel,
        reach_mm=0.0 if whole else _reach_mm(plan, placed),
    )


def surface_from_file(placed: Correction) -> Pose:
    """Return the pose of files in the frame of the part, or of the grinder where it was touched there."""
    from cmm_align.pose import Pose

    pose = placed.nominal.surface_from_part
    return Pose(pose.rotation, pose.translation_mm, "surface", "file")


def with_wheel(report: GateReport, wheel: WheelCheck | None, depth: DepthCheck | None) -> GateReport:
    """Return the report with what was found of gouges and air cuts, which are refused before."""
    from dataclasses import replace

    from cmm_align.stages.gate_checks import air_check, gouge_check

    more = [
        *([gouge_check(wheel)] if wheel is not None else []),
        *([air_check(depth)] if depth is not None else []),
    ]
    exports = tuple(replace(one, checks=(*one.checks, *more)) for one in report.exports)
    return replace(report, exports=exports)


def result(report: GateReport) -> dict[str, Any]:
    """Return the part of the result of `compensate` that tells of the gate."""
    return {
        "gate": {
            "skipped": report.skipped,
            "passed": not report.skipped and all(one.passed for one in report.exports),
            "exports": [_of_export(one) for one in report.exports],
        }
    }


def _of_export(one: GatedExport) -> dict[str, Any]:
    return {
        "kind": one.kind,
        "n": one.n,
        "passed": one.passed,
        "rms_before_um": one.rms_before_mm * UM_PER_MM,
        "pv_before_um": one.pv_before_mm * UM_PER_MM,
        "rms_um": None if one.rms_mm is None else one.rms_mm * UM_PER_MM,
        "pv_um": None if one.pv_mm is None else one.pv_mm * UM_PER_MM,
        "accuracy_um": one.accuracy_mm * UM_PER_MM,
        "checks": [_of_check(check) for check in one.checks],
    }


def _of_check(check: GateCheck) -> dict[str, Any]:
    unit = {"": "", "%": "_percent"}.get(check.unit, f"_{check.unit}")
    return {
        "name": check.name,
        "passed": check.passed,
        f"value{unit}": check.value,
        f"limit{unit}": check.limit,
        "words": check.words,
    }


def _states_contacts(plan: Plan, name: str) -> bool:
    return name == "template" and plan.post is not None and {"x", "y", "z"} <= set(plan.post.names)


def _reach_mm(plan: Plan, correction: Correction) -> float:
    """Return how far a commanded node may lie from the path: a mesh of it, and the step at a border."""
    step = max(float(a[1] - a[0]) for a in (correction.x_mm, correction.y_mm))
    spacings = (max(step, plan.config.line_spacing_mm), max(step, plan.config.point_spacing_mm))
    return hypot(*spacings) + step
