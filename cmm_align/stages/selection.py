"""Which points steer a fit, and why the others do not.

A point counts if it lies on the nominal, in the fit region, is no outlier, and if the ball really touched the
nominal there: not in the band along the border where an edge that stands proud is touched first, nor where
the ball does not reach the ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.model import Nominal, PointStatus
from cmm_align.numerics.foot_point import Feet
from cmm_align.numerics.linearisation import Evaluation
from cmm_align.numerics.outliers import OutlierRule, outlier_rule, outliers
from cmm_align.surfaces.envelope import InsideRaster, Reach, edge_band_mm, near_edge
from cmm_align.surfaces.geometry import principal_curvatures
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.surfaces.region import Region

CLEAR_OF_FLAGGED: Final = 2.0
"""Feet farther than this from any node that is not reached, in spacings, need no closer look."""


@dataclass(frozen=True, slots=True)
class Selection:
    """A frozen rule that says which points count; called with an evaluation it answers.

    It judges by the places of the feet alone, so that a sample and all points are treated alike.
    """

    nominal: Nominal
    radius_mm: float
    """Tip radius; 0 for contact points, which have no edge band and reach everywhere."""
    edge_proud_mm: float
    """Height of an edge that must not be touched first; 0 for no edge band."""
    fit_region: Region | None = None
    rule: OutlierRule | None = None
    raster: InsideRaster | None = None
    """Of the nominal's surface, so that it is not made for every look."""

    def __call__(self, now: Evaluation) -> Mask:
        """Return which points count, shape (n,)."""
        counts = now.inside.copy()
        if self.rule is not None:
            counts &= ~outliers(self.rule, now.feet.x_mm, now.feet.y_mm, now.feet.distance_mm)
        if self.fit_region is not None:
            counts[counts] = self.fit_region.contains(now.feet.x_mm[counts], now.feet.y_mm[counts])
        pick = np.flatnonzero(counts)
        counts[pick] = reach_of(self, now.feet.x_mm[pick], now.feet.y_mm[pick]) == Reach.REACHED
        return counts


def reach_of(selection: Selection, x_mm: Array, y_mm: Array) -> NDArray[np.uint8]:
    """Return what the ball does at places of the nominal, as `surfaces.envelope.Reach`, shape (n,).

    Parameters
    ----------
    selection : Selection
    x_mm, y_mm : ndarray, shape (n,), mm, frame `surface`
    """
    code = np.zeros(len(x_mm), dtype=np.uint8)
    if selection.radius_mm == 0.0 or len(x_mm) == 0:
        return code
    code[_on_the_edge(selection, x_mm, y_mm)] = Reach.EDGE
    net = selection.nominal.equidistant
    if net is not None and net.reach is not None:
        held = net.reach > Reach.EDGE
        if held.any():
            nodes = selection.nominal.surface_from_part.apply(net.nominal_points_mm)[:, :2]
            code = np.maximum(code, _nearest(nodes, net.reach, held, x_mm, y_mm))
    return code


def _on_the_edge(selection: Selection, x_mm: Array, y_mm: Array) -> Mask:
    """Return which places lie in the edge band, which is wider where the surface is hollow."""
    nominal, radius, proud = selection.nominal, selection.radius_mm, selection.edge_proud_mm
    tight = None if nominal.quality is None else nominal.quality.min_concave_radius_mm
    widest = edge_band_mm(radius, np.array([0.0 if tight is None else 1.0 / tight]), proud)
    near = near_edge(nominal.surface, x_mm, y_mm, np.broadcast_to(widest, x_mm.shape), selection.raster)
    if tight is not None:
        pick = np.flatnonzero(near)
        x, y = x_mm[pick], y_mm[pick]
        most = principal_curvatures(nominal.surface.jet(x, y), nominal.side).most
        near[pick] = near_edge(nominal.surface, x, y, edge_band_mm(radius, most, proud), selection.raster)
    return near


def _nearest(
    nodes_mm: Array, reach: NDArray[np.uint8], held: Mask, x_mm: Array, y_mm: Array
) -> NDArray[np.uint8]:
    """Return the code of the nearest node, 0 where that is reached."""
    from scipy.spatial import cKDTree  # slow to import, and few parts need it

    places = np.column_stack([x_mm, y_mm])
    spacing = np.sqrt(float(np.prod(np.ptp(nodes_mm, axis=0))) / len(nodes_mm))
    gap, _ = cKDTree(nodes_mm[held]).query(places, distance_upper_bound=CLEAR_OF_FLAGGED * spacing)
    code = np.zeros(len(places), dtype=np.uint8)
    pick = np.flatnonzero(np.isfinite(gap))
    if len(pick):  # the nearest node of these lies no farther off than the one that is held
        margin = 2.0 * CLEAR_OF_FLAGGED * spacing
        low, high = nodes_mm[held].min(axis=0) - margin, nodes_mm[held].max(axis=0) + margin
        around = np.flatnonzero(((nodes_mm >= low) & (nodes_mm <= high)).all(axis=1))
        at = around[cKDTree(nodes_mm[around]).query(places[pick])[1]]
        code[pick] = np.where(held[at], reach[at], 0)
    return code


def status_of(selection: Selection, feet: Feet, inside: Mask, used: Mask) -> NDArray[np.uint8]:
    """Return why each point does or does not steer the fit, as `PointStatus`, shape (n,).

    Parameters
    ----------
    selection : Selection
    feet : Feet
    inside, used : ndarray of bool, shape (n,)
        Which points lie on the nominal, and which of them steered the fit.

    Notes
    -----
    Of several reasons the first is told: outside, not reached, edge, outlier, apart. Points outside the fit
    region are judged among themselves: the fit owes them nothing, they may lie far off together.
    """
    status = np.full(len(inside), int(PointStatus.USED), dtype=np.uint8)
    rest = np.flatnonzero(inside & ~used)
    status[rest] = PointStatus.APART
    if selection.rule is not None:
        apart = np.zeros(len(rest), dtype=bool)
        if selection.fit_region is not None:
            apart = ~selection.fit_region.contains(feet.x_mm[rest], feet.y_mm[rest])
        for group, rule in ((rest[~apart], selection.rule), (rest[apart], None)):
            if len(group):
                x, y, e = (a[group] for a in feet[:3])
                wrong = outliers(rule or outlier_rule(x, y, e, selection.rule.floor_mm), x, y, e)
                status[group[wrong]] = PointStatus.OUTLIER
    code = reach_of(selection, feet.x_mm[rest], feet.y_mm[rest])
    status[rest[code == Reach.EDGE]] = PointStatus.EDGE
    status[rest[code > Reach.EDGE]] = PointStatus.NOT_REACHED
    status[~inside] = PointStatus.OUTSIDE
    return status
