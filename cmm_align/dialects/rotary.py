"""The rotary table, the fourth axis: points of one set are taken at one place of it."""

from __future__ import annotations


def turned_away(here_deg: float, first_deg: float, band_deg: float) -> str:
    """Return why a point at a place of the table does not belong to the first one, or nothing if it does.

    Parameters
    ----------
    here_deg, first_deg : float
        Places of the table; full turns do not count.
    band_deg : float
        Largest difference that is noise of the readout.
    """
    apart_deg = abs((here_deg - first_deg + 180.0) % 360.0 - 180.0)
    if apart_deg <= band_deg:
        return ""
    return (
        f"the rotary table stands at {here_deg:g} deg, at the first point it stood at {first_deg:g}: "
        f"the part has moved (rotary_band_deg = {band_deg:g})"
    )
