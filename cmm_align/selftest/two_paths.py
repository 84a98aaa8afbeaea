"""The same deviation by two paths that share no surface.

Path one: the foot point on the nominal, minus the tip radius. Path two: the distance from the smooth surface
through the points of the equidistant net. And the nominal once as its formula, once as a spline through its
points on a grid of 0.5 mm: two surfaces that know nothing of each other.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.model import PointKind, PointSet
from cmm_align.selftest.finding import Finding
from cmm_align.selftest.parts import TIP_RADIUS_MM, even_places, feet_of, laid, measured
from cmm_align.stages.align import align
from cmm_align.stages.offset import offset
from cmm_align.units import NM_PER_MM
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.window import window, window_grid

_POINTS: Final = 4000
_HALF_MM: Final = (50.0, 30.0)
_SPACING_MM: Final = 0.5


def both_paths() -> list[Finding]:
    """Measure a part with form error by both paths, on both nominals."""
    surface = window()
    x, y = even_places(_POINTS, *_HALF_MM)
    feet, normals = feet_of(surface, x, y)
    tips = feet + (TIP_RADIUS_MM + form_error(surface).at(x, y))[:, None] * normals
    cloud = measured(tips, laid())
    grid = PointSet.of(window_grid(_SPACING_MM), kind=PointKind.NOMINAL, frame="part", source="self-test")
    formula, spline = (align(cloud, offset(source, TIP_RADIUS_MM)) for source in (surface, grid))
    apart = float(np.abs(formula.deviation_mm - spline.deviation_mm).max()) * NM_PER_MM
    return [
        Finding("nominal less radius, equidistant", formula.report.two_path_difference_nm, "nm", _POINTS),
        Finding("the same on a spline", spline.report.two_path_difference_nm, "nm", _POINTS),
        Finding("formula, spline through its points", apart, "nm", _POINTS),
    ]
