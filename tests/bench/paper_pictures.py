"""Pictures of the paper's figures and of the benches, drawn on the sheet of all our pictures."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.ticker import MaxNLocator

from cmm_align.report.canvas import RULE, SOFT, STYLE, WIDTH_IN, header, save, sheet, three_digits
from cmm_align.report.chart import chart
from cmm_align.report.deviation_colours import deviation_colours

INKS = ("#2f6fb5", "#b9501a", "#3f8f5b", "#7a5aa8", "#b08a1e", "#5b6672")
OURS = "#b9501a"
METHOD_WORDS = {
    "icp": "point to point (ICP)",
    "point-to-plane": "point to plane",
    "facet": "point to triangle (as in the paper)",
    "ours": "foot point (ours)",
}
METHOD_INK = {"icp": "#5b6672", "point-to-plane": "#3f8f5b", "facet": "#2f6fb5", "ours": OURS}
FLOOR_MM2 = 1e-28


def _sheet(title: str, line: str, body_in: float, numbers=()):
    """Return a sheet with its head written, and its height."""
    height = 1.25 + body_in
    figure = sheet(height)
    header(figure, title, [line], list(numbers), height)
    return figure, height


def start_sheet(title: str, line: str, body_in: float):
    """Return a sheet with its head written."""
    return _sheet(title, line, body_in)[0]


def _field(figure, height, left, width, x, y, values, words, unit, scale):
    """Draw one field with its own colour bar under it."""
    tall = width * (y[-1] - y[0]) / (x[-1] - x[0])
    axes = figure.add_axes((left / WIDTH_IN, 1.02 / height, width / WIDTH_IN, tall / height))
    limit = max(float(np.nanmax(np.abs(values))) * scale, 1e-300)
    image = axes.imshow(
        values * scale,
        origin="lower",
        extent=(x[0], x[-1], y[0], y[-1]),
        vmin=-limit,
        vmax=limit,
        cmap=ListedColormap(deviation_colours()),
        interpolation="nearest",
    )
    axes.set_title(words, loc="left", fontsize=10, weight="bold", pad=7)
    axes.set_xlabel("x, mm")
    _bar(figure, image, (left / WIDTH_IN, 0.42 / height, width / WIDTH_IN, 0.09 / height), unit)
    return axes


def _bar(figure, image, box, unit) -> None:
    """Draw a level colour bar."""
    bar = figure.colorbar(image, cax=figure.add_axes(box), orientation="horizontal")
    bar.outline.set_edgecolor(RULE)
    bar.ax.xaxis.set_major_locator(MaxNLocator(5))
    bar.ax.tick_params(length=0)
    bar.ax.set_xlabel(unit, labelpad=1)


def draw_density(path: Path, x, y, error_mm, facets_mm, smooth_mm) -> None:
    """Figure 2: the simulated error, and what each distance makes of it."""
    pv = [1e6 * float(np.ptp(e)) for e in (facets_mm, smooth_mm)]
    with mpl.rc_context(STYLE):
        numbers = [("facets, PV", f"{three_digits(pv[0])} nm"), ("smooth, PV", f"{pv[1]:.0e} nm")]
        width = 2.72
        figure, height = _sheet(
            "Are the points dense enough?",
            "errors at the middles of the cells of the nominal grid",
            1.2 + width * 62 / 102,
            numbers,
        )
        panels = (
            (error_mm, "simulated error", "µm", 1e3),
            (facets_mm, "error of the facets", "nm", 1e6),
            (smooth_mm, "error of the smooth surface", "1e-6 nm", 1e12),
        )
        for k, (values, words, unit, scale) in enumerate(panels):
            axes = _field(figure, height, 0.55 + 2.95 * k, width, x, y, values, words, unit, scale)
            if k == 0:
                axes.set_ylabel("y, mm")
            else:
                axes.tick_params(labelleft=False)
        save(figure, path)


def draw_equidistant(path: Path, nominal_mm, equidistant_mm, nodes) -> None:
    """Figure 3: both surfaces, the right half of the nominal uncovered."""
    nx, ny = nodes
    step = max(1, nx // 60), max(1, ny // 40)

    def thin(points):
        return [c.reshape(ny, nx)[:: step[1], :: step[0]] for c in points.T]

    with mpl.rc_context(STYLE):
        figure, height = _sheet(
            "Nominal and equidistant surface",
            f"{nx} x {ny} nodes; the equidistant surface (blue) ends at x = 0",
            3.2,
        )
        axes = figure.add_axes((0.0, -0.06, 1.0, 4.4 / height), projection="3d")
        axes.computed_zorder = False
        x, y, z = thin(nominal_mm)
        axes.plot_surface(
            x,
            y,
            z,
            color="#e3b089",
            edgecolor="white",
            linewidth=0.25,
            shade=True,
            zorder=1,
            rstride=1,
            cstride=1,
        )
        x, y, z = thin(equidistant_mm)
        half = x[0] <= 0.0
        axes.plot_surface(
            x[:, half],
            y[:, half],
            z[:, half],
            color="#7ba7d4",
            edgecolor="white",
            linewidth=0.25,
            shade=True,
            zorder=2,
            rstride=1,
            cstride=1,
        )
        _box(axes, nominal_mm)
        save(figure, path)


def _box(axes, points_mm, zoom=1.22) -> None:
    """Equal scales, quiet panes."""
    spans = np.ptp(points_mm, axis=0)
    axes.set_box_aspect(spans, zoom=zoom)
    axes.view_init(elev=24, azim=-58)
    for axis, word in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", strict=True):
        axis.set_pane_color((1, 1, 1, 0))
        axis._axinfo["grid"].update(color="#e9ecef", linewidth=0.6)
        axis.set_label_text(f"{word}, mm")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.zaxis.set_major_locator(MaxNLocator(3))


def draw_mismatch(path: Path, home_mm, away_mm, runs) -> None:
    """Figures 5 and 6: the cloud off and at home, and the objective against iteration."""
    with mpl.rc_context(STYLE):
        figure, height = _sheet(
            "From far off",
            "left: 20, 10, 20 mm and 20, 10, 20° off (blue), and aligned (brown); right: the objective",
            3.9,
        )
        axes = figure.add_axes((0.0, 0.0, 0.41, 3.9 / height), projection="3d")
        for points, ink in ((home_mm, "#b9501a"), (away_mm, "#2f6fb5")):
            few = points[:: max(1, len(points) // 2500)]
            axes.scatter(*few.T, s=1.1, color=ink, linewidths=0, alpha=0.65)
        _box(axes, np.vstack([home_mm, away_mm]), zoom=0.92)
        axes.zaxis.set_label_text("")
        right = chart(figure, 5.05, 0.62, 3.95, 3.4, grid="both")
        for k, ((words, run), ink) in enumerate(zip(runs.items(), INKS, strict=False)):
            cost = np.maximum([c for *_, c in run], FLOOR_MM2)
            right.semilogy(range(len(run)), cost, "-o", ms=8.0 - 1.1 * k, lw=1.3, color=ink, label=words)
        right.set_xlabel("step")
        right.set_ylabel("mean square, mm²")
        right.xaxis.set_major_locator(MaxNLocator(integer=True))
        right.legend(
            title="start, mm and deg", frameon=False, labelcolor=SOFT, fontsize=8.5, loc="upper right"
        )
        right.get_legend().get_title().set(color=SOFT, fontsize=8.5)
        save(figure, path)


def draw_iterations(path: Path, curves, counts) -> None:
    """The residual of each method against its iterations, both on logarithmic axes."""
    with mpl.rc_context(STYLE):
        figure = start_sheet(
            "How many iterations",
            "from 20, 10, 20 mm and 20, 10, 20°; 27 µm of form error; each method's own residual",
            3.6,
        )
        axes = chart(figure, 0.85, 0.62, 8.1, 3.1, grid="both")
        for name, costs in curves.items():
            rms = 1e3 * np.sqrt(np.maximum(costs, FLOOR_MM2))
            axes.loglog(
                np.arange(1, len(rms) + 1),
                rms,
                color=METHOD_INK[name],
                lw=1.7,
                marker="o",
                ms=3.2,
                label=f"{METHOD_WORDS[name]}: {counts[name]}",
            )
        axes.set_xlabel("look at the fit (1 = the start)")
        axes.set_ylabel("RMS of the residual, µm")
        axes.legend(frameon=False, labelcolor=SOFT, fontsize=9)
        save(figure, path)


def draw_time(path: Path, sizes, spent) -> None:
    """Time against the number of points."""
    with mpl.rc_context(STYLE):
        figure = start_sheet(
            "Time against the number of points", "the whole stage; a dotted line grows as N", 3.4
        )
        axes = chart(figure, 0.85, 0.62, 8.1, 2.9, grid="both")
        for name, seconds in spent.items():
            axes.loglog(sizes, seconds, "-o", color=METHOD_INK[name], lw=1.7, ms=4, label=METHOD_WORDS[name])
        last = spent["ours"][-1]
        axes.loglog(sizes, last * sizes / sizes[-1], ":", color=SOFT, lw=1.0)
        axes.plot([1.2e6], [8.7], "D", color="#1d2733", ms=6, label="the paper, on its machine: 8.7 s")
        axes.set_xlabel("points")
        axes.set_ylabel("seconds")
        axes.legend(frameon=False, labelcolor=SOFT, fontsize=9)
        save(figure, path)


def draw_contact_points(path: Path, x, y, contact_mm, moved_mm) -> None:
    """Figure 10: deviations of contact points, and what subtracting the radius changes in them."""
    with mpl.rc_context(STYLE):
        width = 4.1
        tall = width * 62 / 102
        figure, height = _sheet(
            "Contact points, and the radius subtracted",
            "left: aligned to the nominal; right: change by the radius subtracted after a vertical look-up",
            1.0 + tall,
        )
        for k, (values, words) in enumerate(
            ((contact_mm, "deviation of the contact points"), (moved_mm, "change of the deviation"))
        ):
            left = 0.6 + 4.45 * k
            axes = figure.add_axes((left / WIDTH_IN, 1.02 / height, width / WIDTH_IN, tall / height))
            known = np.isfinite(values)
            limit = float(np.abs(values[known]).max()) * 1e3
            image = axes.tripcolor(
                x[known],
                y[known],
                values[known] * 1e3,
                shading="gouraud",
                vmin=-limit,
                vmax=limit,
                cmap=ListedColormap(deviation_colours()),
                rasterized=True,
            )
            axes.set_aspect("equal")
            axes.set_title(words, loc="left", fontsize=10, weight="bold", pad=7)
            axes.set_xlabel("x, mm")
            if k == 0:
                axes.set_ylabel("y, mm")
            else:
                axes.tick_params(labelleft=False)
            _bar(figure, image, (left / WIDTH_IN, 0.42 / height, width / WIDTH_IN, 0.09 / height), "µm")
        save(figure, path)
