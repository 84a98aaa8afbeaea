"""Tolerances as they are typed: each with its unit, for one forgotten makes a factor of a thousand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import UnitsError, UsageError
from cmm_align.units import MRAD_PER_RAD, UM_PER_MM, parse_angle_rad, parse_length_mm, states_unit

if TYPE_CHECKING:
    from cmm_align.model import Alignment
    from cmm_align.surfaces.protocol import Array

NAMES: Final = {
    "tolerance_pv_um": ("PV", "um"),
    "tolerance_rms_um": ("RMS", "um"),
    "tolerance_profile_um": ("profile", "um"),
    "tolerance_slope_mrad": ("slope", "mrad"),
}
"""Settings, what they limit, and in which unit."""


class ToleratedLength(click.ParamType[float]):
    """A length above zero whose unit is stated, handed on in um."""

    name = "tolerance"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the length in um."""
        if isinstance(value, float):
            return value
        option = param.opts[0] if param is not None else "the tolerance"
        length_um = _length_um(str(value), option)
        if not length_um > 0.0:
            raise UsageError(f"{option} {value!r}", expected="a tolerance above zero, as 5um")
        return length_um


class ToleratedSlope(click.ParamType[float]):
    """A slope above zero whose unit is stated, handed on in mrad."""

    name = "slope"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the slope in mrad."""
        if isinstance(value, float):
            return value
        option = param.opts[0] if param is not None else "the tolerance"
        if not states_unit(str(value)):
            raise UsageError(
                f"{option} {value!r} has no unit",
                expected=f"{value}mrad, {value}urad or {value}arcmin (mrad is um per mm)",
            )
        try:
            slope = parse_angle_rad(str(value)) * MRAD_PER_RAD
        except UnitsError as error:
            raise UsageError(f"{option}: {error.what}", expected=error.expected) from None
        if not slope > 0.0:
            raise UsageError(f"{option} {value!r}", expected="a tolerance above zero, as 0.5mrad")
        return slope


def with_band(config: ErrorMapConfig, text: str | None) -> tuple[ErrorMapConfig, Path | None]:
    """Return the settings with the band as it was typed, or the table of limits if that is a file.

    Raises
    ------
    UsageError
        If it is neither, a limit has no unit, or the lower one is not below the upper one.
    """
    option = "--tolerance-band"
    if text is None:
        return config, None
    if Path(text).is_file():
        return config, Path(text)
    words = [word.strip() for word in text.split(",")]
    if len(words) > 2 or not any(character.isdigit() for character in text):
        raise UsageError(
            f"{option} {text!r} is neither a band nor a file",
            expected="5um, -2um,8um, or a table with the columns id, lower_um, upper_um",
        )
    limits = [_length_um(word, option) for word in words]
    low, high = (-limits[0], limits[0]) if len(limits) == 1 else (limits[0], limits[1])
    if not low < high:
        raise UsageError(
            f"{option} {text!r}", expected="a width above zero, or LOW,HIGH with LOW below HIGH, as -2um,8um"
        )
    return replace(config, tolerance_band_lower_um=low, tolerance_band_upper_um=high), None


def in_words(config: ErrorMapConfig, table: Path | None) -> str:
    """Return the tolerances in words."""
    given = [
        f"{name} {getattr(config, key):g} {unit}"
        for key, (name, unit) in NAMES.items()
        if getattr(config, key) > 0.0
    ]
    low, high = config.tolerance_band_lower_um, config.tolerance_band_upper_um
    if table is not None:
        given.append(f"band of {table}")
    elif low or high:
        given.append(f"band {low:+g} to {high:+g} um")
    if not given:
        return "none given, so no verdict (--tolerance-pv, -rms, -profile, -slope, -band)"
    rule = f"guard band {config.guard_factor:g} u" if config.decision == "guard-band" else "simple acceptance"
    return f"{', '.join(given)}; {rule}"


def limits_of_points(
    alignment: Alignment, config: ErrorMapConfig, table: Path, units: str | None
) -> tuple[Array, Array]:
    """Return the least and largest deviation of every point, mm; all that count must be in the table.

    Parameters
    ----------
    alignment : Alignment
    config : ErrorMapConfig
        With the report region, if there is one.
    table : Path
        With the columns id, lower and upper limit.
    units : str or None
        Of a table that states none.

    Returns
    -------
    lower_mm, upper_mm : ndarray, shape (N,), mm
        Infinite for points that do not count.
    """
    import numpy as np

    from cmm_align import formats
    from cmm_align.stages.report_region import reported_in
    from cmm_align.surfaces.region import region_from_text

    if config.report_region:
        region = region_from_text(config.report_region, alignment.nominal.surface, "report_region")
        alignment = reported_in(alignment, region)
    limits = formats.read_limits(table, units)
    lower, upper = np.full(len(alignment.ids), -np.inf), np.full(len(alignment.ids), np.inf)
    rows = formats.matched(alignment.ids[alignment.judged], limits.ids, str(table))
    lower[alignment.judged], upper[alignment.judged] = limits.lower_mm[rows], limits.upper_mm[rows]
    return lower, upper


def _length_um(text: str, option: str) -> float:
    """Return a length with its unit in um."""
    try:
        length_um = parse_length_mm(text) * UM_PER_MM
    except UnitsError as error:
        raise UsageError(f"{option}: {error.what}", expected=error.expected or "a length, as 5um") from None
    if not states_unit(text):
        raise UsageError(f"{option} {text!r} has no unit", expected=f"{text}um or {text}mm")
    return length_um
