"""Root causes as a picture: how much of the mean square each explains, with its interval."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import matplotlib as mpl
from matplotlib.axes import Axes

from cmm_align.model import DeviationMap
from cmm_align.model.root_causes import CANNOT_TELL, DOMINANT, Cause
from cmm_align.report.canvas import INK, SOFT, STYLE, plain, save
from cmm_align.report.chart import FOOT_IN, PALE, chart, chart_sheet
from cmm_align.report.wording import in_print

_BAR_IN: Final = 0.72
_LEFT_IN: Final = 2.85
_WIDE_IN: Final = 6.1
_NORMAL_95: Final = 1.96
_DOMINANT_INK: Final = "#b9501a"
_BAR_INK: Final = "#35506e"
_MOST_NAMES: Final = 2


def draw_causes(
    deviation_map: DeviationMap, path: Path | str, title: str = "Root causes", source: str = ""
) -> None:
    """Write what each cause explains as a bar with its 95 % interval, dominant ones in another colour.

    Parameters
    ----------
    deviation_map : DeviationMap
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title, source : str
        Headline, and the name of the file behind the map.
    """
    found = deviation_map.root_causes
    causes = () if found is None else found.causes
    line = (
        "this file does not tell of causes" if found is None else "share of the mean square, 95 % intervals"
    )
    if found is not None and not causes:
        line = found.words
    with mpl.rc_context(STYLE):
        body_in = _BAR_IN * max(len(causes), 1) + 0.45
        lines = [in_print(line)]
        if causes and found is not None:
            lines.append(
                in_print(f"RMS {found.rms_um:.3g} um, without all of them {found.rms_without_um:.3g} um")
            )
        figure, _ = chart_sheet(deviation_map, body_in, title, source, lines)
        axes = chart(figure, _LEFT_IN, FOOT_IN, _WIDE_IN, body_in - 0.3, grid="x")
        _bars(axes, causes)
        save(figure, path)


def _bars(axes: Axes, causes: Sequence[Cause]) -> None:
    """Draw a bar for each cause, its value under its name, its share at its end."""
    for k, cause in enumerate(causes):
        percent, reach = 100.0 * cause.share, 100.0 * _NORMAL_95 * cause.u_share
        low, high = max(percent - reach, 0.0), min(percent + reach, 100.0)
        colour = _DOMINANT_INK if cause.share >= DOMINANT else _BAR_INK
        axes.barh(k, percent, 0.34, color=colour, zorder=2)
        axes.plot([low, high], [k, k], color=PALE, linewidth=2.4, zorder=3, solid_capstyle="butt")
        axes.plot([low, high], [k, k], color=INK, linewidth=1.0, zorder=4, marker="|", markersize=7)
        axes.text(high + 1.6, k, f"{percent:.0f} %", va="center", fontsize=9.5, color=INK, zorder=5)
        words = in_print(f"{cause.value:+.3g} {cause.unit} (u {cause.u:.2g})")
        axes.text(-1.6, k + 0.2, plain(words), ha="right", va="center", fontsize=8.5, color=SOFT)
        axes.text(-1.6, k - 0.14, plain(cause.name), ha="right", va="center", fontsize=10, color=INK)
        axes.text(0.0, k + 0.33, plain(_others(cause)), va="center", fontsize=8, color=SOFT)
    axes.set_yticks([])
    bottom = max(len(causes), 1) - 0.45
    axes.set(xlim=(0.0, 108.0), ylim=(bottom, -0.5), xlabel="% of the mean square beyond the rigid motion")
    axes.set_xticks(range(0, 101, 20))
    axes.spines["left"].set_visible(False)


def _others(cause: Cause) -> str:
    """Return which other causes the data cannot tell from this one."""
    even = [m for m in cause.alternatives if m.times_less_likely <= CANNOT_TELL]
    names = [in_print(f"{m.name} {m.value:+.3g} {m.unit}") for m in (even or cause.alternatives)]
    if not names:
        return ""
    more = len(names) - _MOST_NAMES
    listed = " or ".join(names[:_MOST_NAMES]) + (f" or {more} more" if more > 0 else "")
    return f"or {listed}: the data cannot tell" if even else f"nearly the same: {listed}"
