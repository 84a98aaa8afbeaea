"""A deviation map as a MetroPro data file of Zygo (.dat, header format 1, 834 bytes).

Chosen before MetroPro's text because more programs read it. Heights are big-endian int32 in units of
``scale wavelength obliquity / resolution`` with ``scale`` 1/2, a wavelength of 632.8 nm and the resolution of
15 bits: 9.66 pm. From 2147483640 on a pixel holds no data. Pixels are square, the first row is at the top
(+y), and the offsets of fields are those of Zygo's manual OMP-0347 (MetroPro Reference Guide, data format).
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

import numpy as np

from cmm_align.errors import UsageError
from cmm_align.model import DeviationMap
from cmm_align.units import M_PER_MM

MAGIC: Final = bytes.fromhex("881b036f")
_FORMAT: Final = 1
_HEADER_BYTES: Final = 834
_NO_DATA: Final = 2147483640
_SCALE: Final = 0.5
_WAVELENGTH_M: Final = float(np.float32(632.8e-9))
_RESOLUTION: Final = (1, 32768.0)
"""Code of the phase resolution, and its counts in a fringe."""
_SQUARE: Final = 1e-6
"""Steps that differ by less than this share make square pixels."""
_COMMENT: Final = "deviation along +z; + = excess material if probed from +z; first row at +y"


def write(deviation_map: DeviationMap, path: Path, *, time_s: int) -> None:
    """Write the deviations along z of a map, on all its nodes.

    Parameters
    ----------
    deviation_map : DeviationMap
    path : Path
        Replaced if it is there.
    time_s : int
        Time stamp, seconds since 1970, UTC.

    Raises
    ------
    UsageError
        If the steps along x and y differ: the format knows only square pixels.
    """
    m = deviation_map
    step_x, step_y = float(m.x_mm[1] - m.x_mm[0]), float(m.y_mm[1] - m.y_mm[0])
    if abs(step_x - step_y) > _SQUARE * step_x:
        raise UsageError(
            f"steps of {step_x:.6g} x {step_y:.6g} mm",
            where=str(path),
            expected="square pixels: the format knows no others",
            remedy=f"give --spacing {max(step_x, step_y):.3g}mm",
        )
    counts_per_m = _RESOLUTION[1] / (_SCALE * _WAVELENGTH_M)
    sag = m.sag_deviation_mm[::-1]
    counts = np.where(np.isnan(sag), float(_NO_DATA), np.rint(sag * M_PER_MM * counts_per_m))
    ny, nx = sag.shape
    header = bytearray(_HEADER_BYTES)
    for offset, kind, values in (
        (0, "4sHI", (MAGIC, _FORMAT, _HEADER_BYTES)),
        (64, "4HI", (0, 0, nx, ny, 4 * nx * ny)),  # the phase; there is no intensity
        (76, "I", (time_s,)),
        (80, "82s", (_COMMENT.encode("ascii"),)),
        (164, "ff", (_SCALE, _WAVELENGTH_M)),
        (176, "f", (1.0,)),  # obliquity
        (184, "f", (step_x * M_PER_MM,)),
        (218, "H", (_RESOLUTION[0],)),
        (234, "2H", (nx, ny)),  # the camera
        (246, "12s", (b"cmm-align",)),
    ):
        struct.pack_into(f">{kind}", header, offset, *values)
    with path.open("wb") as stream:
        stream.write(header)
        stream.write(counts.astype(">i4").tobytes())
