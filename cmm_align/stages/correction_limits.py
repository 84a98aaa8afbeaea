"""Limits of a correction: what is refused, what is warned of, what is counted.

Refused, with place and size: a correction that is too large or too steep, and one that takes more off than
the part has to give; a clipped correction would leave a form that nobody asked for. Warned of: half-steep
ones, where the contact of the wheel moves by ``rho |grad e|`` and the surface errs by ``rho |grad e|^2 /
2``. Continued values past the range of the data are clipped, as nobody measured them, and counted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmm_align.config import CompensateConfig
from cmm_align.errors import InputError
from cmm_align.model import Correction, CorrectionLimits, CorrectionStatus
from cmm_align.stages.correction_grid import gradient
from cmm_align.surfaces.protocol import Array, Jet, Mask
from cmm_align.units import MRAD_PER_RAD, UM_PER_MM


def checked_limits(
    correction_mm: Array,
    status: NDArray[np.uint8],
    inside: Mask,
    x_mm: Array,
    y_mm: Array,
    jet: Jet,
    config: CompensateConfig,
    previous: Correction | None,
    taper_mm: float,
    region: str,
) -> CorrectionLimits:
    """Return the sizes of a correction, if they are within the limits.

    Parameters
    ----------
    correction_mm, status, inside : ndarray, shape (ny, nx)
        Complete; `CorrectionStatus`; the aperture.
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`
    jet : Jet
        Of the nominal, each of shape (ny, nx).
    config : CompensateConfig
    previous : Correction or None
    taper_mm : float
    region : str
        In words.

    Raises
    ------
    InputError
        If the correction is too large, too steep, or takes too much off.
    """
    size_um = np.where(inside, np.abs(correction_mm), -1.0) * UM_PER_MM
    at = np.unravel_index(int(np.argmax(size_um)), size_um.shape)
    if size_um[at] > config.max_correction_um:
        raise InputError(
            f"a correction of {size_um[at]:.1f} um at {_place(x_mm, y_mm, at)}",
            expected=f"at most {config.max_correction_um:g} um",
            remedy="check units, tip radius and side; if it is real, raise max_correction_um",
        )
    slope = np.where(inside, slope_over_surface(correction_mm, x_mm, y_mm, jet), -1.0)
    steepest = np.unravel_index(int(np.argmax(slope)), slope.shape)
    slope_mrad = float(slope[steepest]) * MRAD_PER_RAD
    if slope_mrad > config.max_slope_mrad:
        raise InputError(
            f"a correction with a slope of {slope_mrad:.1f} mrad at {_place(x_mm, y_mm, steepest)}",
            expected=f"at most {config.max_slope_mrad:g} mrad",
            remedy="look at the map there (dirt, a step, a scratch); if it is real, give --low-pass, or "
            "raise max_slope_mrad",
        )
    warnings = []
    if slope_mrad > config.warn_slope_mrad:
        warnings.append(
            f"the correction is steep: {slope_mrad:.1f} mrad at {_place(x_mm, y_mm, steepest)}"
            f"{_shift_words(slope_mrad, config.wheel_radius_mm)}"
        )
    removal = float(np.ptp(correction_mm[inside]))
    total = removal + _removed_before(previous)
    budget = config.thickness_budget_um
    if 0.0 < budget < total * UM_PER_MM:
        raise InputError(
            f"{total * UM_PER_MM:.1f} um to take off in all passes with this one",
            expected=f"at most {budget:g} um (--thickness-budget)",
            remedy="correct less (--gain, --region), or allow for more",
        )
    counts = np.bincount(status[inside], minlength=len(CorrectionStatus))
    return CorrectionLimits(
        max_correction_mm=float(size_um[at]) / UM_PER_MM,
        max_slope_rad=slope_mrad / MRAD_PER_RAD,
        max_slope_at_mm=(float(x_mm[steepest[1]]), float(y_mm[steepest[0]])),
        removal_mm=removal,
        total_removal_mm=total,
        taper_mm=taper_mm,
        n_beyond=int(counts[CorrectionStatus.BEYOND]),
        n_bridged=int(counts[CorrectionStatus.BRIDGED]),
        n_few_points=int(counts[CorrectionStatus.FEW_POINTS]),
        n_outside_region=int(counts[CorrectionStatus.OUTSIDE_REGION]),
        n_clipped=int(counts[CorrectionStatus.CLIPPED]),
        region=region,
        warnings=tuple(warnings),
    )


def slope_over_surface(field_mm: Array, x_mm: Array, y_mm: Array, jet: Jet) -> Array:
    """Return the slope of a field along the surface it lies on, shape (ny, nx), rad.

    ``|grad c|^2 - (grad c . grad s)^2 / (1 + |grad s|^2)``, under the root: on a steep place the way along
    the surface is longer than over the plane.

    Parameters
    ----------
    field_mm : ndarray, shape (ny, nx), mm
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm
    jet : Jet
        Of the surface, each of shape (ny, nx).
    """
    along_y, along_x = gradient(field_mm, x_mm, y_mm)
    uphill = (along_x * jet.zx + along_y * jet.zy) ** 2 / (1.0 + jet.zx**2 + jet.zy**2)
    return np.asarray(np.sqrt(np.maximum(along_x**2 + along_y**2 - uphill, 0.0)))


def _removed_before(previous: Correction | None) -> float:
    """Return what the earlier passes took off, mm."""
    if previous is None:
        return 0.0
    if previous.limits is not None:
        return previous.limits.total_removal_mm
    total = previous.total_correction_mm
    return float(np.nanmax(total) - np.nanmin(total))


def _place(x_mm: Array, y_mm: Array, at: tuple[np.intp, ...]) -> str:
    return f"({x_mm[at[1]]:.3f}, {y_mm[at[0]]:.3f}) mm"


def _shift_words(slope_mrad: float, wheel_mm: float) -> str:
    """Return what a slope does to the contact of the wheel, if its radius is known."""
    if wheel_mm <= 0.0:
        return ""
    slope = slope_mrad / MRAD_PER_RAD
    error_um = 0.5 * wheel_mm * slope**2 * UM_PER_MM
    return f" moves the contact of the wheel by {wheel_mm * slope:.2g} mm ({error_um:.2g} um if ignored)"
