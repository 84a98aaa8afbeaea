"""What changed between two measurements of one part: what the difference consists of, and how sure.

Both are taken to one grid (`common_grid`). A best fit moves each measurement by itself, so a node counts as
changed where the *form* did: where the difference without its rigid motion is beyond its uncertainty, the
scatter of both measurements and their simulated errors, if there are any. The rigid motion is tested as a
whole, against the covariance of both poses. Which nodes changed is decided by the false discovery rate over
all of them (`discoveries`), so that neither their number nor what neighbours have in common makes a change.
What noise explains of the whole is in `change_tests`.

Sign: the difference is after - before, positive where material came on (or the surface rose).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from cmm_align.config import ErrorMapConfig
from cmm_align.errors import GeometryError, InputError, UsageError, WrongStageError
from cmm_align.model import (
    Alignment,
    Change,
    ChangeBand,
    ChangeRung,
    Comparison,
    DeviationMap,
    frozen_array,
)
from cmm_align.numerics.node_noise import discoveries
from cmm_align.stages.change_tests import change_bands, change_rungs
from cmm_align.stages.change_words import change_words
from cmm_align.stages.common_grid import Pair, on_common_grid, u_rms
from cmm_align.stages.compensate import map_digest
from cmm_align.stages.deviation_statistics import deviation_statistics
from cmm_align.stages.low_orders import ladder_base
from cmm_align.surfaces.protocol import Array, Mask
from cmm_align.units import UM_PER_MM

LEAST_NODES: Final = 9
"""Fewest nodes that both must know."""
FALSE_DISCOVERY_RATE: Final = 0.01
"""Share of false ones among the nodes that are called changed; without any change, the chance of one."""
COVERAGE_FACTOR: Final = 3.0
"""The RMS rose or fell if it moved by more than so many standard uncertainties: what other places of the
points do to the map of one and the same form is not in them."""
ROUNDING_MM: Final = 1e-9
"""Least uncertainty of a difference: what writing and reading coordinates leaves."""


def compare(
    after: DeviationMap, before: Alignment, config: ErrorMapConfig, *, names: tuple[str, str] = ("", "")
) -> Comparison:
    """Return what changed between two measurements of one part.

    Parameters
    ----------
    after : DeviationMap
        The later measurement, mapped with `config`; without a filter.
    before : Alignment
        The earlier measurement; the same nominal, side and projection.
    config : ErrorMapConfig
        Its window is used for both.
    names : tuple of str
        Of the later and the earlier measurement, for messages.

    Returns
    -------
    Comparison
        On noise alone some node is called changed in 1 % of the cases, and so is the whole (tested over 50
        seeds).

    Raises
    ------
    UsageError
        If the later map is filtered: what noise a filter leaves at a node is not known.
    InputError
        If the two are of different parts or sides, the same measurement, or know no place in common.
    """
    if after.filter is not None:
        raise UsageError(
            f"a comparison of filtered maps ({after.filter.words})",
            expected="a map with all waves: the comparison tells long, middle and fine ones apart itself",
            remedy="leave the cutoffs out",
        )
    _check_same_part(after, before, names)
    pair = on_common_grid(after, before, config)
    if np.count_nonzero(pair.known) < LEAST_NODES:
        raise GeometryError(
            f"the two measurements know {np.count_nonzero(pair.known)} nodes in common",
            where=names[1],
            expected=f"at least {LEAST_NODES} that both have points around",
            remedy="compare measurements of the same area",
        )
    difference = pair.late.deviation_mm - pair.early.deviation_mm
    base = ladder_base(after.alignment, pair.x_mm, pair.y_mm, difference, pair.weights)
    e, rigid = base.nodes.deviation_mm, base.q[:, : base.ends[1]]
    form = e - rigid @ (rigid.T @ (base.nodes.weight * e) / len(e))
    u = np.sqrt(pair.late.sigma_mm**2 + pair.early.sigma_mm**2 + ROUNDING_MM**2)
    freedom = np.minimum(pair.late.freedom, pair.early.freedom)
    changed = np.zeros(pair.known.shape, dtype=np.bool_)
    at = pair.known
    changed[at] = discoveries(_two_sided(form / u[at], freedom[at]), FALSE_DISCOVERY_RATE)
    bands, tests = change_bands(pair, base, config.window)
    rungs = change_rungs(pair, bands, tests)
    change = _change(pair, changed, bands, rungs, names[1])
    return Comparison(
        x_mm=frozen_array(pair.x_mm),
        y_mm=frozen_array(pair.y_mm),
        before_mm=frozen_array(pair.early.deviation_mm),
        after_mm=frozen_array(pair.late.deviation_mm),
        u_mm=frozen_array(u),
        changed=frozen_array(changed, np.bool_),
        change=replace(change, words=change_words(change)),
    )


def _change(
    pair: Pair, changed: Mask, bands: tuple[ChangeBand, ...], rungs: tuple[ChangeRung, ...], earlier: str
) -> Change:
    """Return the numbers of a comparison, without their words."""
    late, early = pair.late.deviation_mm, pair.early.deviation_mm
    x_grid, y_grid = np.meshgrid(pair.x_mm, pair.y_mm)
    before, after, difference = (
        deviation_statistics(v, x_grid, y_grid, pair.weights) for v in (early, late, late - early)
    )
    share = pair.weights / pair.weights[pair.known].sum()
    farther = np.abs(late) > np.abs(early)
    smallest = np.abs(late - early)[changed].min() * UM_PER_MM if changed.any() else np.nan
    rms_change = after.rms_mm - before.rms_mm
    u_rms_change = float(np.hypot(u_rms(pair, pair.late), u_rms(pair, pair.early)))
    real = bool(changed.any()) or not rungs[0].noise
    beyond = real and abs(rms_change) > COVERAGE_FACTOR * u_rms_change
    return Change(
        earlier=earlier,
        before=before,
        after=after,
        difference=difference,
        spacing_mm=max(float(a[1] - a[0]) for a in (pair.x_mm, pair.y_mm)),
        common=pair.common,
        rungs=rungs,
        bands=bands,
        false_discovery_rate=FALSE_DISCOVERY_RATE,
        least_significant_um=float(smallest),
        share_changed=float(share[changed].sum()),
        share_better=float(share[changed & ~farther].sum()),
        share_worse=float(share[changed & farther].sum()),
        rms_change_um=rms_change * UM_PER_MM,
        u_rms_change_um=u_rms_change * UM_PER_MM,
        real=real,
        form_changed=real and len(rungs) > 1 and not rungs[1].noise,
        worse_than_before=beyond and rms_change > 0.0,
        better_than_before=beyond and rms_change < 0.0,
        words=(),
    )


def _check_same_part(after: DeviationMap, before: Alignment, names: tuple[str, str]) -> None:
    """Refuse two parts, two probes, and one measurement with itself."""
    late, early = after.alignment.nominal, before.nominal
    if late.digest != early.digest:
        raise InputError(
            f"it is of another part: its nominal is {early.digest[:12]}, that of "
            f"{names[0] or 'the later measurement'} is {late.digest[:12]}",
            where=names[1],
            expected="two measurements against one nominal",
            remedy="give an earlier measurement of this part, or align both to the same nominal",
        )
    same_frame = np.allclose(
        late.surface_from_part.matrix(), early.surface_from_part.matrix(), rtol=0.0, atol=1e-12
    )
    if late.side != early.side or not same_frame:
        raise InputError(
            f"it was probed from the {'+z' if early.side > 0 else '-z'} side, "
            f"{names[0] or 'the later measurement'} from the {'+z' if late.side > 0 else '-z'} side",
            where=names[1],
            expected="one side and one projection direction",
        )
    if map_digest(after) == map_digest(replace(after, alignment=before)):
        raise WrongStageError(
            "both are the same measurement: the same points, touch by touch",
            where=names[1],
            expected="two measurements of the part",
            remedy="give the map or the alignment of the earlier one",
        )


def _two_sided(ratio: Array, freedom: Array) -> Array:
    """Return the chance of a larger absolute value of Student's t."""
    from scipy.special import stdtr

    return np.asarray(2.0 * stdtr(freedom, -np.abs(ratio)), dtype=np.float64)
