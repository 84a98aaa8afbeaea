"""What rigid motions change in the deviations: the part of a form error that a best fit hides."""

from __future__ import annotations

import numpy as np

from cmm_align.config import AlignConfig
from cmm_align.model import Alignment
from cmm_align.numerics.observability import spectrum
from cmm_align.surfaces.protocol import Array


def motion_columns(alignment: Alignment, points_mm: Array, normals: Array) -> Array:
    """Return a column for each motion that the surface can tell, best told first.

    A motion that it cannot tell is no column: it would take away shape. One that the fit held on request is
    one like the others.

    Parameters
    ----------
    alignment : Alignment
        Names the motions that its fit could not tell.
    points_mm, normals : ndarray, shape (n, 3)
        Places on the nominal, any frame.

    Returns
    -------
    ndarray, shape (n, up to 6)
        ``[(p - c) x n / length, n]`` for unit motions, mm.
    """
    arm = points_mm - points_mm.mean(axis=0)
    length = float(np.sqrt(np.mean(np.sum(arm**2, axis=1)))) or 1.0
    rows = np.hstack([np.cross(arm, normals) / length, normals])
    spectral = spectrum(rows.T @ rows / len(rows), AlignConfig().min_observability)
    named = np.arange(6) < len(alignment.report.unobservable)
    kept = spectral.motions[:, ~(spectral.free | named)]
    return np.asarray(rows @ kept[:, ::-1], dtype=np.float64)
