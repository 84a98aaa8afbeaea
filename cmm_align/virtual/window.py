"""The demo window: a steep convex freeform of 102 x 62 mm, slopes to 45 degrees, free of symmetry.

A conic carries the dome; the polynomial on top of it takes every symmetry away, so that all six rigid
motions leave a trace in the deviations. It is given as a prescription, the way a designer hands it on.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.surfaces.prescription import PrescriptionSurface, prescription_from_toml
from cmm_align.surfaces.protocol import Array

WIDTH_MM: Final = 102.0
HEIGHT_MM: Final = 62.0
TIP_RADIUS_MM: Final = 1.5

PRESCRIPTION: Final = f"""\
# The demo window: a convex freeform dome, seen by the probe from +z.
schema = "cmm-align/prescription/1"
units = "mm"

[aperture]
shape = "rectangle"
width = {WIDTH_MM}
height = {HEIGHT_MM}

[[term]]
kind = "conic"
radius = -86.0
conic = -0.55

[[term]]
kind = "xy_polynomial"
normalization_radius = 50.0
coefficients = {{ "1,0" = 1.2, "0,1" = -0.8, "2,0" = 1.9, "1,1" = 1.1, "0,2" = -3.4, \
"3,0" = -1.3, "2,1" = 1.6, "1,2" = -0.9, "0,3" = 0.7, "4,0" = -0.8, "2,2" = -0.6, "3,1" = 0.5 }}
"""


def window() -> PrescriptionSurface:
    """Return the surface of the demo window, frame `part`, probe on its +z side."""
    return prescription_from_toml(PRESCRIPTION, where="the demo window")


def window_grid(spacing_mm: float) -> Array:
    """Return points of the window on a regular grid that ends at the border.

    Parameters
    ----------
    spacing_mm : float
        Wanted distance of the nodes in x and y, mm; the nearest that divides the window is taken.

    Returns
    -------
    ndarray, shape (ny * nx, 3), mm, frame `part`
        Row by row, x fastest.
    """
    nx = round(WIDTH_MM / spacing_mm) + 1
    ny = round(HEIGHT_MM / spacing_mm) + 1
    columns, rows = np.meshgrid(
        np.linspace(-WIDTH_MM / 2, WIDTH_MM / 2, nx), np.linspace(-HEIGHT_MM / 2, HEIGHT_MM / 2, ny)
    )
    x, y = columns.ravel(), rows.ravel()
    return np.column_stack([x, y, window().jet(x, y).z])
