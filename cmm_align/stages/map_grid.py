"""Where the deviations of a map lie, and the grid that is laid over them."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import GeometryError, UsageError
from cmm_align.model import Alignment, DeviationMap
from cmm_align.numerics.chunked import in_threads
from cmm_align.numerics.local_regression import reach_of
from cmm_align.numerics.point_density import filled_box
from cmm_align.surfaces.protocol import Array

STEPS_PER_BOX: Final = 1.2
"""Grid step over the smallest box that is filled almost everywhere: the window of three steps then
holds three scan lines or more, or 30 points at random."""


FEWEST_APART: Final = 9
"""With fewer points apart nothing is said of their distance."""


class Places(NamedTuple):
    """Deviations with the places of their foot points, each of shape (n,)."""

    x_mm: Array
    y_mm: Array
    deviation_mm: Array
    rows: NDArray[np.intp]
    """Their rows among the points of the alignment."""


def places_of(alignment: Alignment) -> Places:
    """Return the deviations that count at their foot points, in frame `surface`.

    Raises
    ------
    GeometryError
        If there is none.
    """
    judged = alignment.judged & np.isfinite(alignment.deviation_mm)
    if not judged.any():
        raise GeometryError(
            f"none of the {len(judged)} points has a deviation",
            expected="points over the nominal's aperture",
            remedy="look at the alignment with cmm-align info",
        )
    rows = np.flatnonzero(judged)
    x, y, deviation = (np.empty(len(rows)) for _ in range(3))

    def place(part: slice) -> None:
        row = rows[part]
        deviation[part] = alignment.deviation_mm[row]
        foot_part = alignment.contact_part_mm[row] - deviation[part, None] * alignment.normals[row]
        x[part], y[part], _ = alignment.nominal.surface_from_part.apply(foot_part).T

    in_threads(place, len(rows))
    return Places(x, y, deviation, rows)


def step_of(places: Places, config: ErrorMapConfig) -> float:
    """Return the grid step, mm: as asked for, or the finest that the points carry.

    Raises
    ------
    GeometryError
        If the places span no area.
    UsageError
        If the spacing asked for gives more than `config.max_nodes` along the longer side.
    """
    sides = sorted((float(np.ptp(places.x_mm)), float(np.ptp(places.y_mm))))
    if sides[0] <= 1e-9 * sides[1] or sides[1] == 0.0:
        raise GeometryError(
            f"the {len(places.x_mm)} points span {sides[1]:.4g} x {sides[0]:.4g} mm",
            expected="points spread over an area",
            remedy="measure more than one line",
        )
    finest = sides[1] / (config.max_nodes - 1)
    if config.spacing_mm > 0.0:
        if config.spacing_mm < finest:
            raise UsageError(
                f"a spacing of {config.spacing_mm:.4g} mm over {sides[1]:.4g} mm",
                expected=f"at most {config.max_nodes} nodes along the longer side",
                remedy=f"give at least {finest:.4g} mm, or raise max_nodes",
            )
        return config.spacing_mm
    coarsest = max(0.5 * sides[0], finest)
    box = filled_box(places.x_mm, places.y_mm, finest / STEPS_PER_BOX, coarsest / STEPS_PER_BOX)
    return max(finest, STEPS_PER_BOX * box)


def axis_over(places_mm: Array, step_mm: float, *, exact: bool) -> Array:
    """Return at least two nodes evenly about the middle of the extent of the places.

    Parameters
    ----------
    places_mm : ndarray, shape (n,), mm
        Along one axis of frame `surface`.
    step_mm : float
    exact : bool
        Whether the step is kept.

    Returns
    -------
    ndarray, shape (m,), mm

    Notes
    -----
    With `exact` the step is kept and the outer nodes lie up to half a step inside the extent. Without
    it the step shrinks a little so that they lie a quarter of a step inside: on the ends, where PV is
    often found, the border would weigh too much in the RMS; half a step inside, PV would be lost.
    """
    low, high = float(places_mm.min()), float(places_mm.max())
    steps = (high - low) / step_mm
    if exact:
        n = max(int(steps + 1e-9) + 1, 2)
        half = 0.5 * (n - 1) * step_mm
        middle = 0.5 * (low + high)
        nodes: Array = np.linspace(middle - half, middle + half, n)
        return nodes
    n = max(int(np.ceil(steps - 0.5 - 1e-9)) + 1, 2)
    inset = 0.25 * (high - low) / (n - 0.5)
    return np.asarray(np.linspace(low + inset, high - inset, n), dtype=np.float64)


def points_apart(deviation_map: DeviationMap) -> tuple[int, float]:
    """Return how many points lie too far apart for the grid, and the spacing, mm, that would take them in.

    Those are points whose nearest node is unknown for want of others around it. The spacing is 0 where there
    are too few to tell one.
    """
    m = deviation_map
    places = places_of(m.alignment)
    index = []
    for nodes, p in ((m.y_mm, places.y_mm), (m.x_mm, places.x_mm)):
        step = (p - nodes[0]) / (nodes[1] - nodes[0])
        index.append(np.clip(np.rint(step), 0, len(nodes) - 1).astype(np.intp))
    apart = np.isnan(m.deviation_mm[index[0], index[1]])
    x, y = places.x_mm[apart], places.y_mm[apart]
    if len(x) < FEWEST_APART or min(np.ptp(x), np.ptp(y)) <= m.spacing_mm:
        return len(x), 0.0
    largest = 0.5 * float(min(np.ptp(x), np.ptp(y)))
    return len(x), STEPS_PER_BOX * filled_box(x, y, m.spacing_mm / STEPS_PER_BOX, largest)


def method_in_words(config: ErrorMapConfig) -> str:
    """Return in words how a node comes of the points around it."""
    width = 2 * reach_of(config.window) + 1
    return (
        f"local quadratic (a plane where points are few) by least squares over {width} x {width} steps; "
        "known where nothing is extrapolated: points within half a step or on both sides, leverage at most 1"
    )
