"""The verdict: numbers against tolerances under a stated decision rule.

Guard band (ISO 14253-1:2017, by default 1.65 u for 95 % on one side): conformity is proved where the number
as measured, noise and all, keeps the tolerance by the guard band; non-conformity where the number without
noise exceeds it by the guard band; between the two neither is. As measured is the worse of nodes and single
points; the nodes alone where a filter was asked for. So noise of the measurement never lets a part pass and
never fails one. Simple acceptance compares the number as measured with the tolerance, and takes half of the
parts at the limit the wrong way.

The probability of conformance is that of JCGM 106:2012, eq. (6), ``Phi((T - y) / u)``, with y the number
without noise. Of several tolerances together it is at least ``1 - sum (1 - p)``, whatever they share.
What was not measured cannot pass: with less than nine tenths of the nominal the verdict is undecided at best.
So it is where points that the fit left out as outliers would break a tolerance: dirt and a fault of the part
look alike, and only who cleans and measures again can tell. After a filter, single points do not count.
"""

from __future__ import annotations

from math import erfc
from typing import Final

import numpy as np

from cmm_align.config import DECISIONS, ErrorMapConfig
from cmm_align.errors import UsageError
from cmm_align.model import Conformance, Judgement, SlopeError, Verdict
from cmm_align.stages.map_numbers import Band
from cmm_align.stages.noise_shares import Measured, Shares, Told, over_band, over_limits
from cmm_align.stages.report_region import outliers_mm
from cmm_align.units import UM_PER_MM

MIN_COVERAGE: Final = 0.9
"""What was not measured cannot pass."""
GUARD_BAND: Final = "guard-band"
SIMPLE: Final = "simple"
SURE: Final = 0.95


def band_of(config: ErrorMapConfig) -> Band | None:
    """Return the band that the settings ask for, mm, or None.

    Raises
    ------
    UsageError
        If its lower limit is not below the upper one.
    """
    lower, upper = config.tolerance_band_lower_um, config.tolerance_band_upper_um
    if lower == upper == 0.0:
        return None
    if not lower < upper:
        raise UsageError(
            f"a band from {lower:g} to {upper:g} um", expected="the lower limit below the upper one"
        )
    return lower / UM_PER_MM, upper / UM_PER_MM


def check_tolerances(config: ErrorMapConfig) -> None:
    """Refuse tolerances that are none.

    Raises
    ------
    UsageError
        If one is negative or not a number, or the decision rule is not known.
    """
    for name in ("tolerance_pv_um", "tolerance_rms_um", "tolerance_profile_um", "tolerance_slope_mrad"):
        value = getattr(config, name)
        if not (np.isfinite(value) and value >= 0.0):
            raise UsageError(f"{name} = {value!r}", expected="a number above 0, or 0 for none")
    if config.decision not in DECISIONS:
        raise UsageError(f"decision {config.decision!r}", expected=", ".join(DECISIONS))


def judge(
    m: Measured,
    told: Shares,
    slope: SlopeError | None,
    coverage: float,
    config: ErrorMapConfig,
    band_mm: Band | None,
) -> tuple[Verdict, tuple[str, ...], Conformance | None]:
    """Return the verdict, a sentence for each tolerance, and all that was judged.

    Parameters
    ----------
    m : Measured
    told : Shares
        PV, RMS and profile with and without noise.
    slope : SlopeError or None
    coverage : float
        Share of the nominal that was measured, 0 to 1.
    config : ErrorMapConfig
        Tolerances and decision rule.
    band_mm : pair of float or ndarray, shape (N,), mm, optional
        Limits of the deviations.

    Raises
    ------
    UsageError
        If a tolerance on the slope is given and no node has one.
    """
    found = []
    of_what = "of the filtered map; " if m.filtered else ""
    for name, number, tolerance_um in (
        ("PV", told.pv, config.tolerance_pv_um),
        ("RMS", told.rms, config.tolerance_rms_um),
        ("profile", told.profile, config.tolerance_profile_um),
    ):
        if tolerance_um > 0.0:
            in_um = Told(*(v * UM_PER_MM for v in number))
            found.append(_judged(name, "um", in_um, tolerance_um, config, of_what))
    if config.tolerance_slope_mrad > 0.0:
        if slope is None:
            raise UsageError(
                "a tolerance on the slope, and no node of the map has one", remedy="measure more points"
            )
        largest = Told(slope.max_mrad, slope.max_without_noise_mrad, slope.u_max_mrad or 0.0)
        found.append(
            _judged("slope", "mrad", largest, config.tolerance_slope_mrad, config, of_what + _reach(slope))
        )
    if band_mm is not None:
        excess = Told(*(v * UM_PER_MM for v in _excess(m, band_mm)))
        found.append(_judged_band(excess, band_mm, config, filtered=m.filtered))
    if not found:
        return Verdict.NONE, (), None
    outcomes, lines = [j.verdict for j in found], [j.sentence for j in found]
    if coverage < MIN_COVERAGE:
        outcomes.append(Verdict.UNDECIDED)
        lines.append(f"only {100.0 * coverage:.0f} % of the nominal was measured: undecided at best")
    if breaking := _of_outliers(m, config, band_mm):
        outcomes.append(Verdict.UNDECIDED)
        lines.append(breaking)
    worst = next(v for v in (Verdict.FAIL, Verdict.UNDECIDED, Verdict.PASS) if v in outcomes)
    together = max(0.0, 1.0 - sum(1.0 - j.probability for j in found))
    guard = config.guard_factor if config.decision == GUARD_BAND else 0.0
    return worst, tuple(lines), Conformance(config.decision, guard, tuple(found), together)


def _of_outliers(m: Measured, config: ErrorMapConfig, band_mm: Band | None) -> str:
    """Say that outliers would break a tolerance on deviations; nothing where none would."""
    out = outliers_mm(m.alignment)
    if m.filtered or not len(out):
        return ""
    p = m.point_statistics
    low, high = min(p.min_mm, float(out.min())), max(p.max_mm, float(out.max()))
    found = [
        (high - low, config.tolerance_pv_um),
        (2.0 * max(high, -low), config.tolerance_profile_um),
    ]
    broken = any(0.0 < limit_um < value * UM_PER_MM for value, limit_um in found)
    if band_mm is not None:  # limits of single points: the tightest, for outliers have none of their own
        broken |= bool(out.min() < np.max(band_mm[0]) or out.max() > np.min(band_mm[1]))
    if not broken:
        return ""
    worst = float(out[np.argmax(np.abs(out))]) * UM_PER_MM
    counted = "a point left out as an outlier" if len(out) == 1 else f"{len(out)} points left out as outliers"
    return f"{counted}, up to {worst:+.4g} um, would break it: undecided at best"


def _excess(m: Measured, band_mm: Band) -> Told:
    """Return the largest excess over a band, or over the limits of single points, mm."""
    lower, upper = band_mm
    if isinstance(lower, float) and isinstance(upper, float):
        return over_band(m, lower, upper)
    return over_limits(m, np.asarray(lower), np.asarray(upper))


def probability_below(limit: float, value: float, u: float) -> float:
    """Return the probability that a value known with `u` is at most `limit`: JCGM 106, eq. (6)."""
    if u <= 0.0:
        return 1.0 if value <= limit else 0.0
    return 0.5 * erfc((value - limit) / (u * 2.0**0.5))


def _outcome(number: Told, limit: float, config: ErrorMapConfig) -> Verdict:
    """Return the decision on a number that shall be at most `limit`."""
    if config.decision == SIMPLE:
        return Verdict.PASS if number.measured <= limit else Verdict.FAIL
    guard = config.guard_factor * number.u
    if limit - max(number.measured, number.value) >= guard:
        return Verdict.PASS
    if number.value > limit and number.value - limit >= guard:
        return Verdict.FAIL
    return Verdict.UNDECIDED


def _reach(slope: SlopeError) -> str:
    """Say over which length slopes are known, and of how many nodes they are not."""
    left_out = f", without {slope.n_left_out} nodes on the border" if slope.n_left_out else ""
    return f"over {slope.base_mm:.2g} mm{left_out}; "


def _judged(
    name: str, unit: str, number: Told, limit: float, config: ErrorMapConfig, more: str = ""
) -> Judgement:
    """Return the judgement of a number with an upper limit."""
    outcome = _outcome(number, limit, config)
    probability = probability_below(limit, number.value, number.u)
    sign = "<=" if number.measured <= limit else ">"
    said = f"{name} {number.measured:.4g} {unit} {sign} {limit:.4g} {unit}"
    sentence = f"{said} ({more}{_certainty(number, unit, outcome, probability)}): {outcome}"
    return Judgement(
        quantity=name,
        unit=unit,
        measured=number.measured,
        value=number.value,
        u=number.u,
        lower=None,
        upper=limit,
        margin=limit - number.value,
        probability=probability,
        verdict=str(outcome),
        sentence=sentence,
    )


def _judged_band(excess: Told, band_mm: Band, config: ErrorMapConfig, *, filtered: bool) -> Judgement:
    """Return the judgement of all deviations against their limits, um."""
    outcome = _outcome(excess, 0.0, config)
    probability = probability_below(0.0, excess.value, excess.u)
    lower, upper = band_mm
    one = isinstance(lower, float) and isinstance(upper, float)
    named = f"band {lower * UM_PER_MM:+g} to {upper * UM_PER_MM:+g} um" if one else "band of each point"
    of_what = "of the filtered map; " if filtered and one else ""
    if filtered and not one:
        named += ", which no filter touches,"
    room = "kept with {:.4g} um to spare" if excess.measured <= 0.0 else "exceeded by {:.4g} um"
    said = f"{named} {room.format(abs(excess.measured))}"
    return Judgement(
        quantity="band",
        unit="um",
        measured=excess.measured,
        value=excess.value,
        u=excess.u,
        lower=float(lower) * UM_PER_MM if one else None,
        upper=float(upper) * UM_PER_MM if one else None,
        margin=-excess.value,
        probability=probability,
        verdict=str(outcome),
        sentence=f"{said} ({of_what}{_certainty(excess, 'um', outcome, probability)}): {outcome}",
    )


def _certainty(number: Told, unit: str, outcome: Verdict, probability: float) -> str:
    """Say how sure a comparison is."""
    text = f"u {number.u:.2g} {unit}, P within {_percent(probability)}"
    if outcome == Verdict.UNDECIDED and probability >= SURE:
        text += f" if what lies above {number.value:.4g} {unit} is noise"
    return text


def _percent(probability: float) -> str:
    """Write a probability without promising certainty."""
    percent = 100.0 * probability
    if percent > 99.9:
        return "> 99.9 %"
    return "< 0.1 %" if percent < 0.1 else f"{percent:.1f} %"
