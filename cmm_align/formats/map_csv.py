"""A deviation map as text: one line for each known node, with commas, under a header that says all.

Read back, a deviation is right to 0.05 nm and a place to 0.5 nm.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from cmm_align.model import DeviationMap
from cmm_align.units import UM_PER_MM

COLUMNS: Final = ("x_mm", "y_mm", "deviation_um", "sag_deviation_um", "u_um")
_FORMATS: Final = ("%.6f", "%.6f", "%.4f", "%.4f", "%.4f")


def write(deviation_map: DeviationMap, path: Path) -> None:
    """Write the known nodes of a map.

    Parameters
    ----------
    deviation_map : DeviationMap
    path : Path
        Replaced if it is there.

    Notes
    -----
    ``deviation_um`` is along the normal, ``sag_deviation_um`` along +z of frame `surface`, ``u_um`` the
    standard uncertainty of the first.
    """
    m = deviation_map
    known = np.isfinite(m.deviation_mm)
    x_grid, y_grid = np.meshgrid(m.x_mm, m.y_mm)
    columns = [
        x_grid[known],
        y_grid[known],
        *(field[known] * UM_PER_MM for field in (m.deviation_mm, m.sag_deviation_mm, m.sigma_mm)),
    ]
    side = "+z" if m.alignment.nominal.side > 0 else "-z"
    header = [
        f"# cmm-align map v1; frame=surface; probe on the {side} side",
        "# deviation_um: along the outward normal, + = excess material; sag_deviation_um: the same along +z",
        "# u_um: standard uncertainty of deviation_um; unknown nodes are left out",
        f"# {len(columns[0])} of {known.size} nodes, {m.spacing_mm:.6g} mm apart; {m.method}",
        ",".join(COLUMNS),
    ]
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write("\n".join(header) + "\n")
        np.savetxt(stream, np.stack(columns, axis=1), fmt=_FORMATS, delimiter=",")
