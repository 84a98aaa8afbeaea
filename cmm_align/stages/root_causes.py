"""Root causes: single settings that explain the deviations, before a freeform is made of them.

The signatures of all causes (`cause_signatures`) are fitted to the deviations of the points, averaged over
a net of places: averages of columns and values obey the same linear model, and time and normals stay with
the points. Rigid motions that the surface can tell are always in the model, so that a cause counts with
what no motion hides of it. What is left may be form error, whose neighbours err alike:
`numerics.correlated_fit` fits noise and form error with it and says how likely the data are with and
without a cause.

Causes are added one by one, the one first that makes the data likeliest, and each choice is looked at again
after the next. A cause is named if the odds for it are `PROOF` to one, the number of causes that might have
shown by chance counted against it. Others that the data cannot tell from it are named beside it: those
whose columns would give the same contribution (correlation above `ALIKE`), and those with which the data
are nearly as likely (odds below `CANNOT_TELL`). So a part that is nearly a sphere, where all radii and
scales look alike, has one cause with many names, and a part with an unrelated form error has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import UsageError
from cmm_align.model import Alignment
from cmm_align.model.root_causes import CANNOT_TELL, Cause, Member, RootCauses
from cmm_align.numerics.correlated_fit import Fit, Tables, fit, tables
from cmm_align.numerics.linearisation import even_sample
from cmm_align.stages.cause_signatures import Sample, Signature, sample_of, signatures
from cmm_align.stages.told_motions import motion_columns
from cmm_align.surfaces.protocol import Array
from cmm_align.units import DEG_PER_RAD, UM_PER_MM, parse_length_mm

SAMPLE: Final = 50_000
"""Points that are looked at: more would not make a difference beside form error."""
PLACES: Final = 196
"""Places that they are averaged to, about."""
FEWEST: Final = 36
"""Places needed: six motions and some causes, with a rest that tells how it is correlated."""
MOST_CAUSES: Final = 5
PROOF: Final = 1000.0
"""Odds at which a cause is named, for each cause that was looked for: see `tests/bench/root_causes.py`."""
ALIKE: Final = 0.95
"""Correlation of contributions above which two causes look the same."""
LEAST_SHARE: Final = 0.01
"""Of the mean square, for a cause to be named."""
BARE: Final = 3.0
"""Odds that are not worth more than a bare mention (Kass and Raftery): the order of the causes decides."""
_CAP: Final = 1e12
_GAIN: Final = 0.5
"""Logarithm of the odds by which another choice must be better to be taken instead."""


class _Problem(NamedTuple):
    """All that the choices are made from."""

    signatures: tuple[Signature, ...]
    owner: tuple[NDArray[np.intp], ...]
    """Columns of each signature."""
    tables: Tables
    candidates: tuple[int, ...]
    """Signatures that no motion hides."""
    gram: Array
    """Of all columns and the deviations at the points, without rigid motions, mean, mm^2."""
    columns: Array
    """As they are, shape (n, m)."""

    def picks(self, chosen: Sequence[int]) -> list[int]:
        """Return the columns of some signatures."""
        return [int(k) for s in chosen for k in self.owner[s]]

    def fit(self, chosen: Sequence[int]) -> Fit:
        """Return the fit of some signatures."""
        return fit(self.tables, self.picks(chosen))


def axis_from_text(text: str) -> tuple[float, float] | None:
    """Return an axis of rotation, x and y, mm; None for an empty text.

    Raises
    ------
    UnitsError
        If one of the two is not a length.
    UsageError
        If there are not two.
    """
    if not text.strip():
        return None
    lengths = [parse_length_mm(part) for part in text.split(",")]
    if len(lengths) != 2:
        raise UsageError(f"cause axis {text!r}", expected="two lengths: X,Y")
    return lengths[0], lengths[1]


def root_causes(alignment: Alignment, axis_mm: tuple[float, float] | None = None) -> RootCauses:
    """Return the causes that the deviations of an alignment prove.

    Parameters
    ----------
    alignment : Alignment
        Points that are `judged` are looked at.
    axis_mm : tuple of float, optional
        Axis of rotation of the grinding machine, x and y, mm, frame `surface`: the centre of the aperture
        unless given.

    Returns
    -------
    RootCauses
        Without causes, and with a reason, where there are too few points to look.

    Notes
    -----
    95 % intervals hold the truth in 93 to 97 % of the cases (`tests/bench/root_causes.py`).
    """
    b = alignment.nominal.surface.bounds
    centre = (0.5 * (b.x_min + b.x_max), 0.5 * (b.y_min + b.y_max))
    axis = centre if axis_mm is None else axis_mm
    rows = np.flatnonzero(alignment.judged & np.isfinite(alignment.deviation_mm))
    pick = rows[even_sample(len(rows), SAMPLE)]
    if len(pick) < FEWEST:
        return _nothing(f"{len(pick)} points, at least {FEWEST} are needed", len(pick), axis)
    sample = sample_of(alignment, pick)
    cell = _cells(sample.foot_surface_mm)
    n_places = int(cell.max()) + 1
    if n_places < FEWEST:
        return _nothing(f"points at {n_places} places, at least {FEWEST} are needed", len(pick), axis)
    problem = _problem(alignment, sample, signatures(sample, axis, centre), cell)
    total = float(problem.gram[-1, -1])
    if total <= (1e-15 * b.diagonal_mm) ** 2:
        return _nothing("no deviations beyond a rigid motion", len(pick), axis)
    chosen = _felt(problem, _chosen(problem))
    found = problem.fit(chosen)
    causes = [_cause(problem, chosen, k, found) for k in range(len(chosen))]
    hidden = set(range(len(problem.signatures))) - set(problem.candidates)
    return RootCauses(
        causes=tuple(sorted(causes, key=lambda cause: -cause.share)),
        reason="",
        looked_for=tuple(problem.signatures[k].name for k in problem.candidates),
        hidden=tuple(problem.signatures[k].name for k in sorted(hidden)),
        rms_um=total**0.5 * UM_PER_MM,
        rms_without_um=_left(problem, problem.picks(chosen), found.coefficients) ** 0.5 * UM_PER_MM,
        n_points=len(pick),
        n_places=n_places,
        correlation_mm=found.length,
        axis_mm=axis,
    )


def _nothing(reason: str, n_points: int, axis_mm: tuple[float, float]) -> RootCauses:
    nan = float("nan")
    return RootCauses((), reason, (), (), nan, nan, n_points, 0, nan, axis_mm)


def _cells(foot_mm: Array) -> NDArray[np.intp]:
    """Return the place that each point belongs to, numbered from 0, shape (n,)."""
    if len(foot_mm) <= PLACES:
        return np.arange(len(foot_mm))
    low, sides = foot_mm[:, :2].min(axis=0), np.maximum(np.ptp(foot_mm[:, :2], axis=0), 1e-300)
    ratio = float(np.clip(sides[0] / sides[1], 1.0 / PLACES, PLACES))
    across = max(1, round((PLACES / ratio) ** 0.5))
    along = max(1, PLACES // across)
    at = ((foot_mm[:, :2] - low) / (sides * (1.0 + 1e-9)) * [along, across]).astype(np.intp)
    return np.asarray(np.unique(at[:, 1] * along + at[:, 0], return_inverse=True)[1], dtype=np.intp)


def _problem(
    alignment: Alignment, sample: Sample, causes: tuple[Signature, ...], cell: NDArray[np.intp]
) -> _Problem:
    """Average everything over the places, and take the rigid motions out at the points."""
    motions = motion_columns(alignment, sample.foot_surface_mm, sample.normal_surface)
    columns = np.hstack([cause.columns for cause in causes])
    ends = np.cumsum([cause.columns.shape[1] for cause in causes])
    owner = tuple(
        np.arange(end - cause.columns.shape[1], end) for end, cause in zip(ends, causes, strict=True)
    )
    counts = np.bincount(cell).astype(np.float64)
    everything = np.hstack([sample.foot_surface_mm, motions, columns, sample.deviation_mm[:, None]])
    means = np.stack([np.bincount(cell, a) for a in everything.T], axis=1) / counts[:, None]
    k = motions.shape[1]
    found = tables(means[:, :3], counts, means[:, 3 : 3 + k], means[:, 3 + k : -1], means[:, -1])
    q = np.linalg.qr(motions)[0]
    rest = everything[:, 3 + k :] - q @ (q.T @ everything[:, 3 + k :])
    candidates = tuple(s for s in range(len(causes)) if found.told[owner[s]].all())
    return _Problem(causes, owner, found, candidates, rest.T @ rest / len(rest), columns)


def _chosen(problem: _Problem) -> list[int]:
    """Choose the causes that the data prove, together against none and each beside the others.

    Steps forward go on while the data get likelier at all, for two causes may hide each other; the best
    choice on the way is kept, and looked at once more without each of its causes.
    """
    each = float(np.log(max(len(problem.candidates), 1)))
    chosen: list[int] = []
    nothing = score = problem.fit(chosen).log_evidence
    best, best_score = chosen, score
    while len(chosen) < MOST_CAUSES:
        trial, better = _best(problem, [[*chosen, s] for s in _free(problem, chosen)])
        if better - score < _GAIN:
            break
        chosen, score = _settled(problem, trial, better)
        if score - each * len(chosen) > best_score - each * len(best):
            best, best_score = chosen, score
    while best:
        less, less_score = _best(problem, [[other for other in best if other != s] for s in best])
        proven = best_score - less_score > each + np.log(PROOF)
        if proven and best_score - nothing > each * len(best) + np.log(PROOF):
            break
        best, best_score = less, less_score
    return _named(problem, best, best_score)


def _free(problem: _Problem, chosen: Sequence[int]) -> list[int]:
    """Return the candidates that are not chosen, nor alike to one that is."""
    return [
        s
        for s in problem.candidates
        if s not in chosen and all(_likeness(problem, s, other) < ALIKE for other in chosen)
    ]


def _best(problem: _Problem, trials: Sequence[list[int]]) -> tuple[list[int], float]:
    """Return the choice with which the data are likeliest; the first of equals."""
    best, score = [], -np.inf
    for trial in trials:
        found = problem.fit(trial).log_evidence
        if found > score + 1e-6:
            best, score = trial, found
    return best, float(score)


def _settled(problem: _Problem, chosen: list[int], score: float) -> tuple[list[int], float]:
    """Exchange single causes for others as long as that makes the data likelier."""
    for _ in range(MOST_CAUSES):
        trials = [
            [*chosen[:k], s, *chosen[k + 1 :]]
            for k in range(len(chosen))
            for s in _free(problem, [*chosen[:k], *chosen[k + 1 :]])
            if s != chosen[k]
        ]
        trial, better = _best(problem, trials)
        if better - score < _GAIN:
            break
        chosen, score = trial, better
    return chosen, score


def _felt(problem: _Problem, chosen: list[int]) -> list[int]:
    """Leave out causes without which the RMS would be no larger, however likely they are."""
    while chosen:
        found = problem.fit(chosen)
        picks, least = problem.picks(chosen), LEAST_SHARE * float(problem.gram[-1, -1])
        now = _left(problem, picks, found.coefficients)
        for s in chosen:
            kept = ~np.isin(picks, problem.owner[s])
            if _left(problem, np.array(picks)[kept], found.coefficients[kept]) - now < least:
                chosen = [other for other in chosen if other != s]
                break
        else:
            break
    return chosen


def _named(problem: _Problem, chosen: list[int], score: float) -> list[int]:
    """Give each cause the first name of those that fit as well."""
    for k in range(len(chosen)):
        others = [*chosen[:k], *chosen[k + 1 :]]
        for s in (s for s in _free(problem, others) if s < chosen[k]):
            trial = [*chosen[:k], s, *chosen[k + 1 :]]
            if (found := problem.fit(trial).log_evidence) > score - np.log(BARE):
                chosen, score = trial, found
                break
    return chosen


def _likeness(problem: _Problem, s: int, other: int) -> float:
    """Return how well the columns of one cause can take those of another, 0 to 1: the least of them."""
    mine, its = problem.owner[s], problem.owner[other]
    if len(mine) > len(its):
        mine, its = its, mine
    g = problem.gram
    within = g[np.ix_(its, mine)]
    taken = within.T @ np.linalg.pinv(g[np.ix_(its, its)], hermitian=True) @ within
    shares = np.linalg.eigvals(np.linalg.pinv(g[np.ix_(mine, mine)], hermitian=True) @ taken).real
    return float(np.sqrt(np.clip(shares.min(), 0.0, 1.0)))


def _left(problem: _Problem, picks: Sequence[int] | NDArray[np.intp], coefficients: Array) -> float:
    """Return the mean square of the deviations without what some columns contribute, mm^2."""
    whole = np.append(-coefficients, 1.0)
    pick = np.append(np.asarray(picks, dtype=np.intp), len(problem.gram) - 1)
    return max(float(whole @ problem.gram[np.ix_(pick, pick)] @ whole), 0.0)


def _cause(problem: _Problem, chosen: Sequence[int], k: int, found: Fit) -> Cause:
    """Return one of the chosen causes, with those that could stand in its place."""
    others = [*chosen[:k], *chosen[k + 1 :]]
    own = problem.owner[chosen[k]]
    c, covariance = _of(problem, chosen, k, found)
    signature = problem.signatures[chosen[k]]
    total, block = problem.gram[-1, -1], problem.gram[np.ix_(own, own)]
    square = float(c @ block @ c)
    left = _left(problem, own, c)
    every = np.asarray(problem.picks(chosen), dtype=np.intp)
    rest = 2.0 * problem.gram[own, -1] - problem.gram[np.ix_(own, every)] @ found.coefficients
    slope = 2.0 * block @ c / total
    gain = found.log_evidence - problem.fit(others).log_evidence
    value, u = _size(problem, signature, own, c, covariance)
    angle, u_angle = _angle(signature.lobes, c, covariance)
    return Cause(
        name=signature.name,
        value=value,
        u=u,
        unit=signature.unit,
        angle_deg=angle,
        u_angle_deg=u_angle,
        sign=signature.sign,
        remedy=signature.remedy,
        share=float(np.clip(c @ rest / total, 0.0, 1.0)),
        u_share=float(np.sqrt(slope @ covariance @ slope)),
        rms_um=square**0.5 * UM_PER_MM,
        rms_without_um=left**0.5 * UM_PER_MM,
        odds=float(min(np.exp(min(gain, 50.0)), _CAP)),
        alternatives=_alternatives(problem, chosen, k, c, found.log_evidence),
    )


def _of(problem: _Problem, chosen: Sequence[int], k: int, found: Fit) -> tuple[Array, Array]:
    """Return coefficients and covariance of one of the chosen causes."""
    first = len(problem.picks(chosen[:k]))
    mine = slice(first, first + len(problem.owner[chosen[k]]))
    return found.coefficients[mine], found.covariance[mine, mine]


def _alternatives(
    problem: _Problem, chosen: Sequence[int], k: int, c: Array, log_evidence: float
) -> tuple[Member, ...]:
    """Return the causes that the data cannot tell from one of the chosen ones, likeliest first."""
    others = [*chosen[:k], *chosen[k + 1 :]]
    own, g, members = problem.owner[chosen[k]], problem.gram, []
    for s in problem.candidates:
        if s in chosen:
            continue
        its = problem.owner[s]
        pull = g[np.ix_(its, own)] @ c
        taken = pull @ np.linalg.pinv(g[np.ix_(its, its)], hermitian=True) @ pull
        alike = taken >= ALIKE**2 * float(c @ g[np.ix_(own, own)] @ c)
        trial = [*others, s]
        found = problem.fit(trial)
        if not alike and log_evidence - found.log_evidence > np.log(CANNOT_TELL):
            continue
        its_c, covariance = _of(problem, trial, len(others), found)
        signature = problem.signatures[s]
        value, u = _size(problem, signature, its, its_c, covariance)
        angle = _angle(signature.lobes, its_c, covariance)[0]
        behind = float(np.exp(np.clip(log_evidence - found.log_evidence, 0.0, 50.0)))
        member = Member(signature.name, value, u, signature.unit, angle, signature.sign, min(behind, _CAP))
        members.append((-round(found.log_evidence, 3), s, member))
    return tuple(member for _, _, member in sorted(members, key=lambda m: m[:2]))


def _size(
    problem: _Problem, signature: Signature, own: NDArray[np.intp], c: Array, covariance: Array
) -> tuple[float, float]:
    """Return the value of a cause and its standard uncertainty; with lobes the PV over the points, um."""
    if not signature.lobes:
        return float(c[0]), float(np.sqrt(covariance[0, 0]))
    columns = problem.columns[:, own]
    field = columns @ c
    g = (columns[int(np.argmax(field))] - columns[int(np.argmin(field))]) * UM_PER_MM
    return float(g @ c), float(np.sqrt(g @ covariance @ g))


def _angle(lobes: int, c: Array, covariance: Array) -> tuple[float | None, float | None]:
    """Return the direction of a lobe of ``c0 cos(m t) + c1 sin(m t)`` and its standard uncertainty, deg."""
    if not lobes:
        return None, None
    period = 360.0 / lobes
    across = np.array([-c[1], c[0]]) / (float(c @ c) * lobes)
    sigma = float(np.sqrt(across @ covariance @ across)) * DEG_PER_RAD
    angle = float(np.arctan2(c[1], c[0])) * DEG_PER_RAD / lobes % period
    return angle, min(sigma, period / 12.0**0.5)
