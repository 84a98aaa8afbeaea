"""The questions that the gate asks of a file; every answer has its number and its limit."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from cmm_align.model import Correction, GateCheck
from cmm_align.stages.told_surface import Found, ToldSurface
from cmm_align.stages.wheel_check import MOST_OVERCUT_MM, DepthCheck, WheelCheck
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.protocol import Array, Jet
from cmm_align.units import MRAD_PER_RAD, NM_PER_MM, UM_PER_MM, mm_per

ROUNDING_MM: Final = mm_per("nm")
"""What decimals may cost, along the normal."""
FLOAT_MM: Final = 5e-8
"""What float64 and a spline through nodes may cost on top."""
RIPPLE_MM: Final = 5e-6
"""RMS from point to point that a file may add."""
SLOPE: Final = 0.02
"""How far the regression of what a file changes on what was meant may be from 1."""
Z_SLOPE: Final = 0.5
"""Regression on ``|n_z| - 1`` from which on a file looks like e_n written as dz, which gives 1."""
HARMLESS: Final = 0.02
"""``1 - |n_z|`` up to which e_n written as dz leaves no more than this share: 11 degrees."""
FRAME_MM: Final = 1e-3
"""How far off the nominal a point may lie beside the largest correction."""
NORMALS_RAD: Final = 2e-5
NORMALS_SHARE: Final = 0.2
"""Share of the change of slope by which normals may be off, beside that: of normals on a coarse grid."""
ABOVE_BAND: Final = 0.05
"""Share of the RMS of a correction that may lie in waves below half of the shortest one."""
_BELOW: Final = 2.0
_SIGMA_PER_CUTOFF: Final = 0.1874
"""Of the areal Gaussian, ISO 16610-61."""
_LEAST_SIGMA: Final = 0.6
"""In steps: a narrower Gaussian, sampled, keeps the shortest wave of a grid."""


def coverage_check(told: ToldSurface, found: Found, reach_mm: float) -> tuple[GateCheck, Array | None]:
    """Ask whether every commanded node has a point near; return also what is off, on the grid.

    Parameters
    ----------
    told : ToldSurface
    found : Found
    reach_mm : float
        How far away the nearest point may be; 0 if it must be at the node.

    Returns
    -------
    check : GateCheck
    off_mm : ndarray, shape (ny, nx), mm, or None
        Mean of the points at a node; where there are none, that of the nearest node. None where no point lies
        over the aperture.
    """
    shape = told.total_mm.shape
    off = found.off_mm
    good = np.isfinite(off)
    count = np.bincount(found.node[good], minlength=told.total_mm.size).reshape(shape)
    total = np.bincount(found.node[good], weights=off[good], minlength=told.total_mm.size).reshape(shape)
    empty = count == 0
    if empty.all():
        return _check("coverage", False, 100.0, 0.0, "%", "no point lies over the part"), None
    grid = total / np.maximum(count, 1)
    bare = told.known & empty
    if empty.any():
        step = (float(told.y_mm[1] - told.y_mm[0]), float(told.x_mm[1] - told.x_mm[0]))
        distance, nearest = distance_transform_edt(empty, sampling=step, return_indices=True)
        grid = grid[nearest[0], nearest[1]]
        bare &= distance > reach_mm
    share = 100.0 * float(np.count_nonzero(bare)) / max(int(np.count_nonzero(told.known)), 1)
    words = f"{share:.3g} % of the commanded surface has no point in the file"
    return _check("coverage", not bare.any(), share, 0.0, "%", words), grid


def frame_check(told: ToldSurface, found: Found, accuracy_mm: float) -> GateCheck:
    """Ask whether the points lie on the nominal, up to the largest sum of corrections."""
    beside = float(np.mean(~np.isfinite(found.off_mm)))
    largest = float(np.nanmax(np.abs(told.total_mm)))
    limit = largest + FRAME_MM + accuracy_mm
    known = np.abs(found.total_mm[np.isfinite(found.total_mm)])
    farthest = float(known.max(initial=0.0))
    if beside > 0.0:
        words = f"{100.0 * beside:.3g} % of the points lie beside the aperture, others up to "
    else:
        words = "points lie up to "
    words += f"{farthest * UM_PER_MM:.4g} um off the nominal, at most {limit * UM_PER_MM:.4g} um were told"
    return _check("frame", beside == 0.0 and farthest <= limit, *_um(farthest, limit), "um", words)


def sign_check(change: Array, meant: Array, deviation: Array, accuracy_mm: float) -> GateCheck:
    """Ask whether what the file changes is what was meant, and takes off where there is too much.

    Parameters
    ----------
    change, meant, deviation : ndarray, shape (n,), mm
        At the measured points.
    accuracy_mm : float
    """
    size = float(np.sqrt(np.mean(meant**2)))
    if size <= 10.0 * accuracy_mm:
        return _check("sign", True, None, None, "", "nothing is corrected: there is no sign to check")
    slope = float(change @ meant / (meant @ meant))
    limit = SLOPE + 2.0 * accuracy_mm / size
    against = float(-change @ deviation)
    rho = against / max(float(np.linalg.norm(change) * np.linalg.norm(deviation)), 1e-300)
    words = f"what the file changes is {slope:+.4f} times what was meant, its correlation with -e {rho:+.2f}"
    return _check("sign", abs(slope - 1.0) <= limit and against > 0.0, slope, 1.0, "", words)


def z_check(told: ToldSurface, found: Found, accuracy_mm: float) -> tuple[GateCheck, Array]:
    """Ask whether e_n was written as dz; on flat parts that is harmless, and only said.

    Returns
    -------
    check : GateCheck
    explained_mm : ndarray, shape (n,), mm
        What that explains of what is off where it is harmless; zero elsewhere.
    """
    loss = np.abs(found.n_z) - 1.0
    z = found.told_mm * loss
    known = np.isfinite(found.off_mm)
    weight = float(z[known] @ z[known])
    most = float(np.abs(z[known]).max(initial=0.0))
    none = np.zeros_like(z)
    if most <= ROUNDING_MM + 3.0 * accuracy_mm:
        words = "the part is too flat, or corrected too little, to tell e_n from dz, and for them to matter"
        return _check("Z against normal", True, None, None, "", words), none
    slope = float(found.off_mm[known] @ z[known]) / weight
    flat = float(np.max(-loss[known])) <= HARMLESS
    suspect = slope > Z_SLOPE
    words = f"regression on |n_z| - 1: {slope:+.3f}, 0 is right and 1 is e_n written as dz"
    if suspect:
        words += f": it costs up to {most * UM_PER_MM:.3g} um" + (
            ", harmless on so flat a part" if flat else ""
        )
    check = _check("Z against normal", flat or not suspect, slope, Z_SLOPE, "", words)
    return check, np.where(known, slope * z, 0.0) if flat and suspect else none


def rounding_check(found: Found, explained_mm: Array) -> GateCheck:
    """Ask how far the file is off what was told, along the normal: not by more than 1 nm.

    Parameters
    ----------
    found : Found
    explained_mm : ndarray, shape (n,), mm
    """
    off = np.abs(found.off_mm - explained_mm) - found.unsure_mm
    largest = float(np.nanmax(off, initial=0.0))
    limit = ROUNDING_MM + FLOAT_MM
    words = f"{largest * NM_PER_MM:.2g} nm off what was told, along the normal"
    return _check("rounding", largest <= limit, *_nm(largest, limit), "nm", words)


def ripple_check(found: Found, explained_mm: Array) -> GateCheck:
    """Ask whether the file steps from point to point: a staircase of too few decimals.

    Parameters
    ----------
    found : Found
        In the order of the file.
    explained_mm : ndarray, shape (n,), mm
    """
    off = found.off_mm - explained_mm
    second = off[2:] - 2.0 * off[1:-1] + off[:-2]
    sure = found.unsure_mm == 0.0
    second = second[np.isfinite(second) & sure[2:] & sure[1:-1] & sure[:-2]]
    # White noise of variance 1 has second differences of variance 1 + 4 + 1.
    ripple = float(np.sqrt(np.mean(second**2) / 6.0)) if len(second) else 0.0
    words = f"{ripple * NM_PER_MM:.2g} nm RMS from point to point"
    return _check("ripple", ripple <= RIPPLE_MM, *_nm(ripple, RIPPLE_MM), "nm", words)


def normals_check(told: ToldSurface, found: Found, normals: Array, side: int) -> GateCheck:
    """Ask whether the normals of a file are those of the surface that stands in it.

    At nodes the slope of that surface is that of the nominal and the central difference of what lies on it;
    elsewhere that of the spline. Borders have no central differences and are left out.

    Parameters
    ----------
    told : ToldSurface
    found : Found
    normals : ndarray, shape (n, 3), frame `surface`
    side : int
    """
    slope_x, slope_y, bare = _slopes(told, found)
    known = np.isfinite(slope_x) & np.isfinite(slope_y)
    nothing = np.zeros(int(known.sum()))
    bare_x, bare_y = bare[0][known], bare[1][known]
    jet = Jet(nothing, bare_x + slope_x[known], bare_y + slope_y[known], nothing, nothing, nothing)
    right, old = unit_normal(jet, side), unit_normal(jet._replace(zx=bare_x, zy=bare_y), side)
    off = np.linalg.norm(normals[known] - right, axis=1)
    turned = float(np.linalg.norm(right - old, axis=1).max(initial=0.0))
    worst = float(off.max(initial=0.0))
    limit = NORMALS_RAD + NORMALS_SHARE * turned
    words = (
        f"normals are up to {worst * MRAD_PER_RAD:.3g} mrad off those of the surface in the file; the "
        f"correction turns them by up to {turned * MRAD_PER_RAD:.3g} mrad"
    )
    return _check("normals", worst <= limit, worst * MRAD_PER_RAD, limit * MRAD_PER_RAD, "mrad", words)


def band_check(told: ToldSurface, correction: Correction, off_mm: Array) -> GateCheck:
    """Ask whether the file holds waves far below the shortest one that is corrected.

    Parameters
    ----------
    told : ToldSurface
    correction : Correction
    off_mm : ndarray, shape (ny, nx), mm
        What is off, on the grid.
    """
    if correction.band is None:
        return _check("band", True, None, None, "", "the band of the correction is not known")
    cutoff = correction.band.low_pass_mm / _BELOW
    change = correction.correction_mm + off_mm
    known = np.isfinite(change)
    steps = float(told.y_mm[1] - told.y_mm[0]), float(told.x_mm[1] - told.x_mm[0])
    sigma = [max(_SIGMA_PER_CUTOFF * cutoff / step, _LEAST_SIGMA) for step in steps]
    short, inner = np.where(known, change, 0.0), known
    for _ in range(2):  # twice, so that a wave at the limit leaves 3 % and not 16 %
        weight = gaussian_filter(inner.astype(np.float64), sigma, mode="constant")
        inner = inner & (weight > 1.0 - 1e-4)  # at a border the mean of a slope is no measure
        short = np.where(inner, short - gaussian_filter(short, sigma, mode="constant"), 0.0)
    size = float(np.sqrt(np.mean(change[known] ** 2)))
    if not inner.any() or size <= ROUNDING_MM:
        return _check("band", True, None, None, "", "nothing to look for waves in")
    rest = float(np.sqrt(np.mean(short[inner] ** 2)))
    passed = rest <= ABOVE_BAND * size or rest <= ROUNDING_MM
    share = 100.0 * rest / size
    words = f"{share:.2g} % of the correction is in waves below {cutoff:.3g} mm"
    return _check("band", passed, share, 100.0 * ABOVE_BAND, "%", words)


def rms_check(deviation: Array, change: Array, accuracy_mm: float) -> GateCheck:
    """Ask whether the RMS of the measured points falls if a machine does as the file says.

    Parameters
    ----------
    deviation, change : ndarray, shape (n,), mm
        At the measured points.
    accuracy_mm : float
    """
    before, after = (float(np.sqrt(np.mean(e**2))) for e in (deviation, deviation + change))
    nothing = float(np.sqrt(np.mean(change**2))) <= 10.0 * accuracy_mm
    words = f"measured again, RMS {before * UM_PER_MM:.4g} -> {after * UM_PER_MM:.4g} um"
    return _check("RMS", after < before or nothing, *_um(after, before), "um", words)


def gouge_check(wheel: WheelCheck) -> GateCheck:
    """Tell what the wheel takes off below the commanded surface."""
    words = f"the wheel overcuts by {wheel.overcut_mm * NM_PER_MM:.2g} nm"
    passed = wheel.overcut_mm <= MOST_OVERCUT_MM
    return _check("gouge", passed, *_um(wheel.overcut_mm, MOST_OVERCUT_MM), "um", words)


def air_check(depth: DepthCheck) -> GateCheck:
    """Tell how deep the wheel cuts where it cuts least."""
    words = f"the wheel cuts at least {depth.least_mm * UM_PER_MM:.3g} um everywhere"
    return _check("air cut", depth.least_mm >= 0.0, *_um(depth.least_mm, 0.0), "um", words)


def _slopes(told: ToldSurface, found: Found) -> tuple[Array, Array, tuple[Array, Array]]:
    """Return the slopes of what a file adds to the nominal, and those of the nominal, at its points."""
    node = found.node
    shape = told.total_mm.shape
    if found.on_node.all():
        more = np.full(shape, np.nan)
        more.ravel()[node] = found.total_mm / found.n_z
        x, y = (float(a[1] - a[0]) for a in (told.x_mm, told.y_mm))
        slope_x, slope_y = (np.full(shape, np.nan) for _ in range(2))
        slope_x[:, 1:-1] = (more[:, 2:] - more[:, :-2]) / (2.0 * x)
        slope_y[1:-1] = (more[2:] - more[:-2]) / (2.0 * y)
        bare = told.jet.zx.ravel()[node], told.jet.zy.ravel()[node]
        return slope_x.ravel()[node], slope_y.ravel()[node], bare
    jet = told.nominal_at(found.x_mm, found.y_mm)
    spline = told.height_spline(found.x_mm, found.y_mm)
    sure = told.inner.ravel()[node]
    return np.where(sure, spline.zu, np.nan), np.where(sure, spline.zv, np.nan), (jet.zx, jet.zy)


def _check(
    name: str, passed: bool, value: float | None, limit: float | None, unit: str, words: str
) -> GateCheck:
    return GateCheck(name, bool(passed), value, limit, unit, words)


def _um(value: float, limit: float) -> tuple[float, float]:
    return value * UM_PER_MM, limit * UM_PER_MM


def _nm(value: float, limit: float) -> tuple[float, float]:
    return value * NM_PER_MM, limit * NM_PER_MM
