"""The convergence of a ledger: RMS and PV of each part from pass to pass, what was predicted, the floor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from cmm_align.model import LedgerPass
from cmm_align.report.canvas import INK, SOFT, STYLE, footer, header, plain, save, sheet, three_digits
from cmm_align.report.chart import GRID, HEAD_IN, PALE, chart
from cmm_align.report.map_picture import version

MOST_COLOURS: Final = 6
"""Parts that have a colour of their own, the latest ones; earlier parts are pale."""

COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#8c6d00")
"""Told apart by the colour-blind: after M. Okabe, K. Ito, "Color universal design", 2008."""
_MARKS: Final = ("o", "s", "D", "^", "v", "P")

_BODY_IN: Final = 3.3
_TITLE_IN: Final = 0.3
_FOOT_IN: Final = 1.15
_LEFT_IN: Final = 0.72
_WIDE_IN: Final = 3.75
_GAP_IN: Final = 0.62
_ASIDE: Final = 0.10
"""Predictions stand so far beside what came, in passes."""


def draw_history(
    passes: Sequence[LedgerPass], path: Path | str, title: str = "History", source: str = ""
) -> None:
    """Write RMS and PV of single points after each grind, with what was predicted for it.

    Parameters
    ----------
    passes : sequence of LedgerPass
        Of one ledger; at least one.
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title, source : str
        Headline, and machine and wheel.
    """
    parts = list(dict.fromkeys(one.part for one in passes))
    latest = parts[-MOST_COLOURS:]
    judged = [one.interval_held for one in passes if one.interval_held is not None]
    floor = float(np.median([one.floor_um for one in passes]))
    with mpl.rc_context(STYLE):
        height_in = HEAD_IN + _TITLE_IN + _BODY_IN + _FOOT_IN
        figure = sheet(height_in)
        for k, (name, quantity) in enumerate((("RMS, µm", "rms"), ("PV, µm", "pv"))):
            left = _LEFT_IN + k * (_WIDE_IN + _GAP_IN)
            axes = chart(figure, left, _FOOT_IN, _WIDE_IN, _BODY_IN)
            for part in parts:
                chain = [one for one in passes if one.part == part]
                number = latest.index(part) if part in latest else None
                _draw_part(axes, chain, quantity, number)
            if quantity == "rms":
                axes.axhline(floor, color=INK, linewidth=1.0, linestyle=(0, (5, 3)), zorder=1)
            _dress(axes, passes, name)
        last = passes[-1]
        header(
            figure,
            title,
            [
                f"{len(passes)} {'pass' if len(passes) == 1 else 'passes'} of "
                f"{len(parts)} {'part' if len(parts) == 1 else 'parts'}; deviations of single points",
                f"95 % interval of the RMS held in {sum(judged)} of {len(judged)} passes" if judged else "",
            ],
            [("RMS now, µm", three_digits(last.rms_um)), ("PV now, µm", three_digits(last.pv_um))],
            height_in,
        )
        handles = [
            Line2D([], [], color=COLOURS[k], marker=_MARKS[k], markersize=6, linewidth=1.6, label=plain(part))
            for k, part in enumerate(latest)
        ]
        if len(parts) > len(latest):
            handles.append(Line2D([], [], color=PALE, linewidth=1.6, label="earlier parts"))
        handles.append(
            Line2D([], [], color=SOFT, marker="_", markersize=9, linewidth=1.2, label="predicted, 95 %")
        )
        floor_words = f"floor {three_digits(floor)} µm: noise and repeatability"
        handles.append(Line2D([], [], color=INK, linewidth=1.0, linestyle=(0, (5, 3)), label=floor_words))
        figure.legend(
            handles=handles,
            loc="center left",
            bbox_to_anchor=(_LEFT_IN / figure.get_figwidth(), 0.46 / height_in),
            ncols=min(len(handles), 5),
            frameon=False,
            fontsize=8.5,
            labelcolor=SOFT,
            borderpad=0.0,
            borderaxespad=0.0,
            columnspacing=1.6,
        )
        footer(
            figure, [source, f"from {passes[0].time_utc[:10]} to {last.time_utc[:10]}", version()], height_in
        )
        save(figure, path)


def _draw_part(axes: Axes, chain: Sequence[LedgerPass], quantity: str, number: int | None) -> None:
    """Draw what was measured before each pass and after the last one, and what was predicted."""
    x = [one.pass_number for one in chain]
    y = [getattr(one, f"{quantity}_um") for one in chain]
    came = chain[-1].came
    if came is not None:
        x.append(chain[-1].pass_number + 1)
        y.append(getattr(came, f"{quantity}_um"))
    if number is None:
        axes.plot(x, y, color=PALE, linewidth=1.2, zorder=2)
        return
    axes.plot(x, y, color=COLOURS[number], marker=_MARKS[number], markersize=6, linewidth=1.6, zorder=4)
    for one in chain:
        value, low, high = (getattr(one, f"predicted_{quantity}{end}_um") for end in ("", "_low", "_high"))
        axes.errorbar(
            one.pass_number + 1 + _ASIDE * (1 + 0.5 * number),
            value,
            yerr=[[value - low], [high - value]],
            color=COLOURS[number],
            marker="_",
            markersize=9,
            linewidth=1.2,
            capsize=2.5,
            alpha=0.75,
            zorder=3,
        )


def _dress(axes: Axes, passes: Sequence[LedgerPass], name: str) -> None:
    """Set scales, ticks and labels: passes along x, a logarithmic length along y."""
    numbers = [one.pass_number for one in passes]
    axes.set_xlim(min(numbers) - 0.3, max(numbers) + 1.7)
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    low, high = axes.get_ylim()
    if high < 4.0 * low:
        axes.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    elif high < 30.0 * low:
        axes.yaxis.set_minor_formatter(FuncFormatter(_minor))
    else:
        axes.yaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(axis="y", which="minor", labelsize=8, labelcolor=SOFT)
    axes.grid(visible=True, axis="y", which="minor", color=GRID, linewidth=0.5)
    axes.set_xlabel("after grind")
    axes.set_title(name, loc="left", fontsize=10, color=INK, weight="bold", pad=8)


def _minor(value: float, _position: int | None) -> str:
    """Return the label of a tick between powers of ten: of 2, 3 and 5 only."""
    first = f"{value:e}"[0]
    return f"{value:g}" if first in "235" else ""
