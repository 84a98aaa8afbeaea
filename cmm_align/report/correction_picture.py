"""The picture of a correction: where material comes off, and where the map was continued to get there."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.path import Path as MplPath

from cmm_align.model import Correction, CorrectionStatus
from cmm_align.report.canvas import (
    STYLE,
    WIDTH_IN,
    draw_aperture,
    draw_scale,
    dress,
    footer,
    hatched_patch,
    header,
    legend,
    limit_um,
    save,
    sheet,
    thin,
    three_digits,
)
from cmm_align.report.deviation_colours import LEAVE_HUE_DEG, TAKE_OFF_HUE_DEG
from cmm_align.report.field import draw_field
from cmm_align.report.map_picture import map_size, origin, version
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import UM_PER_MM

TAKE_OFF: Final = "take off"
LEAVE: Final = "leave or raise"
_HEAD_IN: Final = 1.25
_FOOT_IN: Final = 0.84
_LEGEND_IN: Final = 0.26
"""More at the foot where the legend is long and needs a line of its own."""


def draw_correction(
    correction: Correction, path: Path | str, title: str = "Correction to grind", source: str = ""
) -> None:
    """Write a picture of the correction; nodes continued from their neighbours are hatched.

    Parameters
    ----------
    correction : Correction
        Drawn in frame `surface`: the correction of this pass along the normal; green is to be taken
        off, purple is to be left or raised.
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title : str
        Headline; shown as it is.
    source : str
        Name of the file behind the correction, for the foot of the sheet.
    """
    c, b = correction, correction.nominal.surface.bounds
    with mpl.rc_context(STYLE):
        width_in, map_in = map_size(b, 0.80 * WIDTH_IN, 7.2)
        reasons = _reasons(c)
        foot_in = _FOOT_IN + (_LEGEND_IN if len(reasons) > 1 else 0.0)
        height_in = map_in + _HEAD_IN + foot_in
        figure = sheet(height_in)
        left, wide = 0.08 + 0.5 * (0.80 - width_in / WIDTH_IN), width_in / WIDTH_IN
        bottom, tall = foot_in / height_in, map_in / height_in
        axes = figure.add_axes((left, bottom, wide, tall))
        limit = limit_um(c.correction_mm)
        hues = (TAKE_OFF_HUE_DEG, LEAVE_HUE_DEG)
        image = draw_field(axes, c.nominal, c.x_mm, c.y_mm, c.correction_mm, limit, hues)
        outline = draw_aperture(axes, c.nominal, image, hatched=False)
        dress(axes, c.nominal)
        box = (left + wide + 0.015, bottom + 0.10 * tall, 0.017, 0.72 * tall)
        draw_scale(figure, image, box, limit, (TAKE_OFF, LEAVE.replace(" or ", "\nor ")))
        marks = [
            (_hatched(axes, c, mask, hatch, outline), f"{words} ({thin(int(mask.sum()))})")
            for words, hatch, mask in reasons
        ]
        if marks:
            legend(figure, marks, left + wide, height_in)
        low, high = (float(f(c.correction_mm)) * UM_PER_MM for f in (np.nanmin, np.nanmax))
        header(
            figure,
            title,
            [
                f"pass {c.pass_number}, {_gain_words(c)}: \N{MINUS SIGN} = {TAKE_OFF}, + = {LEAVE}, "
                "along the outward normal",
                "not a deviation: the opposite sign of what was measured",
            ],
            [
                ("take off, µm", three_digits(max(-low, 0.0))),
                ("leave, µm", three_digits(max(high, 0.0))),
                ("RMS after, µm", three_digits(c.predicted.rms_mm * UM_PER_MM)),
            ],
            height_in,
        )
        footer(figure, [source, *origin(c.nominal), version()], height_in)
        save(figure, path)


def _gain_words(c: Correction) -> str:
    return f"gain by wavelength, {c.gain:.2f} on average" if c.gain_rule == "wiener" else f"gain {c.gain:g}"


def _reasons(c: Correction) -> list[tuple[str, str, Mask]]:
    """Return why nodes are not as the map says: words, hatch, and the nodes inside the aperture."""
    if c.status is None:
        return [("continued from neighbours", "////", c.extended)] if c.extended.any() else []
    inside = np.isfinite(c.correction_mm)
    continued = np.isin(c.status, (CorrectionStatus.BEYOND, CorrectionStatus.BRIDGED))
    found = [
        ("continued from neighbours", "////", inside & continued),
        ("too few points", "....", inside & (c.status == CorrectionStatus.FEW_POINTS)),
        ("clipped", "xxxx", inside & (c.status == CorrectionStatus.CLIPPED)),
        ("outside the region", "\\\\\\\\", inside & (c.status == CorrectionStatus.OUTSIDE_REGION)),
    ]
    return [one for one in found if one[2].any()]


def _hatched(axes: Axes, c: Correction, nodes: Mask, hatch: str, outline: MplPath) -> Artist:
    """Hatch nodes, and return the sample for the legend."""
    x, y = _cell_edges(c.x_mm), _cell_edges(c.y_mm)
    cells = np.pad(nodes.astype(float), 1, mode="edge").repeat(2, axis=0).repeat(2, axis=1)
    hatched = axes.contourf(x, y, cells, levels=[0.5, 1.5], colors="none", hatches=[hatch], zorder=3)
    hatched.set_clip_path(outline, transform=axes.transData)
    return hatched_patch(hatch)


def _cell_edges(nodes_mm: Array) -> Array:
    """Return both edges of every node's cell, a hair inside it, and of one more at either end."""
    step = nodes_mm[1] - nodes_mm[0]
    nodes = np.concatenate([nodes_mm[:1] - step, nodes_mm, nodes_mm[-1:] + step])
    edges: Array = np.column_stack([nodes - 0.499 * step, nodes + 0.499 * step]).ravel()
    return edges
