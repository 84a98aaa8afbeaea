"""Pictures of the scaling bench: growth of time and memory, and where the time goes."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from bench_table import short
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from paper_pictures import INKS, start_sheet

from cmm_align.report.canvas import INK, SOFT, STYLE, save
from cmm_align.report.chart import chart

PART_INK = {
    "import": "#c9d2da",
    "read": "#8fb3d9",
    "checksum": "#b9a7d6",
    "locate": "#b9501a",
    "solve": "#e8a06f",
    "check": "#d9b84a",
    "write": "#2f6fb5",
    "other": "#8b96a1",
}
PART_WORDS = {
    "import": "start and import",
    "read": "read",
    "checksum": "checksums",
    "locate": "locate (foot points)",
    "solve": "solve",
    "check": "second path, uncertainty",
    "write": "write",
    "other": "other",
}


def draw_growth(path: Path, costs) -> None:
    """Time and peak memory against the number of points, a line for each nominal."""
    with mpl.rc_context(STYLE):
        figure = start_sheet(
            "Time and memory of align", "whole processes; dotted: growth with the first power", 3.5
        )
        for k, (name, of) in enumerate((("seconds", "seconds"), ("peak memory, MB", "peak_mb"))):
            axes = chart(figure, 0.85 + 4.5 * k, 0.62, 3.65, 3.0, grid="both")
            for ink, nodes in zip(INKS, sorted({c.nodes for c in costs}), strict=False):
                line = sorted((c.points, getattr(c, of)) for c in costs if c.nodes == nodes)
                axes.loglog(
                    *zip(*line, strict=True), "-o", color=ink, lw=1.6, ms=4, label=f"{short(nodes)} nodes"
                )
            x = np.array(sorted({c.points for c in costs}), dtype=float)
            top = max(getattr(c, of) for c in costs if c.points == x[-1])
            axes.loglog(x[-2:], 1.35 * top * x[-2:] / x[-1], ":", color=SOFT, lw=1.1)
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axes.yaxis.set_minor_locator(NullLocator())
            axes.set_xlabel("points")
            axes.set_ylabel(name)
            if k == 0:
                axes.legend(frameon=False, labelcolor=SOFT, fontsize=8.5)
        save(figure, path)


def draw_parts(path: Path, parts, names) -> None:
    """Where the time goes, a bar for each number of points, as shares with the seconds beside them."""
    with mpl.rc_context(STYLE):
        high = 0.62 * len(parts)
        figure = start_sheet(
            "Where the time goes", "align, HDF5 in and out, nominal of the paper", 1.15 + high
        )
        axes = chart(figure, 0.95, 1.15, 7.4, high, grid="")
        for row, run in enumerate(parts.values()):
            total, left = sum(run.values()), 0.0
            for name in names:
                share = run[name] / total
                axes.barh(
                    row, share, left=left, height=0.62, color=PART_INK[name], edgecolor="white", linewidth=0.8
                )
                if share > 0.045:
                    dark = name in {"locate", "write"}
                    axes.text(
                        left + share / 2,
                        row,
                        f"{run[name]:.2g}",
                        ha="center",
                        va="center",
                        fontsize=8,
                        color="white" if dark else INK,
                    )
                left += share
            axes.text(1.012, row, f"{total:.2f} s", va="center", fontsize=9.5, weight="bold")
        axes.invert_yaxis()
        axes.set_yticks(range(len(parts)), [short(n) for n in parts])
        axes.set_ylabel("points")
        axes.set_xlim(0, 1)
        axes.set_xticks([])
        axes.spines["bottom"].set_visible(False)
        handles = [mpl.patches.Rectangle((0, 0), 1, 1, color=PART_INK[name]) for name in names]
        figure.legend(
            handles,
            [PART_WORDS[name] for name in names],
            loc="lower left",
            bbox_to_anchor=(0.09, 0.02),
            ncols=4,
            frameon=False,
            fontsize=8.5,
            labelcolor=SOFT,
        )
        axes.annotate(
            "seconds in the bars",
            (0, 0),
            xytext=(0, -6),
            xycoords="axes fraction",
            textcoords="offset points",
            va="top",
            fontsize=8,
            color=SOFT,
        )
        save(figure, path)
