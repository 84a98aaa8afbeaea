"""Where a part sits on the grinder: the pose from a few touches there, and what is not known of it.

The touches are aligned as any measurement is. The form error that the map knows is then taken off them along
the normals, and they are aligned once more: what is left is the error of touching, not that of the part.

With J the rows ``[(p - c) x n, n]`` of the touches, e what is left, k motions told and ``H = J (J^T J)^+
J^T``, the path is known along the normal to ``u = t s sqrt(j (J^T J)^+ j^T)``, ``s^2 = e.e / (n - k)``, t of
Student with ``n - k`` degrees of freedom: few touches are few. A touch is doubtful if its externally
studentised residual is out of the 95 % of the largest of n (R. D. Cook and S. Weisberg, "Residuals and
Influence in Regression", 1982, section 2.2.1; Bonferroni); it then lies ``e / (1 - h)`` off what the others
say.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from cmm_align.config import AlignConfig
from cmm_align.errors import GeometryError, NumericsError
from cmm_align.model import Alignment, Correction, DeviationMap, DoubtfulTouch, Nominal, PointSet, Seat
from cmm_align.numerics.grid_field import interpolated
from cmm_align.pose import Pose
from cmm_align.stages.align import align
from cmm_align.stages.correction_grid import gradient
from cmm_align.stages.remount import spread
from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.units import UM_PER_MM

FEWEST: Final = 7
"""Touches: six motions, and one to judge by."""
TOUCHES: Final = AlignConfig(outliers="keep", trust_me=True)
LEAST_MM: Final = 1e-4
"""No touch repeats better than this; what is less is never doubtful."""
MATTERS: Final = 0.03
"""Share of the corrections by which they may change with 1 mm of a motion that is not known."""
FREE: Final = 1e-8
"""Share of the strongest motion below which one is free (of the scaled normal matrix)."""
_TAIL: Final = 0.025
_NAMED: Final = 6
"""Touches that a message counts up."""


def seat_of(
    touches: PointSet, tip_radius_mm: float, deviation_map: DeviationMap, correction: Correction
) -> Seat:
    """Return how a part sits on the grinder.

    Parameters
    ----------
    touches : PointSet
        Frame of the grinder; tip centres, or contact points if their kind says so.
    tip_radius_mm : float
        Of the tip that touched.
    deviation_map : DeviationMap
        Of the part as it is now.
    correction : Correction
        To be ground; decides whether motions that are not known matter.

    Raises
    ------
    GeometryError
        If there are too few touches, or they lie so that a motion is free which the part would hold.
    NumericsError
        If they do not fit the part.
    """
    if len(touches) < FEWEST:
        raise GeometryError(
            f"{len(touches)} touches",
            where=touches.source,
            expected=f"{FEWEST} or more, spread over the part (9 to 15 also show a bad one)",
        )
    nominal = replace(deviation_map.alignment.nominal, tip_radius_mm=tip_radius_mm)
    laid = _aligned(touches, nominal, None)
    form = _form_mm(laid, deviation_map)
    back = laid.part_from_machine.inverse()
    bare = touches.points_mm - np.nan_to_num(form)[:, None] * back.rotate(laid.normals)
    laid = _aligned(replace(touches, points_mm=bare), nominal, laid.part_from_machine)

    part = nominal.surface_from_part.inverse()
    foot = laid.contact_part_mm - laid.deviation_mm[:, None] * laid.normals
    centre = foot.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((foot - centre) ** 2, axis=1))))
    rows = _rows(foot, laid.normals, centre, size)
    values, motions = np.linalg.eigh(rows.T @ rows)
    told = values > FREE * values[-1]
    root = motions[:, told] / np.sqrt(values[told])
    surface, normals = spread(nominal)
    there = _rows(part.apply(surface), part.rotate(normals), centre, size) @ root
    u_edge, worst = _edge(laid.deviation_mm, int(told.sum()), there)
    held = tuple(laid.report.unobservable)
    free = motions[:, ~told] if held else motions[:, :0]
    return Seat(
        grinder_from_part=tuple(tuple(row) for row in laid.part_from_machine.inverse().matrix().tolist()),
        n=len(touches),
        rms_mm=float(np.sqrt(np.mean(laid.deviation_mm**2))),
        u_edge_mm=u_edge,
        u_edge_at_mm=(float(surface[worst, 0]), float(surface[worst, 1])),
        held=held,
        moved_by_held_mm=_moved_mm(correction, free, centre, size),
        doubtful=_doubtful(laid.deviation_mm, rows @ root),
        n_without_form=int(np.count_nonzero(np.isnan(form))),
        notes=tuple(laid.report.warnings),
    )


def refuse_unknown(seat: Seat, correction: Correction, where: str) -> None:
    """Refuse a seat that leaves a motion free along which the corrections change.

    Raises
    ------
    GeometryError
        With the motion, and by how much.
    """
    total = correction.total_correction_mm
    size = float(np.sqrt(np.nanmean(total**2)))
    if not seat.held or seat.moved_by_held_mm <= MATTERS * size:
        return
    raise GeometryError(
        f"the touches cannot tell {', '.join(seat.held)}: for each mm of it at the edge the corrections are "
        f"wrong by {seat.moved_by_held_mm * UM_PER_MM:.3g} um RMS of {size * UM_PER_MM:.3g} um",
        where=where,
        expected="touches that hold every motion that matters",
        remedy="touch a flat or a mark too; if the part is clocked to the grinder's axes as it was to those "
        "of the drawing, --trust-me goes on",
    )


def placed(correction: Correction, seat: Seat) -> Correction:
    """Return a correction as it lies on the grinder: what is written from it is in the grinder's frame."""
    pose = Pose.from_matrix(np.array(seat.grinder_from_part), "grinder", "part")
    part = correction.nominal.surface_from_part
    posed = part @ replace(pose.inverse(), target=part.source)
    return replace(correction, nominal=replace(correction.nominal, surface_from_part=posed))


def _aligned(touches: PointSet, nominal: Nominal, start: Pose | None) -> Alignment:
    """Return the touches laid on the nominal."""
    try:
        laid = align(touches, nominal, TOUCHES, start=start)
    except NumericsError as failure:
        raise NumericsError(
            f"the touches do not fit the part: {failure.what}",
            where=touches.source,
            remedy="check the radius of the tip and the axes; lay the part nearly as it lies in its drawing, "
            "or touch more points",
        ) from None
    if np.isnan(laid.deviation_mm).any():
        beside = (np.flatnonzero(np.isnan(laid.deviation_mm)) + 1).tolist()
        named = ", ".join(str(k) for k in beside[:_NAMED])
        more = f" and {len(beside) - _NAMED} more" if len(beside) > _NAMED else ""
        raise NumericsError(
            f"beside the part: touch {named}{more}",
            where=touches.source,
            remedy="leave out what lies beside it, or touch again",
        )
    return laid


def _form_mm(laid: Alignment, deviation_map: DeviationMap) -> Array:
    """Return the form error of the map at the touches, shape (n,), NaN where it knows none."""
    m = deviation_map
    foot = laid.contact_part_mm - laid.deviation_mm[:, None] * laid.normals
    x, y, _ = laid.nominal.surface_from_part.apply(foot).T
    return interpolated(m.x_mm, m.y_mm, m.deviation_mm, x, y)


def _rows(points: Array, normals: Array, centre: Array, size: float) -> Array:
    return np.hstack([np.cross((points - centre) / size, normals), normals])


def _edge(e: Array, k: int, there: Array) -> tuple[float | None, int]:
    """Return the largest 95 % uncertainty along the normal, and at which place."""
    from scipy.special import stdtrit

    spread_of = np.sqrt(np.einsum("ni,ni->n", there, there))
    worst = int(np.argmax(spread_of))
    spare = len(e) - k
    if spare < 1:
        return None, worst
    s = max(float(np.sqrt(e @ e / spare)), LEAST_MM)
    return float(stdtrit(spare, 1.0 - _TAIL)) * s * float(spread_of[worst]), worst


def _doubtful(e: Array, whitened: Array) -> tuple[DoubtfulTouch, ...]:
    """Return the touches that the others contradict, worst first."""
    from scipy.special import stdtrit

    n, k = whitened.shape
    spare = n - k - 1
    if spare < 1:
        return ()
    left = np.maximum(1.0 - np.einsum("ni,ni->n", whitened, whitened), 1e-9)
    s2 = np.maximum((e @ e - e**2 / left) / spare, LEAST_MM**2)
    t = np.abs(e) / np.sqrt(s2 * left)
    bound = float(stdtrit(spare, 1.0 - _TAIL / n))
    return tuple(DoubtfulTouch(int(i) + 1, float(e[i] / left[i])) for i in np.argsort(-t) if t[i] > bound)


def _moved_mm(correction: Correction, free: Array, centre: Array, size: float) -> float:
    """Return by how much 1 mm of the free motions at the edge changes the corrections, RMS."""
    if not free.shape[1]:
        return 0.0
    c, nominal = correction, correction.nominal
    x, y = np.meshgrid(c.x_mm, c.y_mm)
    inside = np.isfinite(c.total_correction_mm)
    jet = Jet(*(a.reshape(x.shape) for a in nominal.surface.jet(x.ravel(), y.ravel())))
    along_y, along_x = gradient(c.total_correction_mm, c.x_mm, c.y_mm)
    part = nominal.surface_from_part
    points = part.inverse().apply(np.column_stack([x[inside], y[inside], jet.z[inside]]))
    square = 0.0
    for motion in free.T:
        way = part.rotate(np.cross(motion[:3] / size, points - centre) + motion[3:])
        way = way / float(np.linalg.norm(way, axis=1).max())
        change = way[:, 0] * along_x[inside] + way[:, 1] * along_y[inside]
        square += float(np.nanmean(change**2))
    return float(np.sqrt(square))
