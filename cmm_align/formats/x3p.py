"""A deviation map as X3P (ISO 25178-72), written by x3pio (extra `x3p`): heights are deviations along z."""

from __future__ import annotations

import importlib.util
from datetime import datetime
from pathlib import Path

from cmm_align import __version__
from cmm_align.errors import UsageError
from cmm_align.model import DeviationMap
from cmm_align.units import M_PER_MM


def check_available(where: str) -> None:
    """Refuse if x3pio is not there.

    Raises
    ------
    UsageError
        With the command that installs it.
    """
    if importlib.util.find_spec("x3pio") is None:
        raise UsageError(
            "X3P needs x3pio, which is not installed", where=where, remedy="pip install 'cmm-align[x3p]'"
        )


def write(deviation_map: DeviationMap, path: Path, *, time_utc: str) -> None:
    """Write the deviations along +z of frame `surface` on all nodes of a map, in metres; unknown is NaN.

    Parameters
    ----------
    deviation_map : DeviationMap
    path : Path
        Replaced if it is there.
    time_utc : str
        ISO 8601.

    Raises
    ------
    UsageError
        If x3pio is not installed.
    """
    check_available(str(path))
    import x3pio

    m = deviation_map
    made = datetime.fromisoformat(time_utc)
    metadata = x3pio.Metadata.for_software("cmm-align", __version__, date=made)
    side = "+z" if m.alignment.nominal.side > 0 else "-z"
    metadata.comment = (
        "deviation from nominal along +z of frame surface (sag deviation, not along the normal); probe on "
        f"the {side} side: {'+' if side == '+z' else '-'} = excess material"
    )
    x3pio.write(
        str(path),
        m.sag_deviation_mm * M_PER_MM,
        x_scale=float(m.x_mm[1] - m.x_mm[0]) * M_PER_MM,
        y_scale=float(m.y_mm[1] - m.y_mm[0]) * M_PER_MM,
        metadata=metadata,
        placement=x3pio.Placement(offset=(float(m.x_mm[0]) * M_PER_MM, float(m.y_mm[0]) * M_PER_MM, 0.0)),
        coordinate_system=x3pio.CoordinateSystem.VIEW,
    )
