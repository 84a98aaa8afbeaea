"""The pass before: whether it is of this part, the chain whole, and what came of it.

The response is the share of the last correction that the part shows,

    c = <e_k - e_k+1, q> / <q, q>,   q = -correction_k,

over the nodes that both maps know. Noise and the repeatability of the process (correlated over a length l)
hand it ``u^2 = 2 (C + 2 pi l^2 s_rep^2) / (dx dy <q, q>)``, C the noise floor of a map. Near 0 the pass was
not ground, near -1 it was ground with the wrong sign; if the change looks like the correction turned or
mirrored, the frames differ.

Source: learned transfer as in iterative learning control, D. A. Bristow, M. Tharayil, A. G. Alleyne, IEEE
Control Systems 26, 2006, doi 10.1109/MCS.2006.1636313.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cmm_align.config import CompensateConfig
from cmm_align.errors import NumericsError, WrongStageError
from cmm_align.model import Correction, DeviationMap, PassResponse
from cmm_align.numerics.grid_field import interpolated
from cmm_align.stages.correction_grid import on_grid
from cmm_align.stages.map_noise import MapNoise, step_of
from cmm_align.stages.repeatability import repeatability_length_mm
from cmm_align.surfaces.protocol import Array
from cmm_align.units import UM_PER_MM

CLEAR: Final = 0.1
"""A response is judged where its uncertainty is below this."""
NO_RESPONSE: Final = 0.05
FACTOR: Final = 2.0
"""Uncertainties between a value and what it is not."""
LOOKS_LIKE: Final = 0.7
"""Correlation from which the change is said to look like another thing."""

ALIKE: Final = 0.95
"""Correlation from which a change is what it looks like."""
ITSELF: Final = "the correction"

_TURNS: Final = {
    "": (1, 1, False),
    "turned by 180 deg about z": (-1, -1, False),
    "mirrored in x": (-1, 1, False),
    "mirrored in y": (1, -1, False),
    "with x and y swapped": (1, 1, True),
}


def check_chain(deviation_map: DeviationMap, digest: str, previous: Correction | None) -> None:
    """Refuse a previous pass of another part, one that has this map in it, or one with passes missing.

    Raises
    ------
    WrongStageError
        If so.
    """
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
    if previous.pass_number != len(previous.applied_maps) + 1:
        raise WrongStageError(
            f"the previous correction is of pass {previous.pass_number}, but has "
            f"{len(previous.applied_maps)} maps before its own",
            expected="a chain without a gap",
            remedy="give the correction that this part was ground with",
        )


def pass_response(
    deviation: Array,
    x_mm: Array,
    y_mm: Array,
    noise: MapNoise,
    config: CompensateConfig,
    previous: Correction | None,
) -> PassResponse | None:
    """Return what came of the pass before; None for the first one and for files that do not tell.

    Parameters
    ----------
    deviation : ndarray, shape (ny, nx), mm
        Measured now, NaN where unknown.
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`
    noise : MapNoise
    config : CompensateConfig
        Repeatability; `trust_me` goes on whatever came of it.
    previous : Correction or None

    Raises
    ------
    WrongStageError
        If the part shows nothing of the correction: it was not ground.
    NumericsError
        If the pass made the part worse outside noise and repeatability.
    """
    if previous is None or previous.deviation_mm is None:
        return None
    before = on_grid(previous, previous.deviation_mm, x_mm, y_mm)
    told = -on_grid(previous, previous.correction_mm, x_mm, y_mm)
    both = np.isfinite(before) & np.isfinite(told) & np.isfinite(deviation)
    if not both.any():
        return None
    q, change = told[both], (before - deviation)[both]
    square = float(q @ q)
    if square == 0.0:
        return None
    transfer = float(change @ q) / square
    cell = step_of(x_mm) * step_of(y_mm)
    length = repeatability_length_mm(config, previous.nominal.surface.bounds)
    scatter_mm = config.repeatability_um / UM_PER_MM
    per_area = float(np.nan_to_num(noise.psd.noise_floor_mm4)) + 2.0 * np.pi * (length * scatter_mm) ** 2
    u = float(np.sqrt(2.0 * per_area / (cell * square)))
    rms_before, rms = (float(np.sqrt(np.mean(e[both] ** 2))) for e in (before, deviation))
    response = PassResponse(
        transfer=transfer,
        u_transfer=u,
        rms_before_mm=rms_before,
        rms_mm=rms,
        n=int(both.sum()),
        words=f"pass {previous.pass_number} did {100.0 * transfer:.0f} +- {100.0 * u:.0f} % of what it was "
        f"told: RMS {rms_before * UM_PER_MM:.2f} -> {rms * UM_PER_MM:.2f} um",
    )
    if not config.trust_me:
        _check_ground(response, previous)
        looks = _looks(previous, (x_mm, y_mm), np.where(both, before - deviation, np.nan))
        _check_frame(response, previous, looks)
        if rms - rms_before > FACTOR * float(np.hypot(scatter_mm, noise.scatter_mm)):
            raise _worse(response, previous, looks)
    return response


def _check_ground(response: PassResponse, previous: Correction) -> None:
    """Refuse a part that shows nothing of the correction it should have been ground with."""
    c, u = response.transfer, response.u_transfer
    if u < CLEAR and abs(c) <= max(FACTOR * u, NO_RESPONSE):
        raise WrongStageError(
            f"the part shows nothing of pass {previous.pass_number}: its deviations did not change along "
            f"that correction (share {c:.2f} +- {u:.2f})",
            expected="a map of the part after it was ground with it",
            remedy="check that the machine ran its file, and that this is the map measured afterwards; if it "
            "was not ground, leave --previous out; --trust-me goes on",
        )


def _check_frame(response: PassResponse, previous: Correction, looks: dict[str, float]) -> None:
    """Refuse a part that changed as the correction would in another frame."""
    best, plain = max(looks, key=lambda name: looks[name], default=ITSELF), looks.get(ITSELF, 1.0)
    if best == ITSELF or response.u_transfer >= CLEAR or plain >= ALIKE:
        return
    if looks[best] >= ALIKE and 1.0 - looks[best] < 0.5 * (1.0 - plain):
        raise NumericsError(
            f"pass {previous.pass_number} changed the part as {best} would (correlation "
            f"{looks[best]:.2f}, with "
            f"{ITSELF} itself {plain:.2f})",
            expected="a change like the correction",
            remedy="check sign, frame and file of what the machine ran; --trust-me goes on",
        )


def _worse(response: PassResponse, previous: Correction, looks: dict[str, float]) -> NumericsError:
    """Return the error that says that a pass did harm, and why it may have."""
    best = max(looks, key=lambda name: looks[name], default=ITSELF)
    why = "the change does not look like the correction: a wrong file, another part or another mounting?"
    if best != ITSELF and looks[best] >= LOOKS_LIKE:
        why = f"the change looks like {best} (correlation {looks[best]:.2f})"
    elif response.transfer > 1.0 + FACTOR * response.u_transfer:
        why = f"it cut {100.0 * response.transfer:.0f} % of what it was told"
    return NumericsError(
        f"pass {previous.pass_number} made the part worse: RMS {response.rms_before_mm * UM_PER_MM:.2f} -> "
        f"{response.rms_mm * UM_PER_MM:.2f} um, and {why}",
        expected="a smaller RMS, or a change within noise and repeatability",
        remedy="check sign, frame and file of what the machine ran; --trust-me goes on",
    )


def _looks(previous: Correction, axes: tuple[Array, Array], change: Array) -> dict[str, float]:
    """Return the correlation of a change with the correction, turned, mirrored, of either sign."""
    known = np.isfinite(change)
    x, y = (a[known] for a in np.meshgrid(*axes))
    looks = {}
    for name, (sx, sy, swap) in _TURNS.items():
        px, py = (sy * y, sx * x) if swap else (sx * x, sy * y)
        q = -interpolated(previous.x_mm, previous.y_mm, previous.correction_mm, px, py)
        there = np.isfinite(q)
        if there.sum() > known.sum() // 2 and np.ptp(q[there]) > 0.0:
            looks[f"{ITSELF} {name}".strip()] = float(np.corrcoef(q[there], change[known][there])[0, 1])
    wrong = {f"{ITSELF} with the wrong sign{name.removeprefix(ITSELF)}": -r for name, r in looks.items()}
    return {**looks, **wrong}
