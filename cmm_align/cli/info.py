"""`cmm-align info`: what is in a file, and where it came from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from cmm_align.cli import options
from cmm_align.cli.job import Job, Outcome
from cmm_align.cli.options import FILE

Rows = list[tuple[str, str]]

TEXT = """What is in FILE, and where it came from.

For a file of ours: its numbers, its datasets and every step that led to it. For any other file: what
it was taken for, and its size.
"""


@options.command("info", TEXT)
@click.argument("file", type=FILE)
def command(job: Job, file: Path) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish

    return finish(job, look_into(job, file))


def look_into(job: Job, path: Path) -> Outcome:
    """Find out what a file holds.

    Parameters
    ----------
    job : Job
    path : Path
        Any file that one of the commands reads.
    """
    from cmm_align import io
    from cmm_align.provenance import InputFile, sha256_of_file

    checksum = sha256_of_file(path)
    with path.open("rb") as stream:
        ours = stream.read(len(io.MAGIC)) == io.MAGIC and io.schema_of(path) is not None
    result, rows, follow = _ours(path, verbose=job.verbosity > 0) if ours else _theirs(path, job.units)
    return Outcome(
        command=job.command,
        noun=None,
        inputs=[InputFile(str(path), checksum)],
        outputs=[],
        result=result,
        rows=[*rows, ("sha256", checksum)],
        next_command=follow,
    )


def _ours(path: Path, *, verbose: bool) -> tuple[dict[str, Any], Rows, str]:
    """Return result, rows and what to do next for a file of ours."""
    from dataclasses import asdict

    from cmm_align import io

    found = io.describe(path)
    rows = [
        ("what", f"{found['what']}, {found['schema']} version {found['schema_version']}"),
        *_summary(path),
    ]
    for number, step in enumerate(found["steps"], start=1):
        files = ", ".join(f"{item.path} ({item.sha256[:8]})" for item in step.inputs)
        rows.append(
            (f"step {number}", f"{step.command} {step.version}, {step.time_utc}, of {files or 'no file'}")
        )
        if verbose:
            rows += [("", f"{key} = {value}") for key, value in step.parameters.items()]
    for item in found["datasets"] if verbose else ():
        shape = " x ".join(map(str, item["shape"])) or "scalar"
        rows.append((item["name"], f"{shape}, {item['units']}: {item['description']}"))
    result = {**found, "steps": [asdict(step) for step in found["steps"]]}
    return result, rows, found["next"].replace("`", "")


def _summary(path: Path) -> Rows:
    """Return the rows that the command which made a file has shown."""
    from cmm_align import io
    from cmm_align.cli.results import probe_row
    from cmm_align.model import Alignment, Correction, DeviationMap
    from cmm_align.report import summary

    noun = io.read(path)
    if isinstance(noun, Alignment):
        return [probe_row(noun.nominal), *summary.of_alignment(noun)]
    if isinstance(noun, DeviationMap):
        return [probe_row(noun.alignment.nominal), *summary.of_map(noun)]
    if isinstance(noun, Correction):
        return [probe_row(noun.nominal), *summary.of_correction(noun)]
    return summary.of_nominal(noun)


def _theirs(path: Path, units: str | None) -> tuple[dict[str, Any], Rows, str]:
    """Return result, rows and what to do next for a file of somebody else."""
    from cmm_align import files
    from cmm_align.model import PointSet

    found = files.read(path, units)
    if not isinstance(found, PointSet):
        bounds = found.bounds  # type: ignore[union-attr]
        size = [bounds.x_max - bounds.x_min, bounds.y_max - bounds.y_min]
        rows = [("what", "a prescription"), ("aperture", f"{size[0]:g} x {size[1]:g} mm")]
        return {"what": "a prescription", "size_mm": size}, rows, f"cmm-align offset {path} --tip-radius R"
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
    return result, rows, ""
