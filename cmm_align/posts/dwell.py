"""Hand-over to dwell-time codes of ion-beam and MRF figuring: what to take off, on a grid in metres.

A MATLAB file (version 5), which MATLAB and Python (`scipy.io.loadmat`) read, with the names and the order
that the height-based RIFTA takes (its public code, TWANG006/RIFTA, `rifta_height`):

- ``X``, ``Y`` (m): rows from the largest y down, columns with ascending x, frame `surface`;
- ``Z_to_remove`` (m): along the normal, not negative; correction = ``piston_m - Z_to_remove``;
- ``ca_range``: rows ``v_s`` to ``v_e`` and columns ``u_s`` to ``u_e``, counted from 1, of the box round the
  aperture; ``ca_box_m``: the same as x_min, x_max, y_min, y_max;
- ``inside``: 1 on the part, 0 where the field is continued; ``pixel_m``, ``footprint_radius_m``.

Pixels are square; where the steps of the map differ, a spline takes the field to the smaller one. Past the
aperture the field is continued as a membrane, at least by the radius of the tool's footprint. It
holds the correction of this pass alone: such a process works on the part as it is.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from cmm_align.errors import MalformedInputError, UsageError
from cmm_align.model import Correction
from cmm_align.numerics.grid_field import continued
from cmm_align.posts.between import Between, inside_known
from cmm_align.posts.job import ExportJob
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import mm_per

HEAD: Final = b"MATLAB 5.0 MAT-file, cmm-align dwell grid v1"
"""What such a file starts with."""

_HEAD_BYTES: Final = 116


@dataclass(frozen=True, slots=True)
class Removal:
    """What a dwell-time code is told, back in mm and in our order.

    Attributes
    ----------
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`
        Ascending, of the extended grid.
    removal_mm : ndarray, shape (ny, nx), mm
        Along the normal, not negative.
    inside : ndarray of bool, shape (ny, nx)
        On the part.
    correction_mm : ndarray, shape (ny, nx), mm
        ``piston - removal``; NaN off the part.
    box_mm : tuple of float
        x_min, x_max, y_min, y_max of the clear aperture.
    footprint_radius_mm : float
    """

    x_mm: Array
    y_mm: Array
    removal_mm: Array
    inside: Mask
    correction_mm: Array
    box_mm: tuple[float, float, float, float]
    footprint_radius_mm: float


def blocks(job: ExportJob) -> Iterator[bytes]:
    """Give the file, in one piece.

    Raises
    ------
    UsageError
        If the radius of the footprint is not known.
    """
    from scipy.io import savemat  # slow to import

    correction, radius = job.correction, job.config.footprint_radius_mm
    if radius == 0.0:
        raise UsageError("a dwell grid needs the footprint", remedy="give --footprint-radius")
    dx, x_mm, y_mm, on_part = _square(correction)
    more = int(np.ceil(radius / dx - 1e-9))
    x = x_mm[0] + dx * np.arange(-more, len(x_mm) + more)
    y = y_mm[0] + dx * np.arange(-more, len(y_mm) + more)
    field = continued(np.pad(on_part, more, constant_values=np.nan))
    inside = np.pad(np.isfinite(on_part), more)
    piston = float(field.max())
    iy, ix = np.nonzero(inside)
    m = 1.0 / mm_per("m")
    xg, yg = np.meshgrid(x * m, y[::-1] * m)
    stream = io.BytesIO()
    savemat(
        stream,  # type: ignore[arg-type]  # an open file will do
        {
            "X": xg,
            "Y": yg,
            "Z_to_remove": ((piston - field) * m)[::-1],
            "inside": inside[::-1].astype(np.uint8),
            "ca_range": {
                "v_s": float(len(y) - iy.max()),
                "v_e": float(len(y) - iy.min()),
                "u_s": float(ix.min() + 1),
                "u_e": float(ix.max() + 1),
            },
            "ca_box_m": np.array([x[ix.min()], x[ix.max()], y[iy.min()], y[iy.max()]]) * m,
            "pixel_m": dx * m,
            "piston_m": piston * m,
            "footprint_radius_m": radius * m,
        },
    )
    yield HEAD.ljust(_HEAD_BYTES) + stream.getvalue()[_HEAD_BYTES:]  # without the time of day


def _square(correction: Correction) -> tuple[float, Array, Array, Array]:
    """Return the step, the places along x and y, mm, and the correction on square pixels, NaN off the part.

    Where the steps of the map differ, a spline takes the field to the smaller one.
    """
    x_mm, y_mm, field = correction.x_mm, correction.y_mm, correction.correction_mm
    dx, dy = (float(nodes[1] - nodes[0]) for nodes in (x_mm, y_mm))
    if abs(dx - dy) <= 1e-9 * dx:
        return dx, x_mm, y_mm, field
    step = min(dx, dy)
    x, y = (a[0] + step * np.arange(int((a[-1] - a[0]) / step + 1e-9) + 1) for a in (x_mm, y_mm))
    xg, yg = (g.ravel() for g in np.meshgrid(x, y))
    inside = inside_known(x_mm, y_mm, np.isfinite(field), xg, yg)
    values = Between(x_mm, y_mm, field).jet(xg, yg).z
    return step, x, y, np.where(inside, values, np.nan).reshape(len(y), len(x))


def read(raw: bytes, where: str) -> Removal:
    """Return what stands in such a file.

    Raises
    ------
    MalformedInputError
        If it is no such file, or its numbers are not what the layout says.
    """
    from scipy.io import loadmat  # slow to import
    from scipy.io.matlab import MatReadError

    try:
        found = loadmat(io.BytesIO(raw), squeeze_me=True)  # type: ignore[arg-type]  # an open file will do
        x, y = (np.asarray(found[name], dtype=np.float64) for name in ("X", "Y"))
        removal = np.asarray(found["Z_to_remove"], dtype=np.float64)
        inside = np.asarray(found["inside"]) == 1
        piston, radius = float(found["piston_m"]), float(found["footprint_radius_m"])
        x0, x1, y0, y1 = (float(v) for v in found["ca_box_m"])
    except (ValueError, TypeError, KeyError, OSError, NotImplementedError, MatReadError) as error:
        raise MalformedInputError(f"no dwell grid ({' '.join(str(error).split())})", where=where) from None
    ordered = removal.shape == x.shape == y.shape == inside.shape and removal.ndim == 2
    if not ordered or not np.isfinite(removal).all() or float(removal.min()) < 0.0 or not inside.any():
        raise MalformedInputError(
            "no dwell grid", where=where, expected="X, Y, Z_to_remove >= 0 of one shape"
        )
    mm = mm_per("m")
    on_part = np.where(inside, (piston - removal) * mm, np.nan)
    return Removal(
        x_mm=x[0] * mm,
        y_mm=y[::-1, 0] * mm,
        removal_mm=removal[::-1] * mm,
        inside=inside[::-1],
        correction_mm=on_part[::-1],
        box_mm=(x0 * mm, x1 * mm, y0 * mm, y1 * mm),
        footprint_radius_mm=radius * mm,
    )
