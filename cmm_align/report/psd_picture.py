"""The spectral density of a map over its wavelengths, with the noise floor and the cutoffs of the filter."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import ArrayLike

from cmm_align.errors import GeometryError
from cmm_align.model import DeviationMap, Spectrum
from cmm_align.report.canvas import INK, SOFT, STYLE, WIDTH_IN, save, three_digits
from cmm_align.report.chart import ABOVE, BELOW, FOOT_IN, PALE, chart, chart_sheet
from cmm_align.report.wording import minus
from cmm_align.surfaces.protocol import Array

_BODY_IN: Final = 4.7
_TOP_IN: Final = 0.62
_LEFT_IN: Final = 0.95
_WIDE_IN: Final = 5.6
_TABLE_IN: Final = 7.0
_DOTTED: Final = (0, (1.5, 1.5))
_DECADES_BELOW_FLOOR: Final = 1.5
"""What lies further below the floor of the noise is not shown: it says nothing of the part."""


def draw_psd(
    deviation_map: DeviationMap, path: Path | str, title: str = "Spectral density", source: str = ""
) -> None:
    """Write the radially averaged spectral density, and the RMS of bands as a table.

    Parameters
    ----------
    deviation_map : DeviationMap
    path : path
        Written as SVG where its suffix says so, else as PNG.
    title, source : str
        Headline, and the name of the file behind the map.

    Raises
    ------
    GeometryError
        If the map has no spectrum.
    """
    m, spectrum = deviation_map, deviation_map.spectrum
    if spectrum is None or not spectrum.frequency_per_mm:
        why = "a file of an older version" if spectrum is None else spectrum.missing
        raise GeometryError(f"there is no spectrum ({why})", remedy="map the alignment anew, on a finer grid")
    with mpl.rc_context(STYLE):
        lines = ["two-sided spectral density of the map, averaged over all directions, plane removed"]
        if m.filter is not None:
            lines.append(f"filtered: {m.filter.words}")
        figure, height_in = chart_sheet(m, _BODY_IN, title, source, lines)
        axes = chart(figure, _LEFT_IN, FOOT_IN, _WIDE_IN, _BODY_IN - _TOP_IN, grid="both")
        _curve(axes, spectrum)
        _cutoffs(axes, m)
        _axes(axes)
        _bands(figure, height_in, spectrum)
        handles, labels = axes.get_legend_handles_labels()
        figure.legend(
            handles[::-1],
            labels[::-1],
            loc="lower left",
            bbox_to_anchor=((_TABLE_IN - 0.02) / WIDTH_IN, FOOT_IN / height_in),
            frameon=False,
            fontsize=8.5,
            labelcolor=SOFT,
            borderpad=0.0,
            borderaxespad=0.0,
        )
        save(figure, path)


def _curve(axes: Axes, spectrum: Spectrum) -> None:
    """Draw the density with its scatter, and the floor of the noise."""
    frequency, psd, freedom = (
        np.array(a) for a in (spectrum.frequency_per_mm, spectrum.psd_um2_mm2, spectrum.freedom)
    )
    floor, most = spectrum.noise_floor_um2_mm2, float(psd.max())
    bottom = most * 1e-9
    if np.isfinite(floor) and floor > 0.0:
        bottom = floor * 10.0**-_DECADES_BELOW_FLOOR
        axes.axhline(floor, color=ABOVE, lw=1.4, ls=_DOTTED, zorder=3, label="noise of the points")
        axes.axhspan(bottom * 1e-3, floor, color=PALE, alpha=0.22, lw=0.0, zorder=0)
    bottom = max(bottom, most * 1e-12, float(np.min(psd[psd > 0.0], initial=most)) * 0.5)
    spread = 2.0 * np.sqrt(2.0 / np.maximum(freedom, 2.0))
    low, high = psd / (1.0 + spread), psd * (1.0 + spread)
    axes.fill_between(
        frequency, low, high, color=PALE, alpha=0.6, lw=0.0, zorder=2, label="its scatter, k = 2"
    )
    axes.plot(frequency, psd, color=INK, lw=1.5, zorder=4, label="the map")
    axes.set(xscale="log", yscale="log", ylim=(bottom, 3.0 * most))
    axes.set_xlim(frequency[0] * 0.92, 0.5 / (0.5 * spectrum.shortest_mm) * 1.02)


def _cutoffs(axes: Axes, m: DeviationMap) -> None:
    """Mark the cutoffs of the filter."""
    if m.filter is None:
        return
    for name, cutoff_mm in (("low pass", m.filter.low_pass_mm), ("high pass", m.filter.high_pass_mm)):
        if cutoff_mm > 0.0:
            axes.axvline(1.0 / cutoff_mm, color=BELOW, lw=1.1, ls=(0, (5, 3)), zorder=3)
            axes.annotate(
                f"{name} {cutoff_mm:g} mm",
                (1.0 / cutoff_mm, 0.03),
                xycoords=("data", "axes fraction"),
                xytext=(4, 0),
                textcoords="offset points",
                rotation=90,
                va="bottom",
                fontsize=8.5,
                color=BELOW,
            )


def _axes(axes: Axes) -> None:
    """Label frequency below, wavelength above, and density at the left."""
    axes.set(xlabel="spatial frequency, 1/mm", ylabel="spectral density, µm² mm²")
    ones = LogLocator(subs=(1.0, 2.0, 5.0))
    short = FuncFormatter(lambda value, _: minus(float(f"{value:.3g}")))
    axes.xaxis.set_major_locator(ones)
    axes.xaxis.set_major_formatter(short)
    axes.xaxis.set_minor_formatter(NullFormatter())
    both: Any = (_inverse, _inverse)  # matplotlib's stub wants functions of anything array-like
    above = axes.secondary_xaxis("top", functions=both)
    above.set_xlabel("wavelength, mm", labelpad=6)
    above.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    above.xaxis.set_major_formatter(short)
    above.xaxis.set_minor_formatter(NullFormatter())


def _length(value_mm: float) -> str:
    """Return a wavelength with three digits that count, without an exponent."""
    return f"{value_mm:.0f}" if value_mm >= 100.0 else f"{value_mm:.3g}"


def _inverse(values: ArrayLike) -> Array:
    """Return wavelengths of frequencies, or the other way round."""
    with np.errstate(divide="ignore"):
        inverse: Array = 1.0 / np.asarray(values, dtype=np.float64)
    return inverse


def _bands(figure: Figure, height_in: float, spectrum: Spectrum) -> None:
    """Write the RMS of each band at the right, and what noise alone has there."""
    rows = [("waves, mm", "RMS, µm", "noise, µm")]
    for band in reversed(spectrum.bands):
        noise = three_digits(band.noise_rms_um) if np.isfinite(band.noise_rms_um) else "\N{EN DASH}"
        rows.append(
            (
                f"{_length(band.short_mm)} \N{EN DASH} {_length(band.long_mm)}",
                three_digits(band.band_rms_um),
                noise,
            )
        )
    top_in = FOOT_IN + _BODY_IN - 0.12
    for k, row in enumerate(rows):
        y = (top_in - 0.27 * k - (0.08 if k else 0.0)) / height_in
        for x_in, text, side in zip((0.0, 1.58, 2.26), row, ("left", "right", "right"), strict=True):
            colour = SOFT if k == 0 or x_in != 1.58 else INK
            x = (_TABLE_IN + x_in) / WIDTH_IN
            figure.text(x, y, text, ha=side, va="center", fontsize=8.5, color=colour)
    y = (top_in - 0.27 * len(rows) - 0.06) / height_in
    words = "A map averages its points: at its\nshortest waves it lies below their noise."
    figure.text(_TABLE_IN / WIDTH_IN, y, words, fontsize=8, color=SOFT, va="top", linespacing=1.4)
