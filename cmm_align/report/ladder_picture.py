"""The ladder of a map: PV and RMS of what is left after removing more and more low orders."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from cmm_align.model import DeviationMap
from cmm_align.report.canvas import INK, SOFT, STYLE, plain, save, three_digits
from cmm_align.report.chart import FOOT_IN, PALE, chart, chart_sheet
from cmm_align.report.wording import in_print
from cmm_align.units import UM_PER_MM

_RUNG_IN: Final = 0.62
_LEFT_IN: Final = 2.05
_WIDE_IN: Final = 7.0
_RMS_INK: Final = "#35506e"


def draw_ladder(
    deviation_map: DeviationMap, path: Path | str, title: str = "Ladder", source: str = ""
) -> None:
    """Write PV and RMS of each rung of the ladder as bars, and what the form error mostly is in words.

    Parameters
    ----------
    deviation_map : DeviationMap
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title, source : str
        Headline, and the name of the file behind the map.
    """
    m = deviation_map
    with mpl.rc_context(STYLE):
        lines = ["what is left of the map after removing, one after the other"]
        if m.low_orders is not None:
            lines.append(in_print(m.low_orders.words))
        body_in = _RUNG_IN * len(m.ladder) + 0.55
        figure, _ = chart_sheet(m, body_in, title, source, lines)
        axes = chart(figure, _LEFT_IN, FOOT_IN, _WIDE_IN, body_in - 0.4, grid="x")
        _bars(axes, m)
        axes.legend(
            handles=[
                Patch(facecolor=PALE, label="PV"),
                Patch(facecolor=_RMS_INK, label="RMS"),
            ],
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            ncols=2,
            frameon=False,
            fontsize=8.5,
            labelcolor=SOFT,
        )
        save(figure, path)


def _bars(axes: Axes, m: DeviationMap) -> None:
    """Draw two bars a rung with their numbers behind them, the whole map on top."""
    largest = max(rung.pv_mm for rung in m.ladder) * UM_PER_MM
    for k, rung in enumerate(m.ladder):
        pv, rms = rung.pv_mm * UM_PER_MM, rung.rms_mm * UM_PER_MM
        axes.barh(k - 0.15, pv, 0.36, color=PALE, zorder=2)
        axes.barh(k + 0.2, rms, 0.22, color=_RMS_INK, zorder=2)
        room = 0.012 * largest
        axes.text(pv + room, k - 0.15, three_digits(pv), va="center", fontsize=9, color=INK)
        pvr = f"     PVr {three_digits(rung.pvr_mm * UM_PER_MM)}" if math.isfinite(rung.pvr_mm) else ""
        axes.text(rms + room, k + 0.2, three_digits(rms) + pvr, va="center", fontsize=8, color=SOFT)
    axes.set_yticks(range(len(m.ladder)), [_name(rung.removed) for rung in m.ladder])
    axes.tick_params(axis="y", length=0, labelsize=9.5, labelcolor=INK, pad=8)
    axes.set(xlim=(0.0, 1.1 * (largest or 1.0)), ylim=(len(m.ladder) - 0.45, -0.5), xlabel="µm")
    axes.spines["left"].set_visible(False)


def _name(removed: str) -> str:
    """Return the words beside a rung: what was removed up to there."""
    return plain("nothing removed" if removed in {"", "nothing"} else removed)
