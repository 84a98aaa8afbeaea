"""The rows that tell all numbers of a map, for ``-v``: each with its uncertainty, and what made them."""

from __future__ import annotations

from cmm_align.model import Irregularity, MadeBy, MapNumbers, SlopeError
from cmm_align.report.wording import as_length, as_percent, at_place, calm, signed, two_digits

Rows = list[tuple[str, str]]


def of_numbers(numbers: MapNumbers) -> Rows:
    """Return the rows of all numbers."""
    n = numbers
    rows = [
        ("mean", _with_u(n.mean_um, n.u_mean_um, sign=True)),
        (
            "profile (ISO 1101)",
            f"{calm(n.profile_um)} um   (single points {calm(n.points_profile_um)} um)",
        ),
        (
            "without noise",
            f"PV {_with_u(n.pv_without_noise_um, n.u_pv_um)}, "
            f"RMS {_with_u(n.rms_without_noise_um, n.u_rms_um)}, "
            f"profile {_with_u(n.profile_without_noise_um, n.u_profile_um)}",
        ),
        (
            "noise",
            f"{two_digits(n.noise_um)} um a touch; scatter about the map {two_digits(n.scatter_um)} um",
        ),
        ("percent of area", _percentiles(n)),
    ]
    if n.points_in_tolerance is not None:
        area = "" if n.area_in_tolerance is None else f", {as_percent(n.area_in_tolerance)} of the area"
        rows.append(("in tolerance", f"{as_percent(n.points_in_tolerance)} of the points{area}"))
    if n.irregularity is not None:
        rows += _irregularity(n.irregularity)
    if n.slope is not None:
        rows.append(_slope(n.slope))
    return [*rows, ("made by", _made_by(n.made_by)), *_not_in_u(n.made_by)]


def _with_u(value_um: float, u_um: float, *, sign: bool = False) -> str:
    """Return a number and its standard uncertainty."""
    text = signed(value_um) if sign else calm(value_um)
    return f"{text} um (u {two_digits(u_um)})"


def _percentiles(n: MapNumbers) -> str:
    """Return the deviations at a few percentages, and how wide the middle of them is."""
    p = n.percentiles_um
    few = ", ".join(f"{signed(p[q], 2)} below {q} %" for q in ("2.5", "16", "50", "84", "97.5"))
    return f"{few}; P99.8 - P0.2 = {calm(n.width_99_6_um)} um"


def _irregularity(found: Irregularity) -> Rows:
    """Return the indications of ISO 10110-5."""
    i = found
    u_b = "" if i.u_b_um is None else f" (u {two_digits(i.u_b_um)})"
    return [
        (
            "ISO 10110-5",
            f"A power {_with_u(i.a_um, i.u_a_um, sign=True)}, B irregularity {calm(i.b_um)} um{u_b}, "
            f"C symmetric {_with_u(i.c_um, i.u_c_um)}",
        ),
        (
            "RMS t / i / a",
            f"{calm(i.rms_t_um)} / {calm(i.rms_i_um)} / {calm(i.rms_a_um)} um "
            f"(u {two_digits(max(i.u_rms_t_um, i.u_rms_i_um, i.u_rms_a_um))})",
        ),
    ]


def _slope(slope: SlopeError) -> tuple[str, str]:
    """Return the slope errors."""
    s = slope
    u = "" if s.u_rms_mrad is None else f" (u {two_digits(s.u_rms_mrad)})"
    u_max = "" if s.u_max_mrad is None else f" (u {two_digits(s.u_max_mrad)})"
    return (
        "slope error",
        f"RMS {calm(s.rms_mrad)} mrad{u}, largest {calm(s.max_mrad)} mrad at {at_place(s.max_at_mm)}, "
        f"without noise {calm(s.max_without_noise_mrad)} mrad{u_max}; over {as_length(s.base_mm)}",
    )


def _made_by(made: MadeBy) -> str:
    """Return what the numbers depend on."""
    parts = [
        f"{made.criterion}, weights {made.weights}",
        f"locked {', '.join(made.locked)} (frame {made.lock_frame})" if made.locked else "no motion locked",
        f"filter {made.filter}" if made.filter else "no filter",
    ]
    parts += [f"fit region {made.fit_region}"] if made.fit_region else []
    parts += [f"report region {made.report_region}"] if made.report_region else []
    parts.append(f"{made.n_left_out} points left out, {made.n_outliers} of them outliers")
    return "; ".join(parts)


def _not_in_u(made: MadeBy) -> Rows:
    """Return what the uncertainties do not hold."""
    return [("u is without", made.not_in_u)] if made.not_in_u else []
