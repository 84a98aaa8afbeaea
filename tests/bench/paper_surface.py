"""Figures 2 to 4 of the paper: are the points dense enough, the equidistant surface, slope and curvature."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from bench_table import Line, met, write_csv
from paper_pictures import draw_density, draw_equidistant
from scipy.ndimage import gaussian_filter
from window_cloud import SURFACE, cloud, grid_nominal

from cmm_align.numerics.triangle_net import triangle_net
from cmm_align.report.nominal_picture import draw_nominal
from cmm_align.surfaces.distance import facet_measure, smooth_measure
from cmm_align.surfaces.geometry import gaussian_curvature_per_mm2, slope
from cmm_align.virtual.window import TIP_RADIUS_MM

NM = 1e6
ROUGHNESS_MM = 1e-3
"""RMS of the simulated error along the normal."""
CORRELATION_MM = 4.0


def correlated(nx: int, ny: int, step_x: float, step_y: float, seed: int = 5):
    """A Gaussian random surface with a Gaussian autocovariance, shape (ny, nx), mm."""
    white = np.random.default_rng(seed).standard_normal((ny, nx))
    width = CORRELATION_MM / 2.0  # a kernel of half the width makes this autocovariance
    field = gaussian_filter(white, (width / step_y, width / step_x), mode="reflect")
    return ROUGHNESS_MM * field / field.std()


def density(folder: Path, nodes: tuple[int, int], stride: int) -> list[Line]:
    """Figure 2: deviations by facets and by the smooth surface against the simulated error."""
    nominal = grid_nominal(nodes)
    net = nominal.equidistant
    b = SURFACE.bounds
    step_x, step_y = (b.x_max - b.x_min) / (nodes[0] - 1), (b.y_max - b.y_min) / (nodes[1] - 1)
    x = b.x_min + step_x * (np.arange(0, nodes[0] - 1, stride) + 0.5)
    y = b.y_min + step_y * (np.arange(0, nodes[1] - 1, stride) + 0.5)
    error = correlated(len(x), len(y), stride * step_x, stride * step_y)
    px, py = (a.ravel() for a in np.meshgrid(x, y))
    at = cloud(px, py, error.ravel())
    points = at.centres_mm - TIP_RADIUS_MM * at.normals
    facets = facet_measure(triangle_net(net.nominal_points_mm, net.triangles), nominal.side)
    smooth = smooth_measure(nominal.surface, nominal.side, 0.0)
    off = [m.distance(points, None)[0].distance_mm.reshape(error.shape) - error for m in (facets, smooth)]
    pv = [NM * float(np.ptp(o)) for o in off]
    rms = [NM * float(np.sqrt(np.mean(o**2))) for o in off]
    write_csv(
        folder / "fig2_density.csv",
        ("method", "nodes_x", "nodes_y", "points", "error_pv_nm", "error_rms_nm"),
        [(name, *nodes, error.size, p, r) for name, p, r in zip(("facets", "smooth"), pv, rms, strict=True)],
    )
    draw_density(folder / "fig2_density.png", x, y, error, off[0], off[1])
    return [
        Line(
            "Fig. 2: error of point-to-triangle distances, PV",
            "paper: 5 nm",
            f"{pv[0]:.2g} nm between nodes, slopes to 45°",
        ),
        Line("Fig. 2: the same by our smooth surface", "≤ 5 nm", f"{pv[1]:.1e} nm", met(pv[1], 5.0)),
    ]


def equidistant(folder: Path, nodes: tuple[int, int]) -> list[Line]:
    """Figures 3 and 4: the equidistant surface and what slope and curvature of it are."""
    nominal = grid_nominal(nodes)
    net = nominal.equidistant
    jet = SURFACE.jet(*net.nominal_points_mm[:, :2].T)
    away = smooth_measure(SURFACE, 1, TIP_RADIUS_MM).distance(net.points_mm, None)[0].distance_mm
    inside = np.isfinite(away)
    spread = 3.0 * float(np.std(away[inside]))
    largest = float(np.abs(away[inside]).max())
    steep = float(np.abs(net.slope - slope(jet)).max())
    true = gaussian_curvature_per_mm2(jet)
    bent = float(np.abs(net.gaussian_curvature_per_mm2 - true).max() / np.abs(true).max())
    write_csv(
        folder / "fig3_4_equidistant.csv",
        (
            "nodes_x",
            "nodes_y",
            "tip_radius_mm",
            "offset_error_max_nm",
            "offset_error_3sigma_nm",
            "max_slope_deg",
            "slope_error_max",
            "gauss_min_per_mm2",
            "gauss_max_per_mm2",
            "gauss_error_relative",
        ),
        [
            (
                *nodes,
                TIP_RADIUS_MM,
                NM * largest,
                NM * spread,
                nominal.quality.max_slope_deg,
                steep,
                float(true.min()),
                float(true.max()),
                bent,
            )
        ],
    )
    draw_equidistant(folder / "fig3_equidistant.png", net.nominal_points_mm, net.points_mm, nodes)
    draw_nominal(nominal, folder / "fig4_slope_curvature.png", "Slope and curvature of the window")
    return [
        Line(
            "Fig. 3: error of the radius compensation, 3σ",
            "paper: < 50 nm",
            f"{NM * spread:.1e} nm",
            met(NM * spread, 50.0),
        ),
        Line(
            "Fig. 4: slope against the closed form",
            "≤ 1e-7",
            f"{steep:.0e}, to {nominal.quality.max_slope_deg:.1f}°",
            met(steep, 1e-7),
        ),
        Line(
            "Fig. 4: Gaussian curvature against the closed form, relative",
            "≤ 1e-4",
            f"{bent:.0e}",
            met(bent, 1e-4),
        ),
    ]
