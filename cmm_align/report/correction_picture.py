"""The picture of a correction: where material comes off, and where the map was continued to get there."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from matplotlib.path import Path as MplPath

from cmm_align.model import Correction
from cmm_align.report.canvas import (
    SOFT,
    STYLE,
    WIDTH_IN,
    draw_aperture,
    draw_field,
    draw_scale,
    dress,
    header,
    limit_um,
    save,
    sheet,
    signed,
    three_digits,
)
from cmm_align.report.map_picture import map_size, plain
from cmm_align.units import UM_PER_MM


def draw_correction(
    correction: Correction, path: Path | str, title: str = "Correction of the next pass"
) -> None:
    """Write a picture of the correction as PNG; nodes continued from their neighbours are hatched.

    Parameters
    ----------
    correction : Correction
        Drawn in frame `surface`: the correction of this pass along the normal.
    path : path
        Written as PNG whatever its suffix.
    title : str
        Headline; shown as it is.
    """
    c, b = correction, correction.nominal.surface.bounds
    with mpl.rc_context(STYLE):
        width_in, map_in = map_size(b, 0.80 * WIDTH_IN, 7.2)
        height_in = map_in + 1.5
        figure = sheet(height_in)
        left, wide = 0.08 + 0.5 * (0.80 - width_in / WIDTH_IN), width_in / WIDTH_IN
        bottom, tall = 0.55 / height_in, map_in / height_in
        axes = figure.add_axes((left, bottom, wide, tall))
        limit = limit_um(c.correction_mm)
        image = draw_field(axes, c.x_mm, c.y_mm, c.correction_mm, limit, rings=1)
        outline = draw_aperture(axes, c.nominal, image, hatched=False)
        if c.extended.any():
            _hatch(axes, c, outline)
        dress(axes, c.nominal)
        draw_scale(figure, image, (left + wide + 0.015, bottom + 0.06 * tall, 0.017, 0.82 * tall), limit)
        low, high = (float(f(c.correction_mm)) * UM_PER_MM for f in (np.nanmin, np.nanmax))
        header(
            figure,
            plain(title),
            f"pass {c.pass_number}, gain {c.gain:g}; \N{MINUS SIGN} = take off, along the outward normal",
            [
                ("lowest, µm", signed(low, 2)),
                ("highest, µm", signed(high, 2)),
                ("RMS after, µm", three_digits(c.predicted.rms_mm * UM_PER_MM)),
            ],
            height_in,
        )
        save(figure, path)


def _hatch(axes: Axes, c: Correction, outline: MplPath) -> None:
    """Hatch the nodes without data of their own and say so under the map."""
    step_x, step_y = c.x_mm[1] - c.x_mm[0], c.y_mm[1] - c.y_mm[0]
    x = np.concatenate([c.x_mm[:1] - 0.5 * step_x, c.x_mm, c.x_mm[-1:] + 0.5 * step_x])
    y = np.concatenate([c.y_mm[:1] - 0.5 * step_y, c.y_mm, c.y_mm[-1:] + 0.5 * step_y])
    extended = np.pad(c.extended.astype(float), 1, mode="edge")
    hatched = axes.contourf(x, y, extended, levels=[0.5, 1.5], colors="none", hatches=["////"], zorder=3)
    hatched.set_clip_path(outline, transform=axes.transData)
    n_extended, n = int(c.extended.sum()), int(np.isfinite(c.correction_mm).sum())
    sample = Rectangle((0, 0), 1, 1, facecolor="white", edgecolor=SOFT, hatch="////", linewidth=0.5)
    axes.legend(
        [sample],
        [f"continued from neighbours ({n_extended} of {n} nodes)"],
        loc="upper right",
        bbox_to_anchor=(1.0, -0.05),
        frameon=False,
        fontsize=8.5,
        labelcolor=SOFT,
        borderpad=0.0,
    )
