"""`cmm-align info`: what is in a file, and where it came from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cmm_align.cli import options
from cmm_align.cli.job import Job, Outcome, typed
from cmm_align.cli.options import FILE

if TYPE_CHECKING:
    from cmm_align.surfaces.mesh import TriangleMesh

Rows = list[tuple[str, str]]

TEXT = """What is in each FILE, and where it came from.

For a file of ours: its numbers, its datasets and every step that led to it. For any other file: what
it was taken for, and its size.
"""


@options.command("info", TEXT, writes=False)
@click.argument("files", type=FILE, nargs=-1, required=True, metavar="FILE...")
def command(job: Job, files: tuple[Path, ...]) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish

    found = [look_into(job, path) for path in files]
    if job.json and len(found) > 1:
        together = replace(
            found[0],
            inputs=[item for one in found for item in one.inputs],
            result={"files": [dict(one.result) for one in found]},
        )
        return finish(job, together)
    return max(finish(job, one) for one in found)


def look_into(job: Job, path: Path) -> Outcome:
    """Find out what a file holds.

    Parameters
    ----------
    job : Job
    path : Path
        Any file that one of the commands reads.
    """
    from cmm_align import io
    from cmm_align.cli import opening
    from cmm_align.io import ledger_file
    from cmm_align.provenance import InputFile, sha256_of_file

    opening.check_kind(path, opening.ANY)
    checksum = sha256_of_file(path)
    with path.open("rb") as stream:
        head = stream.read(len(ledger_file.MAGIC))
    ours = head.startswith(io.MAGIC) and io.schema_of(path) is not None
    if head == ledger_file.MAGIC:
        result, rows, details, follow = _ledger(path)
    else:
        result, rows, details, follow = _ours(path) if ours else _theirs(path, job.units)
    is_command = follow.startswith("cmm-align")
    return Outcome(
        command=job.command,
        noun=None,
        inputs=[InputFile(str(path), checksum)],
        outputs=[],
        result=result,
        rows=[*rows, ("sha256", checksum), *([("use", follow)] if follow and not is_command else [])],
        details=details,
        next_command=follow if is_command else "",
    )


def _ours(path: Path) -> tuple[dict[str, Any], Rows, Rows, str]:
    """Return result, rows, details and what to do next for a file of ours."""
    from dataclasses import asdict

    from cmm_align import io

    found = io.describe(path)
    own, more = _summary(path)
    rows = [("what", f"{found['what']}, {found['schema']} version {found['schema_version']}"), *own]
    details = list(more)
    for number, step in enumerate(found["steps"], start=1):
        files = ", ".join(f"{item.path} ({item.sha256[:8]})" for item in step.inputs)
        name = f"step {number}"
        rows.append((name, f"{step.command} {step.version}, {step.time_utc}, of {files or 'no file'}"))
        for key, value in step.parameters.items():
            details.append((name, f"{key} = {value}"))
            name = ""
    for item in found["datasets"]:
        shape = " x ".join(map(str, item["shape"])) or "scalar"
        details.append((item["name"], f"{shape}, {item['units']}: {item['description']}"))
    result = {**found, "steps": [asdict(step) for step in found["steps"]]}
    return result, rows, details, found["next"].replace("`", "")


def _ledger(path: Path) -> tuple[dict[str, Any], Rows, Rows, str]:
    """Return result, rows, details and what to do next for a ledger."""
    from cmm_align.io.ledger_file import VERSION, read_ledger

    ledger = read_ledger(path)
    parts = list(dict.fromkeys(one.part for one in ledger.passes))
    result = {"what": "a ledger", "n_passes": len(ledger.passes), "parts": parts}
    rows = [
        ("what", f"a ledger of passes, version {VERSION}"),
        ("passes", f"{len(ledger.passes)}, of parts: {', '.join(parts) or 'none yet'}"),
        ("nominal", ledger.nominal_digest),
    ]
    return result, rows, [], typed("cmm-align", "history", path)


def _summary(path: Path) -> tuple[Rows, Rows]:
    """Return the rows and details that the command which made a file has shown."""
    from cmm_align import io
    from cmm_align.cli.results import probe_row
    from cmm_align.model import Alignment, Correction, DeviationMap
    from cmm_align.report import alignment_summary, summary

    noun = io.read(path)
    if isinstance(noun, Alignment):
        details = alignment_summary.details_of_alignment(noun)
        return [probe_row(noun.nominal), *alignment_summary.of_alignment(noun)], details
    if isinstance(noun, DeviationMap):
        word, reasons = summary.verdict_of(noun)
        verdict = [("verdict", f"{word}: {'; '.join(reasons)}")] if word else []
        rows = [*verdict, *summary.of_map(noun), probe_row(noun.alignment.nominal)]
        return rows, summary.details_of_map(noun)
    if isinstance(noun, Correction):
        rows = [*summary.of_correction(noun), probe_row(noun.nominal)]
        return rows, summary.details_of_correction(noun)
    return summary.of_nominal(noun), []


def _theirs(path: Path, units: str | None) -> tuple[dict[str, Any], Rows, Rows, str]:
    """Return result, rows, details and what to do next for a file of somebody else."""
    from cmm_align import files
    from cmm_align.model import PointSet
    from cmm_align.surfaces.mesh import TriangleMesh
    from cmm_align.surfaces.nurbs import NurbsSurface

    found = files.read(path, units)
    follow = typed("cmm-align", "offset", path, "--tip-radius", "R")
    if isinstance(found, TriangleMesh):
        return *_mesh(found), [], follow
    if not isinstance(found, PointSet):
        what = "a CAD face" if isinstance(found, NurbsSurface) else "a prescription"
        bounds = found.bounds  # type: ignore[union-attr]
        size = [bounds.x_max - bounds.x_min, bounds.y_max - bounds.y_min]
        rows = [("what", what), ("aperture", f"{size[0]:g} x {size[1]:g} mm")]
        return {"what": what, "size_mm": size}, rows, [], follow
    low, high = found.points_mm.min(axis=0), found.points_mm.max(axis=0)
    result: dict[str, Any] = {
        "what": "points",
        "n_points": len(found),
        "kind": str(found.kind),
        "frame": found.frame,
        "min_mm": low.tolist(),
        "max_mm": high.tolist(),
    }
    rows = [
        ("what", f"{len(found)} points"),
        ("kind", str(found.kind).replace("_", " ")),
        ("frame", found.frame),
        *(
            (axis, f"{a:.4f} to {b:.4f} mm   ({b - a:.4f})")
            for axis, a, b in zip("xyz", low, high, strict=True)
        ),
    ]
    return result, rows, [], ""


def _mesh(mesh: TriangleMesh) -> tuple[dict[str, Any], Rows]:
    """Return result and rows for a triangle mesh."""
    size = (mesh.points_mm.max(axis=0) - mesh.points_mm.min(axis=0)).tolist()
    n_points, n_triangles = len(mesh.points_mm), len(mesh.triangles)
    dropped = f", {mesh.n_degenerate} without area dropped" if mesh.n_degenerate else ""
    rows = [
        ("what", "a triangle mesh"),
        ("facets", f"{n_triangles} on {n_points} vertices{dropped}"),
        ("size", " x ".join(f"{value:.4f}" for value in size) + " mm"),
    ]
    result = {
        "what": "a triangle mesh",
        "n_points": n_points,
        "n_triangles": n_triangles,
        "n_degenerate": mesh.n_degenerate,
        "size_mm": size,
    }
    return result, rows
