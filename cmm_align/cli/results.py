"""Nouns as JSON: pure functions from what a stage returned to the `result` of ``--json``.

The keys are a contract: they may be joined by others, and none may change its meaning or vanish.
Every number carries its unit in its key; what is not known is null, never NaN.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cmm_align import __version__
from cmm_align.cli.job import Outcome
from cmm_align.errors import InputError
from cmm_align.model import Alignment, Correction, DeviationMap, Nominal, Spectrum, Statistics
from cmm_align.report.alignment_summary import outliers_of
from cmm_align.units import DEG_PER_RAD, MRAD_PER_RAD, NM_PER_MM, UM_PER_MM

if TYPE_CHECKING:
    from cmm_align.stages.plan import MeasuringPlan

SECONDS_PER_MINUTE: Final = 60.0
MOST_OUTLIERS: Final = 1000
"""Outliers that are listed, largest first; the file tells of every point."""


def document(outcome: Outcome) -> dict[str, Any]:
    """Return the whole JSON object of a command."""
    plain: dict[str, Any] = without_nan(
        {
            "command": outcome.command,
            "version": __version__,
            "inputs": [{"path": str(item.path), "sha256": item.sha256} for item in outcome.inputs],
            "outputs": [str(path) for path in outcome.outputs],
            "warnings": list(outcome.warnings),
            "result": dict(outcome.result),
        }
    )
    return plain


def without_nan(value: Any) -> Any:
    """Return a value in JSON's own types, with null in place of every number that is not finite."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def of_nominal(nominal: Nominal) -> dict[str, Any]:
    """Return the result of `offset`.

    Raises
    ------
    InputError
        If the nominal is a copy that a later stage carries, without its quality.
    """
    quality = nominal.quality
    if quality is None:
        raise InputError("this nominal does not carry its quality", remedy="run offset on the nominal itself")
    at = quality.min_concave_at_mm
    return {
        "tip_radius_mm": nominal.tip_radius_mm,
        "side": side_word(nominal),
        "nominal_kind": nominal.kind,
        "n_points": quality.n_points,
        "max_slope_deg": quality.max_slope_deg,
        "min_concave_radius_mm": quality.min_concave_radius_mm,
        "min_concave_at_mm": None if at is None else list(at),
        "regular": quality.regular,
        "facet_error_pv_nm": quality.facet_error_pv_nm,
        "surface_error_pv_nm": quality.surface_error_pv_nm,
        "equidistant_error_pv_nm": quality.equidistant_error_pv_nm,
        "spacing_mm": list(quality.spacing_mm),
        "degree": quality.degree,
        "largest_ball_radius_mm": quality.min_concave_radius_mm,
        "n_not_reached": quality.n_not_reached,
        "n_edge": quality.n_edge,
        "n_feature": quality.n_feature,
        "max_held_off_um": None if quality.max_held_off_mm is None else quality.max_held_off_mm * UM_PER_MM,
        "digest": nominal.digest,
    }


def of_plan(plan: MeasuringPlan, path: Path) -> dict[str, Any]:
    """Return the part of the result of `offset` that tells of its measuring plan."""
    return {
        "path": str(path),
        "n_points": len(plan),
        "n_dense": int(plan.dense.sum()),
        "spacing_mm": plan.spacing_mm,
        "dense_spacing_mm": plan.dense_spacing_mm,
        "chosen_by": plan.chosen_by,
        "facet_error_pv_nm": plan.facet_error_pv_nm,
        "facet_error_predicted_nm": plan.facet_error_predicted_nm,
        "shortest_wavelength_mm": plan.shortest_wavelength_mm,
        "practical_wavelength_mm": plan.practical_wavelength_mm,
        "shortest_dense_wavelength_mm": plan.shortest_dense_wavelength_mm,
        "practical_dense_wavelength_mm": plan.practical_dense_wavelength_mm,
        "path_mm": plan.path_mm,
        "time_s": plan.time_s,
        "n_not_reached": plan.n_not_reached,
        "n_edge": plan.n_edge,
    }


def head_of_plan(plan: MeasuringPlan) -> list[tuple[str, str]]:
    """Return the numbers for the head of the plan's picture: label and value."""
    hours, minutes = divmod(max(1, round(plan.time_s / SECONDS_PER_MINUTE)), 60)
    return [
        ("points", f"{len(plan):,}".replace(",", "\N{THIN SPACE}")),
        ("spacing, mm", f"{plan.spacing_mm:.3g}"),
        ("time", f"{hours} h {minutes:02d}" if hours else f"{minutes} min"),
    ]


def rows_of_plan(plan: MeasuringPlan) -> list[tuple[str, str]]:
    """Return the rows of the summary that tell of a measuring plan."""
    n_dense = int(plan.dense.sum())
    dense = f", {n_dense} of them {plan.dense_spacing_mm:.3g} mm apart at features" if n_dense else ""
    inside = f", {plan.practical_dense_wavelength_mm:.3g} mm at features" if n_dense else ""
    minutes = max(1, round(plan.time_s / SECONDS_PER_MINUTE))
    error_um = plan.facet_error_pv_nm * UM_PER_MM / NM_PER_MM
    return [
        ("plan", f"{len(plan)} points {plan.spacing_mm:.4g} mm apart ({plan.chosen_by}){dense}"),
        ("plan shows", f"wavelengths from {plan.practical_wavelength_mm:.3g} mm on{inside}"),
        ("plan's facets", f"{error_um:.3g} um PV from the surface, measured"),
        ("plan's path", f"{plan.path_mm:.0f} mm, about {minutes} min"),
    ]


def of_alignment(alignment: Alignment) -> dict[str, Any]:
    """Return the result of `align`; PV and RMS are those of the points in the report region that touched."""
    report = alignment.report
    pose = alignment.part_from_machine
    judged = alignment.deviation_mm[alignment.judged] * UM_PER_MM
    return {
        "tip_radius_mm": alignment.nominal.tip_radius_mm,
        "side": side_word(alignment.nominal),
        "part_from_machine": pose.matrix().tolist(),
        "machine_from_part": pose.inverse().matrix().tolist(),
        "translation_mm": pose.translation_mm.tolist(),
        "rotation_deg": (pose.rotation_vector_rad() * DEG_PER_RAD).tolist(),
        "n_points": len(alignment.deviation_mm),
        "n_used": int(alignment.used.sum()),
        "n_outliers": report.n_outliers,
        "n_outside": report.n_outside,
        "iterations": report.iterations,
        "stop_reason": report.stop_reason,
        "converged": report.converged,
        "distance": report.distance,
        "rms_um": float(np.sqrt(np.mean(judged**2))),
        "pv_um": float(np.ptp(judged)),
        "mean_um": float(np.mean(judged)),
        "max_abs_um": float(np.max(np.abs(judged))),
        "unobservable": list(report.unobservable),
        "pose_sigma": dict(report.pose_sigma),
        "two_path_difference_nm": report.two_path_difference_nm,
        "criterion": report.criterion,
        "certificate": dict(report.certificate),
        "cost_history_mm2": list(report.cost_history_mm2),
        "n_edge": report.n_edge,
        "n_not_reached": report.n_not_reached,
        "n_apart": report.n_apart,
        "n_judged": len(judged),
        "outliers": [_point(alignment, k) for k in outliers_of(alignment)[:MOST_OUTLIERS]],
        "proof_ids": list(report.proof_ids),
        "locked": list(report.locked),
        "lock_frame": report.lock_frame,
        "weights": report.weights,
        "fit_region": report.fit_region,
        "report_region": report.report_region,
        "n_fiducials": report.n_fiducials,
        "scale": report.scale,
        "scale_sigma": None if report.free_scale is None else report.free_scale.sigma,
        "scale_correlation": None if report.free_scale is None else dict(report.free_scale.correlation),
        "correlated_errors": report.correlated,
        "method": report.method,
        "knowledge": None if report.knowledge is None else asdict(report.knowledge),
        "removed_motion": None if report.removed is None else asdict(report.removed),
        "monte_carlo": None if report.monte_carlo is None else asdict(report.monte_carlo),
        "bidirectional": None if report.bidirectional is None else asdict(report.bidirectional),
    }


def _point(alignment: Alignment, k: int) -> dict[str, Any]:
    """Return one point: its id, its place on the part, its deviation."""
    x, y, z = alignment.contact_part_mm[k].tolist()
    return {
        "id": int(alignment.ids[k]),
        "x_mm": x,
        "y_mm": y,
        "z_mm": z,
        "deviation_um": float(alignment.deviation_mm[k]) * UM_PER_MM,
    }


def of_statistics(statistics: Statistics) -> dict[str, Any]:
    """Return the numbers of a set of deviations."""
    return {
        "n": statistics.n,
        "pv_um": statistics.pv_mm * UM_PER_MM,
        "rms_um": statistics.rms_mm * UM_PER_MM,
        "mean_um": statistics.mean_mm * UM_PER_MM,
        "min_um": statistics.min_mm * UM_PER_MM,
        "max_um": statistics.max_mm * UM_PER_MM,
        "min_at_mm": list(statistics.min_at_mm),
        "max_at_mm": list(statistics.max_at_mm),
        "profile_um": statistics.profile_mm * UM_PER_MM,
    }


def of_map(deviation_map: DeviationMap) -> dict[str, Any]:
    """Return the result of `error-map`; the numbers of the grid, those of the points under `points`."""
    nominal = deviation_map.alignment.nominal
    return {
        "tip_radius_mm": nominal.tip_radius_mm,
        "side": side_word(nominal),
        **of_statistics(deviation_map.statistics),
        "pvr_um": deviation_map.pvr_mm * UM_PER_MM,
        "u_rms_um": deviation_map.u_rms_mm * UM_PER_MM,
        "grid_spacing_mm": deviation_map.spacing_mm,
        "ladder": [
            {
                "removed": rung.removed,
                "pv_um": rung.pv_mm * UM_PER_MM,
                "rms_um": rung.rms_mm * UM_PER_MM,
                "pvr_um": rung.pvr_mm * UM_PER_MM,
            }
            for rung in deviation_map.ladder
        ],
        "low_orders": None if deviation_map.low_orders is None else asdict(deviation_map.low_orders),
        "root_causes": None if deviation_map.root_causes is None else asdict(deviation_map.root_causes),
        "numbers": None if deviation_map.numbers is None else asdict(deviation_map.numbers),
        "conformance": None if deviation_map.conformance is None else asdict(deviation_map.conformance),
        "filter": None if deviation_map.filter is None else asdict(deviation_map.filter),
        "spectrum": None if deviation_map.spectrum is None else _spectrum(deviation_map.spectrum),
        "verdict": str(deviation_map.verdict),
        "verdict_lines": list(deviation_map.verdict_lines),
        "coverage_percent": 100.0 * deviation_map.coverage,
        "points": of_statistics(deviation_map.point_statistics),
    }


def _spectrum(spectrum: Spectrum) -> dict[str, Any]:
    """Return the spectrum of a map: rings from long to short waves, and bands."""
    columns = zip(spectrum.frequency_per_mm, spectrum.psd_um2_mm2, spectrum.freedom, strict=True)
    return {
        "rings": [
            {"wavelength_mm": 1.0 / frequency, "psd_um2_mm2": psd, "freedom": freedom}
            for frequency, psd, freedom in columns
        ],
        "noise_floor_um2_mm2": spectrum.noise_floor_um2_mm2,
        "bands": [asdict(band) for band in spectrum.bands],
        "shortest_mm": spectrum.shortest_mm,
        "taper_mm": spectrum.taper_mm,
        "missing": spectrum.missing,
    }


def of_correction(correction: Correction, exports: Sequence[Path]) -> dict[str, Any]:
    """Return the result of `compensate`."""
    return {
        "tip_radius_mm": correction.nominal.tip_radius_mm,
        "side": side_word(correction.nominal),
        "gain": correction.gain,
        "pass_number": correction.pass_number,
        "max_correction_um": float(np.nanmax(np.abs(correction.correction_mm))) * UM_PER_MM,
        "before_pv_um": correction.before.pv_mm * UM_PER_MM,
        "before_rms_um": correction.before.rms_mm * UM_PER_MM,
        "predicted_pv_um": correction.predicted.pv_mm * UM_PER_MM,
        "predicted_rms_um": correction.predicted.rms_mm * UM_PER_MM,
        "worth_another_pass": correction.worth_another_pass,
        "reason": correction.reason,
        "n_extended": int(correction.extended.sum()),
        "exports": [str(path) for path in exports],
        "gain_rule": correction.gain_rule,
        **_of_band(correction),
        **_of_prediction(correction),
        **_of_limits(correction),
        **_of_response(correction),
    }


def _of_band(correction: Correction) -> dict[str, Any]:
    """Return which waves a correction holds."""
    band = correction.band
    if band is None:
        return {}
    return {
        "low_pass_mm": band.low_pass_mm,
        "low_pass_bound": band.bound,
        "sampling_limit_mm": band.sampling_mm,
        "noise_limit_mm": band.noise_mm,
        "wheel_limit_mm": band.wheel_mm or None,
    }


def _of_prediction(correction: Correction) -> dict[str, Any]:
    """Return what to expect, with 95 % intervals."""
    p = correction.prediction
    if p is None:
        return {}
    return {
        "predicted_rms_interval_um": [p.rms_low_mm * UM_PER_MM, p.rms_high_mm * UM_PER_MM],
        "predicted_pv_interval_um": [p.pv_low_mm * UM_PER_MM, p.pv_high_mm * UM_PER_MM],
        "correctable_rms_um": p.correctable_rms_mm * UM_PER_MM,
        "noise_um": p.noise_mm * UM_PER_MM,
        "repeatability_um": p.repeatability_mm * UM_PER_MM,
        "transfer": list(p.transfer.share),
        "transfer_wavelength_mm": list(p.transfer.wavelength_mm),
        "u_transfer": p.transfer.u,
    }


def _of_limits(correction: Correction) -> dict[str, Any]:
    """Return the sizes that have limits, and what was left out."""
    limits = correction.limits
    if limits is None:
        return {}
    return {
        "max_slope_mrad": limits.max_slope_rad * MRAD_PER_RAD,
        "removal_um": limits.removal_mm * UM_PER_MM,
        "total_removal_um": limits.total_removal_mm * UM_PER_MM,
        "taper_mm": limits.taper_mm,
        "region": limits.region or None,
        "n_beyond": limits.n_beyond,
        "n_bridged": limits.n_bridged,
        "n_few_points": limits.n_few_points,
        "n_outside_region": limits.n_outside_region,
        "n_clipped": limits.n_clipped,
    }


def _of_response(correction: Correction) -> dict[str, Any]:
    """Return what came of the pass before; nulls for the first."""
    r = correction.response
    return {
        "previous_transfer": None if r is None else r.transfer,
        "previous_u_transfer": None if r is None else r.u_transfer,
    }


def side_word(nominal: Nominal) -> str:
    """Return the probe's side as it is typed: +z or -z."""
    return "+z" if nominal.side > 0 else "-z"


def probe_row(nominal: Nominal) -> tuple[str, str]:
    """Return the row that every report of a later stage begins with: which ball, on which side."""
    from cmm_align.stages.fit_checks import NO_BALL_MM

    if nominal.tip_radius_mm <= NO_BALL_MM:
        return "probe", f"none: contact points, on the {side_word(nominal)} side of the nominal"
    return (
        "probe",
        f"tip radius {nominal.tip_radius_mm:g} mm, on the {side_word(nominal)} side of the nominal",
    )
