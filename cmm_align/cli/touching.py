"""The part on the grinder: touches there, and what it costs if it sits wrongly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from cmm_align.cli.options import FILE, Length
from cmm_align.errors import UsageError, WrongStageError
from cmm_align.units import UM_PER_MM

if TYPE_CHECKING:
    from cmm_align.cli.job import Job
    from cmm_align.model import Correction, DeviationMap, Seat
    from cmm_align.stages.remount import Sensitivity

TOUCH_HEADINGS: Final = {"On the grinder": ("--touches", "--touch-radius")}
"""What the options stand under in the help."""

_OPTIONS = (
    click.option(
        "--touches",
        type=FILE,
        metavar="FILE",
        help="7 to 15 touches of the part where it is clamped, in the frame of the grinder.",
    ),
    click.option(
        "--touch-radius",
        type=Length(positive=False),
        metavar="L",
        help="Radius of the tip there; 0 for contact points.",
    ),
)


def touch_options(callback: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of touches to a command."""
    for option in reversed(_OPTIONS):
        callback = option(callback)
    return callback


def laid(
    job: Job,
    touches: Path | None,
    radius_mm: float | None,
    deviation_map: DeviationMap,
    correction: Correction,
    *,
    trusted: bool,
) -> tuple[Seat | None, Correction]:
    """Return how the part sits on the grinder, and the correction as it lies there; None without touches.

    Parameters
    ----------
    job : Job
    touches : Path or None
    radius_mm : float or None
        Of the tip that touched; 0 if they are contact points.
    deviation_map : DeviationMap
    correction : Correction
    trusted : bool
        Whether motions that the touches cannot tell may be held although they matter.

    Raises
    ------
    UsageError
        If one of both is given without the other.
    WrongStageError
        If the touches are in the frame of the part.
    GeometryError, NumericsError
        If the touches do not tell the pose, or do not fit the part.
    """
    if touches is None and radius_mm is None:
        return None, correction
    if touches is None or radius_mm is None:
        raise UsageError(
            "--touches FILE and --touch-radius L go together", remedy="give 0 for contact points"
        )
    from dataclasses import replace

    from cmm_align.files import read_measured
    from cmm_align.model import PointKind
    from cmm_align.stages.seat import placed, refuse_unknown, seat_of

    points = read_measured(touches, job.units)
    if points.frame == "part":
        raise WrongStageError(
            f"{touches.name} is in the frame of the part",
            expected="touches as the grinder tells them, frame=grinder or machine",
            remedy="give the file of the touches, not one of the drawing",
        )
    if points.kind is PointKind.CONTACT and radius_mm > 0.0:
        raise UsageError(
            f"{touches.name} holds contact points, --touch-radius is {radius_mm:g} mm",
            expected="tip centres, or a radius of 0",
        )
    kind = PointKind.CONTACT if radius_mm == 0.0 else PointKind.TIP_CENTRE
    seat = seat_of(replace(points, kind=kind, frame="machine"), radius_mm, deviation_map, correction)
    if not trusted:
        refuse_unknown(seat, correction, str(touches))
    return seat, placed(correction, seat)


def warnings(seat: Seat | None) -> list[str]:
    """Return what to know about the seat."""
    if seat is None:
        return []
    texts = [
        f"touch {touch.number} lies {touch.off_mm * UM_PER_MM:+.3g} um off what the others say: clean the "
        "place and touch again"
        for touch in seat.doubtful
    ]
    if seat.held:
        texts.append(
            f"the touches cannot tell {', '.join(seat.held)}: held as the axes of the grinder are; 1 mm of "
            f"it at the edge changes the corrections by {seat.moved_by_held_mm * UM_PER_MM:.2g} um RMS"
        )
    if seat.n_without_form:
        texts.append(
            f"{seat.n_without_form} touches lie where the map knows no form error: none was taken off them"
        )
    return [*texts, *(f"touches: {note}" for note in seat.notes)]


def result(seat: Seat | None, costs: Sequence[Sensitivity]) -> dict[str, Any]:
    """Return the part of the result of `compensate` that tells of the part on the grinder."""
    return {
        "seat": None
        if seat is None
        else {
            "grinder_from_part": [list(row) for row in seat.grinder_from_part],
            "n_touches": seat.n,
            "rms_um": seat.rms_mm * UM_PER_MM,
            "expanded_u_edge_um": None if seat.u_edge_mm is None else seat.u_edge_mm * UM_PER_MM,
            "edge_at_mm": list(seat.u_edge_at_mm),
            "held": list(seat.held),
            "moved_by_held_um": seat.moved_by_held_mm * UM_PER_MM,
            "doubtful": [{"number": t.number, "off_um": t.off_mm * UM_PER_MM} for t in seat.doubtful],
        },
        "remount": [
            {
                "motion": one.motion,
                "unit": one.unit,
                "pv_um": one.pv_um,
                "rms_um": one.rms_um,
                "max_um": one.max_um,
                "max_at_mm": list(one.at_mm),
            }
            for one in costs
        ],
    }


def details(costs: Sequence[Sensitivity]) -> list[tuple[str, str]]:
    """Return the table of what a part that sits wrongly does to the map."""
    rows = [
        (
            "if it sits wrongly",
            "um of deviation for each um or arcsec, about the middle; a best fit hides it",
        )
    ]
    for one in costs:
        x, y = one.at_mm
        rows.append(
            (
                "",
                f"{one.motion:<17} 1 {one.unit:<6} PV {one.pv_um:.3f}  RMS {one.rms_um:.3f}  most "
                f"{one.max_um:+.3f} at ({x:+.0f}, {y:+.0f}) mm",
            )
        )
    return rows
