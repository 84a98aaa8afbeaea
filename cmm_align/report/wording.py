"""Numbers as people read them: as many digits as count, the unit that suits the size, no exponents."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from cmm_align.units import UM_PER_MM


def in_um(value_mm: float) -> str:
    """Return a length in um with four digits that count."""
    return f"{calm(value_mm * UM_PER_MM)} um"


def extreme(value_mm: float) -> str:
    """Return a signed deviation in um."""
    um = value_mm * UM_PER_MM
    return f"{signed(um, decimals(um))} um"


def calm(value: float) -> str:
    """Return a number with four digits that count, three decimals at most, and no exponent."""
    return f"{value:.{decimals(value)}f}"


def decimals(value: float) -> int:
    """Return how many decimals a number of this size deserves."""
    size = abs(value)
    return 3 if size < 10.0 else 2 if size < 100.0 else 1 if size < 1000.0 else 0


def two_digits(value: float) -> str:
    """Return a number with two digits that count and no exponent."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    power = math.floor(math.log10(abs(float(f"{value:.1e}"))))
    return f"{round(value, 1 - power):.{max(0, 1 - power)}f}"


def as_length(value_mm: float) -> str:
    """Return a length with three digits that count in the unit that suits its size."""
    for unit, per_mm, least in (("m", 1e-3, 1e3), ("mm", 1.0, 1e-2), ("um", UM_PER_MM, 1e-5)):
        if abs(value_mm) >= least:
            value = value_mm * per_mm
            return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f} {unit}"
    return f"{value_mm:g} mm"


def as_percent(share: float) -> str:
    """Return a share in whole percent, which says 100 only where nothing is missing to the first decimal."""
    percent = 100.0 * share
    return f"{percent:.1f} %" if 99.0 <= percent < 99.95 else f"{percent:.0f} %"


def as_chance(probability: float) -> str:
    """Return a probability in percent that says neither never nor always."""
    percent = 100.0 * probability
    if percent < 0.1:
        return "< 0.1 %"
    return "> 99.9 %" if percent > 99.9 else f"{percent:.1f} %"


def signed(value: float, digits: int = 3) -> str:
    """Return a number with its sign; zero has none."""
    text = f"{abs(value):.{digits}f}"
    return text if float(text) == 0.0 else ("+" if value > 0.0 else "-") + text


def in_nm(value_nm: float) -> str:
    """Return a length in nm, or in um where it is large."""
    return f"{value_nm / UM_PER_MM:.3g} um" if abs(value_nm) >= UM_PER_MM else f"{value_nm:.3g} nm"


def at_place(place_mm: tuple[float, float]) -> str:
    """Return a place of frame `surface`."""
    return f"({signed(place_mm[0], 2)}, {signed(place_mm[1], 2)}) mm"


def triple(values: Iterable[float], digits: int) -> str:
    """Return signed numbers with commas between."""
    return ", ".join(signed(float(v), digits) for v in values)


def in_print(text: str) -> str:
    """Return a sentence of the terminal with the signs of print: micro, a true minus, less or equal."""
    text = text.replace(" um", " µm").replace("<=", "\N{LESS-THAN OR EQUAL TO}")
    return re.sub(r"(?<![\w.])-(?=\d)", "\N{MINUS SIGN}", text)


def minus(value: float) -> str:
    """Return a number as short as it is, with a true minus."""
    return f"{value:g}".replace("-", "\N{MINUS SIGN}")
