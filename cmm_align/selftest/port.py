"""The way from the controller's port: a recording is replayed through pySerial, byte for byte.

The recording is made here, number by number; every point must come back as printed, none more and none less,
however the bytes are cut. A line that was cut off at the end must not become a point.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

import numpy as np

from cmm_align.selftest.finding import Finding
from cmm_align.selftest.parts import TIP_RADIUS_MM, even_places, feet_of, laid
from cmm_align.units import NM_PER_MM
from cmm_align.virtual.window import window

_POINTS: Final = 1500
_DECIMALS: Final = 6


def replayed() -> list[Finding]:
    """Capture a recording and compare its points with the printed ones."""
    from cmm_align.device.capture import capture_points

    feet, normals = feet_of(window(), *even_places(_POINTS, 48.0, 28.0))
    printed = np.round(laid().apply(feet + TIP_RADIUS_MM * normals), _DECIMALS)
    lines = [",".join(f"{value:.{_DECIMALS}f}" for value in point) + "\r\n" for point in printed]
    with tempfile.TemporaryDirectory(prefix="cmm-align-selftest-") as folder:
        recording = Path(folder) / "dump.txt"
        recording.write_bytes("".join(lines).encode("ascii") + b"1.0,2.0")
        captured = capture_points(f"replay://{recording.as_posix()}")
    found = captured.points.points_mm
    wrong = abs(len(found) - _POINTS)
    common = min(len(found), _POINTS)
    error = float(np.abs(found[:common] - printed[:common]).max()) * NM_PER_MM
    return [
        Finding("points too many or too few", float(wrong), "points", _POINTS),
        Finding("coordinates against the print", error, "nm", 3 * _POINTS),
    ]
