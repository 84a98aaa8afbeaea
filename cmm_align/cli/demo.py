"""`cmm-align demo`: the whole loop on a window whose truth is known, no machine needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, cast

import click

from cmm_align.cli import options
from cmm_align.cli.job import Job, Outcome, typed
from cmm_align.cli.measured import Sources
from cmm_align.cli.options import FILE
from cmm_align.errors import OutputError, OutputExistsError
from cmm_align.units import UM_PER_MM

if TYPE_CHECKING:
    from cmm_align.model import DeviationMap, PointSet
    from cmm_align.surfaces.protocol import Array

TEXT = """The whole loop on built-in data: two passes over a steep window, in the folder DIR.

Makes a 102 x 62 mm freeform with slopes to 45 degrees and a part with 27 um of form error, measures it
with a virtual CMM, runs the four stages, grinds a second pass from the compensation file and measures
again. Everything it wrote may be looked at, and run again by hand.
"""

NOMINAL_SPACING_MM: Final = 0.5
NOMINAL_DECIMALS: Final = 7
POINT_DECIMALS: Final = 5


@options.command("demo", TEXT)
@click.argument("folder", type=FILE, default=Path("cmm-align-demo"), metavar="[DIR]")
def command(job: Job, folder: Path) -> int:
    """Parse, call, show."""
    from cmm_align.cli.show import finish

    return finish(job, run_demo(job, folder))


def run_demo(job: Job, folder: Path) -> Outcome:
    """Make a window, measure, align, map, compensate, grind, and measure again.

    Parameters
    ----------
    job : Job
    folder : Path
        Made if it is not there; must be empty unless the job may overwrite.

    Raises
    ------
    OutputExistsError
        If the folder holds anything and the job may not overwrite.
    OutputError
        If the folder cannot be made or written.
    """
    from cmm_align import files
    from cmm_align.cli.compensate import make_correction
    from cmm_align.cli.drawing import try_one
    from cmm_align.cli.offset import make_nominal
    from cmm_align.cli.results import of_statistics
    from cmm_align.virtual.form_error import form_error
    from cmm_align.virtual.grinder import grind
    from cmm_align.virtual.window import TIP_RADIUS_MM, window

    make_folder(folder, overwrite=job.overwrite)
    job = replace(job, json=False, overwrite=True)
    surface, truth = window(), form_error(window())
    points = write_window(folder)
    nominal = make_nominal(replace(job, command="offset"), points, TIP_RADIUS_MM, job.config.offset)
    before = measure_and_map(job, folder / "part.csv", nominal.outputs[0], truth.at, seed=3)
    correction = make_correction(
        replace(job, command="compensate"), folder / "part.map.h5", job.config.compensate, first_pass=True
    )
    commanded = cast("PointSet", files.read(correction.outputs[1]))
    after = measure_and_map(
        job,
        folder / "part2.csv",
        nominal.outputs[0],
        grind(surface, truth.at, commanded.points_mm),
        seed=5,
    )
    picture = folder / "before-after.png"

    def draw(path: Path) -> None:
        from cmm_align.report.series_picture import draw_series

        draw_series([("first pass", before), ("second pass", after)], path)

    faults = try_one(draw, picture, overwrite=True)
    first, second = before.statistics, after.statistics
    return Outcome(
        command=job.command,
        noun=(before, after),
        inputs=[],
        outputs=[
            *([] if faults else [picture]),
            *sorted(path for path in folder.iterdir() if path != picture),
        ],
        warnings=faults,
        exit_code=OutputError.exit_code if faults else 0,
        result={
            "before": of_statistics(first),
            "after": of_statistics(second),
            "improvement": first.pv_mm / second.pv_mm,
            "folder": str(folder),
        },
        rows=[
            ("part", "freeform window, 102 x 62 mm, slopes to 45 deg, ball of 1.5 mm radius"),
            (
                "measured",
                f"{before.point_statistics.n} points a pass, noise 0.3 um, frame off by 20 mm and 20 deg",
            ),
            ("ground in", "form error of PV 27.00 um, known: what the first pass should find"),
            ("map before", f"PV {first.pv_mm * UM_PER_MM:6.2f} um   RMS {first.rms_mm * UM_PER_MM:5.2f} um"),
            ("map after", f"PV {second.pv_mm * UM_PER_MM:6.2f} um   RMS {second.rms_mm * UM_PER_MM:5.2f} um"),
            ("improvement", f"PV of the map {first.pv_mm / second.pv_mm:.1f} times smaller in one pass"),
        ],
        next_command=typed("cmm-align", "info", folder / "part.comp.h5"),
    )


def make_folder(folder: Path, *, overwrite: bool) -> None:
    """Make an empty folder, or refuse one that holds anything.

    Raises
    ------
    OutputExistsError
        If it holds anything and `overwrite` is False.
    OutputError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        full = any(folder.iterdir())
    except OSError as error:
        raise OutputError(f"cannot make the folder ({error.strerror})", where=str(folder)) from None
    if full and not overwrite:
        raise OutputExistsError(
            "the folder is not empty", where=str(folder), remedy="give an empty one, or --overwrite"
        )


def write_window(folder: Path) -> Path:
    """Write the prescription of the window and its points on a grid; return the path of the points."""
    from cmm_align.files import write_points
    from cmm_align.io.atomic import atomic_path
    from cmm_align.model import PointKind, PointSet
    from cmm_align.virtual.window import PRESCRIPTION, window_grid

    with atomic_path(folder / "nominal.toml", overwrite=True) as path:
        path.write_text(PRESCRIPTION, encoding="utf-8")
    points = folder / "nominal.csv"
    grid = PointSet.of(window_grid(NOMINAL_SPACING_MM), kind=PointKind.NOMINAL, frame="part")
    write_points(points, grid, decimals=NOMINAL_DECIMALS, overwrite=True)
    return points


def measure_and_map(
    job: Job, points: Path, nominal: Path, deviation_at: Callable[[Array, Array], Array], *, seed: int
) -> DeviationMap:
    """Measure a part with the virtual CMM, align and map it; return the map.

    Parameters
    ----------
    job : Job
    points : Path
        Where to write the tip centres; alignment and map go beside it.
    nominal : Path
        What `offset` wrote.
    deviation_at : callable
        Deviation of the part in mm, shape (n,), at foot points (x, y).
    seed : int
        Of the noise.
    """
    from cmm_align.cli.alignment_run import make_alignment
    from cmm_align.cli.error_map import make_map
    from cmm_align.files import write_points
    from cmm_align.model import PointKind, PointSet
    from cmm_align.virtual.cmm import scan_lines, tip_centres
    from cmm_align.virtual.window import TIP_RADIUS_MM, window

    surface = window()
    x_mm, y_mm = scan_lines(surface.bounds)
    centres = tip_centres(surface, deviation_at, x_mm, y_mm, TIP_RADIUS_MM, seed=seed)
    write_points(
        points, PointSet.of(centres, kind=PointKind.TIP_CENTRE), decimals=POINT_DECIMALS, overwrite=True
    )
    sources = Sources((str(points),))
    aligned = make_alignment(replace(job, command="align"), sources, nominal, job.config.align)
    outcome = make_map(replace(job, command="error-map"), aligned.outputs[0], job.config.error_map)
    return cast("DeviationMap", outcome.noun)
