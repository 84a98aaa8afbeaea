"""Stage 4: the surface to command next.

Method. The control law works on what was commanded, not on the nominal: with the deviation e of
pass k along the normal n, ``P[k+1] = P[k] - gain e n``. On a grid over the nominal's aperture this is
a total correction along n relative to the nominal, the sum over the passes, and the commanded height
is ``z = s + total / n_z``; with ``total`` in its place a slope of 45 degrees would keep 29 % of its error.
Where the map is unknown the correction is continued from its neighbours as a membrane, never by a
polynomial, and flagged. The commanded normals are those of the corrected surface.

Sign: excess material is a positive deviation and a negative correction. For a probe on the +z side
the commanded surface then lies lower than the nominal, on the -z side higher: n_z carries the sign.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import Final

import numpy as np

from cmm_align.config import CompensateConfig
from cmm_align.errors import InputError, UsageError, WrongStageError
from cmm_align.model import Correction, DeviationMap, Statistics, frozen_array
from cmm_align.numerics.grid_field import continued, interpolated
from cmm_align.stages.deviation_statistics import deviation_statistics
from cmm_align.surfaces.protocol import Array, Bounds, Jet, Mask
from cmm_align.units import UM_PER_MM

DEFAULTS: Final = CompensateConfig()

MAX_GAIN: Final = 1.2
"""The loop stays well inside its limit of 2 even for a process that cuts more than it is told."""

MIN_IMPROVEMENT: Final = 0.2
"""Another pass is worth it if the RMS falls by at least this share ..."""

MIN_SIGNIFICANCE: Final = 2.0
"""... and by more than this many standard uncertainties of the RMS."""

MAX_NODES: Final = 4096
"""Most nodes along a side of the commanded grid."""


def compensate(
    deviation_map: DeviationMap,
    config: CompensateConfig = DEFAULTS,
    previous: Correction | None = None,
) -> Correction:
    """Return the correction of a map and the surface to command next.

    Parameters
    ----------
    deviation_map : DeviationMap
        Measured after the last pass.
    config : CompensateConfig
        Gain and limits.
    previous : Correction, optional
        What was commanded in the last pass; without it, the nominal was.

    Returns
    -------
    Correction
        Complete over the nominal's aperture, NaN outside; grid as the map's, carried on to the
        bounds of the nominal.

    Raises
    ------
    UsageError
        If the gain is outside (0, 1.2].
    WrongStageError
        If the long waves were filtered out of the map, or `previous` belongs to another nominal, or has
        applied this map already.
    InputError
        If a correction is larger than the limit.
    """
    if not 0.0 < config.gain <= MAX_GAIN:
        raise UsageError(f"gain = {config.gain:g}", expected=f"more than 0 and at most {MAX_GAIN:g}")
    if deviation_map.filter is not None and deviation_map.filter.high_pass_mm > 0.0:
        raise WrongStageError(
            f"the map is filtered ({deviation_map.filter.words}): its form is not in it",
            expected="a map with all long waves",
            remedy="make it anew without --high-pass",
        )
    digest = map_digest(deviation_map)
    _check_previous(deviation_map, digest, previous)
    _check_size(deviation_map, config)
    nominal = deviation_map.alignment.nominal
    x_mm, before_x = _carried_on(deviation_map.x_mm, *nominal.surface.bounds[:2])
    y_mm, before_y = _carried_on(deviation_map.y_mm, *nominal.surface.bounds[2:])
    _check_grid(x_mm, y_mm, nominal.surface.bounds)

    deviation = np.full((len(y_mm), len(x_mm)), np.nan)
    ny, nx = deviation_map.deviation_mm.shape
    deviation[before_y : before_y + ny, before_x : before_x + nx] = deviation_map.deviation_mm
    correction = -config.gain * continued(deviation)
    total = correction + _total_so_far(previous, x_mm, y_mm)

    x_grid, y_grid = np.meshgrid(x_mm, y_mm)
    inside = nominal.surface.contains(x_grid.ravel(), y_grid.ravel()).reshape(x_grid.shape)
    jet = Jet(*(a.reshape(x_grid.shape) for a in nominal.surface.jet(x_grid.ravel(), y_grid.ravel())))
    height, normal = _commanded(jet, nominal.side, total, x_mm, y_mm)
    before, predicted = _prediction(deviation_map, x_mm, y_mm, correction, config.gain)
    worth, reason = _worth(before, predicted, deviation_map.u_rms_mm)
    return Correction(
        nominal=nominal,
        x_mm=frozen_array(x_mm),
        y_mm=frozen_array(y_mm),
        correction_mm=_masked(correction, inside),
        total_correction_mm=_masked(total, inside),
        commanded_z_mm=_masked(height, inside),
        commanded_normal=_masked(normal, inside[..., None]),
        extended=frozen_array(inside & np.isnan(deviation), np.bool_),
        gain=config.gain,
        pass_number=1 if previous is None else previous.pass_number + 1,
        predicted=predicted,
        before=before,
        worth_another_pass=worth,
        reason=reason,
        map_digest=digest,
        applied_maps=() if previous is None else (*previous.applied_maps, previous.map_digest),
    )


def map_digest(deviation_map: DeviationMap) -> str:
    """Return the SHA-256 (hex) of the measured points behind a map.

    Another spacing, filter or alignment of the same measurement is still the same measurement: it must
    not be ground away twice.
    """
    points = deviation_map.alignment.tip_centre_machine_mm
    return hashlib.sha256(np.ascontiguousarray(points, dtype="<f8").tobytes()).hexdigest()


def _check_previous(deviation_map: DeviationMap, digest: str, previous: Correction | None) -> None:
    """Refuse a previous pass of another part, or one that has this map in it."""
    if previous is None:
        return
    wanted, found = deviation_map.alignment.nominal.digest, previous.nominal.digest
    if found != wanted:
        raise WrongStageError(
            "the previous pass was made for another nominal",
            expected=f"nominal {wanted[:12]}, found {found[:12]}",
            remedy="give the correction of this part",
        )
    if digest in (*previous.applied_maps, previous.map_digest):
        raise WrongStageError(
            "this map is in the previous pass already: it would be applied twice",
            expected="a map measured after that pass was ground",
            remedy="measure the part again, or leave --previous out",
        )


def _check_size(deviation_map: DeviationMap, config: CompensateConfig) -> None:
    """Refuse a correction over the limit, naming its place and size."""
    size_um = config.gain * np.abs(deviation_map.deviation_mm) * UM_PER_MM
    iy, ix = np.unravel_index(int(np.nanargmax(size_um)), size_um.shape)
    if size_um[iy, ix] > config.max_correction_um:
        place = f"({deviation_map.x_mm[ix]:.3f}, {deviation_map.y_mm[iy]:.3f}) mm"
        raise InputError(
            f"a correction of {size_um[iy, ix]:.1f} um at {place}",
            expected=f"at most {config.max_correction_um:g} um",
            remedy="check units, tip radius and side; if it is real, raise max_correction_um",
        )


def _carried_on(nodes_mm: Array, low_mm: float, high_mm: float) -> tuple[Array, int]:
    """Return nodes carried on past both limits by the same step, and how many were put before."""
    step = nodes_mm[1] - nodes_mm[0]
    before = max(int(np.ceil((nodes_mm[0] - low_mm) / step - 1e-9)), 0)
    after = max(int(np.ceil((high_mm - nodes_mm[-1]) / step - 1e-9)), 0)
    start, end = nodes_mm[0] - step * np.arange(before, 0, -1), nodes_mm[-1] + step * np.arange(1, after + 1)
    return np.concatenate([start, nodes_mm, end]), before


def _check_grid(x_mm: Array, y_mm: Array, bounds: Bounds) -> None:
    """Refuse an aperture that is far larger than what was measured."""
    if max(len(x_mm), len(y_mm)) > MAX_NODES:
        raise InputError(
            f"the aperture ({bounds.x_max - bounds.x_min:.4g} x {bounds.y_max - bounds.y_min:.4g} mm) takes "
            f"{len(x_mm)} x {len(y_mm)} nodes at the spacing of the map",
            expected=f"at most {MAX_NODES} along a side",
            remedy="make the map with a larger spacing, or the nominal with a smaller aperture",
        )


def _total_so_far(previous: Correction | None, x_mm: Array, y_mm: Array) -> Array:
    """Return the total correction of the earlier passes on this grid, complete, mm."""
    shape = (len(y_mm), len(x_mm))
    if previous is None:
        return np.zeros(shape)
    x_grid, y_grid = np.meshgrid(x_mm, y_mm)
    field = continued(previous.total_correction_mm)
    return continued(
        interpolated(previous.x_mm, previous.y_mm, field, x_grid.ravel(), y_grid.ravel()).reshape(shape)
    )


def _commanded(jet: Jet, side: int, total: Array, x_mm: Array, y_mm: Array) -> tuple[Array, Array]:
    """Return height (ny, nx), mm, and unit normals (ny, nx, 3) of ``z = s + total / n_z``.

    With ``1 / n_z = side w``, ``w = sqrt(1 + s_x^2 + s_y^2)``, the gradient is that of s plus
    ``side (w grad(total) + total grad(w))``; only ``grad(total)`` is taken from the grid (second order).
    """
    w = np.sqrt(1.0 + jet.zx**2 + jet.zy**2)
    total_y, total_x = np.gradient(total, y_mm, x_mm, edge_order=2 if min(total.shape) >= 3 else 1)
    zx = jet.zx + side * (w * total_x + total * (jet.zx * jet.zxx + jet.zy * jet.zxy) / w)
    zy = jet.zy + side * (w * total_y + total * (jet.zx * jet.zxy + jet.zy * jet.zyy) / w)
    scale = side / np.sqrt(1.0 + zx**2 + zy**2)
    return jet.z + side * w * total, np.stack([-zx * scale, -zy * scale, scale], axis=-1)


def _prediction(
    deviation_map: DeviationMap, x_mm: Array, y_mm: Array, correction: Array, gain: float
) -> tuple[Statistics, Statistics]:
    """Return the deviations of the points now, and with the correction at their places added.

    The correction was made from the noise of these very points and so takes some of it off them, which
    it cannot do for the next measurement: with sigma the uncertainty of the map, ``2 gain sigma^2`` is
    missing in the mean square of the sums, and is put back.
    """
    alignment = deviation_map.alignment
    judged = alignment.judged & np.isfinite(alignment.deviation_mm)
    e = alignment.deviation_mm[judged]
    foot_part = alignment.contact_part_mm[judged] - e[:, None] * alignment.normals[judged]
    x, y, _ = alignment.nominal.surface_from_part.apply(foot_part).T
    after = deviation_statistics(e + interpolated(x_mm, y_mm, correction, x, y), x, y)
    sigma = deviation_map.sigma_mm[np.isfinite(deviation_map.sigma_mm)]
    shared = 2.0 * gain * float(np.mean(sigma**2)) if len(sigma) else 0.0
    return deviation_statistics(e, x, y), replace(after, rms_mm=(after.rms_mm**2 + shared) ** 0.5)


def _worth(before: Statistics, predicted: Statistics, u_rms_mm: float) -> tuple[bool, str]:
    """Return whether the next pass pays, and the sentence that says so with its numbers."""
    now, then = before.rms_mm * UM_PER_MM, predicted.rms_mm * UM_PER_MM
    u = u_rms_mm * UM_PER_MM
    pv_now, pv_then = before.pv_mm * UM_PER_MM, predicted.pv_mm * UM_PER_MM
    numbers = f"RMS {now:.2f} -> {then:.2f} um expected, PV {pv_now:.1f} -> {pv_then:.1f} um"
    if now - then <= MIN_SIGNIFICANCE * u:
        return False, f"{numbers}: not worth it, the change is within the uncertainty of the RMS ({u:.2f} um)"
    if now - then < MIN_IMPROVEMENT * now:
        return False, f"{numbers}: not worth it, mostly noise and detail the map does not resolve is left"
    return True, f"{numbers}: worth it"


def _masked(field: Array, inside: Mask) -> Array:
    """Return a read-only field with NaN outside the aperture."""
    result: Array = frozen_array(np.where(inside, field, np.nan))
    return result
