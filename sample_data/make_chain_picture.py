"""Draws `chain.png`, the picture at the top of the README: the four steps and what travels between them."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

INK, SOFT, LINE, PAPER = "#1b2430", "#64707d", "#c9d1d9", "#f6f8fa"
BLUE, RUST = "#0b57a4", "#b3490f"
WIDTH, HEIGHT = 14.1, 4.7
BOXES = [
    ("offset", "nominal + tip radius", "equidistant surface"),
    ("align", "tip centres, machine frame", "pose and deviations"),
    ("error-map", "deviations at points", "map, PV, RMS, verdict"),
    ("compensate", "map, last command", "surface to grind next"),
]


def draw_chain(path: Path) -> None:
    """Write the picture as PNG."""
    with mpl.rc_context({"font.family": "DejaVu Sans", "font.size": 10.5}):
        figure = plt.figure(figsize=(WIDTH, HEIGHT), dpi=100, facecolor="white")
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set(xlim=(0.0, WIDTH), ylim=(0.0, HEIGHT))
        axes.axis("off")
        lefts = 0.45 + 3.4 * np.arange(4)
        for number, (left, (name, takes, gives)) in enumerate(zip(lefts, BOXES, strict=True)):
            _box(axes, left, name, takes, gives)
            _sketch(axes, number, left + 1.45, 2.35)
            if number:
                _arrow(axes, (left - 0.47, 2.35), (left - 0.03, 2.35))
        _loop(axes, lefts)
        figure.savefig(path, format="png", metadata={"Software": None})
        plt.close(figure)


def _box(axes, left, name, takes, gives):
    axes.add_patch(
        FancyBboxPatch(
            (left, 1.15), 2.9, 3.0, boxstyle="round,pad=0,rounding_size=0.12", fc=PAPER, ec=LINE, lw=1.2
        )
    )
    axes.text(left + 1.45, 3.78, name, ha="center", va="center", color=INK, weight="bold", size=13.5)
    axes.text(left + 1.45, 3.45, takes, ha="center", va="center", color=SOFT, size=9.5)
    axes.text(left + 1.45, 1.4, gives, ha="center", va="center", color=INK, size=10.5)


def _arrow(axes, start, end, **style):
    look = {"arrowstyle": "-|>", "mutation_scale": 15, "color": SOFT, "lw": 1.5, "shrinkA": 0, "shrinkB": 0}
    axes.add_patch(FancyArrowPatch(start, end, **{**look, **style}))


def _curve(offset=0.0, bend=0.0):
    """Return the section of a surface of unit width, a distance above it along its normals."""
    x = np.linspace(-1.0, 1.0, 121)
    z = 0.42 * (1.0 - x**2) - 0.22 + 0.10 * x**3 + bend * np.sin(4.0 * x)
    slope = np.gradient(z, x)
    length = np.hypot(1.0, slope)
    return x - offset * slope / length, z + offset / length


def _sketch(axes, number, x0, y0):
    def line(curve, **style):
        axes.plot(x0 + 1.05 * curve[0], y0 + 1.05 * curve[1], solid_capstyle="round", **style)

    nominal = _curve()
    if number == 0:
        line(nominal, color=INK, lw=2.2)
        line(_curve(0.2), color=BLUE, lw=1.6, ls=(0, (4, 2)))
        for k in (24, 60, 96):
            centre = (x0 + 1.05 * _curve(0.2)[0][k], y0 + 1.05 * _curve(0.2)[1][k])
            axes.add_patch(plt.Circle(centre, 0.21, fc="white", ec=RUST, lw=1.4, zorder=3))
            axes.plot(*centre, ".", color=RUST, ms=4, zorder=4)
    elif number == 1:
        line(nominal, color=INK, lw=2.2)
        x, z = _curve(0.2)
        turn = np.deg2rad(17.0)
        u, v = (
            0.85 * (np.cos(turn) * x - np.sin(turn) * z),
            0.85 * (np.sin(turn) * x + np.cos(turn) * z) + 0.33,
        )
        line((u[::10], v[::10]), color=LINE, marker="o", ms=4, lw=0)
        line((x[::10], z[::10]), color=RUST, marker="o", ms=4, lw=0)
        _arrow(axes, (x0 + 0.95, y0 + 0.62), (x0 + 0.98, y0 + 0.12), connectionstyle="arc3,rad=-0.35", lw=1.2)
    elif number == 2:
        grid = np.linspace(-1.0, 1.0, 121)
        u, v = np.meshgrid(grid, grid)
        e = (
            0.8 * np.exp(-((u + 0.4) ** 2 + v**2) / 0.3)
            - 0.75 * v**2 * (1 + u) / 1.6
            + 0.2 * np.sin(5 * u + v)
        )
        box = (x0 - 1.0, x0 + 1.0, y0 - 0.6, y0 + 0.6)
        axes.imshow(
            e, extent=box, cmap=_diverging(), vmin=-1, vmax=1, origin="lower", aspect="auto", zorder=2
        )
        axes.add_patch(plt.Rectangle((box[0], box[2]), 2.0, 1.2, fc="none", ec=INK, lw=1.4, zorder=3))
    else:
        line(nominal, color=LINE, lw=2.2)
        line(_curve(0.06, 0.05), color=RUST, lw=1.8)
        line(_curve(-0.06, -0.05), color=BLUE, lw=1.8)
        axes.text(x0 + 0.02, y0 + 0.44, "part", color=RUST, ha="center", size=9.5)
        axes.text(x0 + 0.02, y0 - 0.19, "commanded", color=BLUE, ha="center", size=9.5)
    axes.set(xlim=(0.0, WIDTH), ylim=(0.0, HEIGHT))


def _diverging():
    colours = [
        "#033765",
        "#0b57a4",
        "#5b9ee8",
        "#cfe0f7",
        "#f7f5f3",
        "#f6cfbf",
        "#dd8560",
        "#a3410d",
        "#5c2000",
    ]
    return mpl.colors.LinearSegmentedColormap.from_list("deviation", colours)


def _loop(axes, lefts):
    right, left, low = lefts[3] + 1.45, lefts[1] + 1.45, 0.45
    axes.plot([right, right, left], [1.12, low, low], color=SOFT, lw=1.5, solid_joinstyle="round")
    _arrow(axes, (left, low), (left, 1.12))
    axes.text(
        (left + right) / 2,
        low,
        "grind  ·  measure again",
        ha="center",
        va="center",
        color=INK,
        size=11,
        bbox={"fc": "white", "ec": "none", "pad": 6},
    )


if __name__ == "__main__":
    draw_chain(Path(__file__).parent / "chain.png")
