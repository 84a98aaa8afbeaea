"""Which rigid motions the data can tell, and the names of those they cannot.

Motions are small twists (w, t) about the centroid of the data: every point moves by ``w x (p - c) + t``.
Rotations are scaled by the rms radius of the data, so that the six columns compare and every threshold
is free of units. Source: Gelfand et al., "Geometrically stable sampling for the ICP algorithm", 2003,
doi 10.1109/IM.2003.1240258; the invariance classes follow ISO 17450-1.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_PURE: Final = 1e-3
"""Share of rotation (scaled) below which a free motion is called a translation."""

_SURE: Final = 0.5
"""Share of what holds a motion that must come from datum terms for it not to be free."""
_AFTER: Final = 1e-6
"""Weight of translations beside rotations when a free motion is held."""
_NEWTON_FLOOR: Final = 0.1
"""Newton's matrix must keep this share of ``J^T J`` in every motion to be trusted."""
_TIE: Final = 1e-9
"""Relative difference that may be rounding."""


class Spectrum(NamedTuple):
    """Eigen-decomposition of the scaled normal matrix, weakest motion first."""

    values: Array
    """Shape (k,): mean squared change of the residual for a unit motion; k is 6 where nothing is locked."""
    motions: Array
    """Shape (6, k), one motion a column, scaled (rotation times length, translation)."""
    free: NDArray[np.bool_]
    """Shape (k,): which motions the data cannot tell."""


def spectrum(
    normal_matrix: Array, threshold: float, allowed: Array | None = None, sure: Array | None = None
) -> Spectrum:
    """Split the motions into observable and free ones.

    Parameters
    ----------
    normal_matrix : ndarray, shape (6, 6)
        ``J^T J / N`` with scaled rotation columns, order (rx, ry, rz, tx, ty, tz).
    threshold : float
        Free are motions whose eigenvalue is below this share of the largest one.
    allowed : ndarray, shape (6, k), optional
        Orthonormal basis of the motions that are not locked; all six without it.
    sure : ndarray, shape (6, 6), optional
        Part of `normal_matrix` that no roughness of the surface can feign (datum terms): a motion that it
        holds is not free, however softly.
    """
    if allowed is None:
        allowed = np.eye(len(normal_matrix))
    values, motions = np.linalg.eigh(allowed.T @ normal_matrix @ allowed)
    motions = allowed @ motions
    free = values <= threshold * values.max(initial=0.0)
    if sure is not None:
        free &= np.einsum("ik,ij,jk->k", motions, sure, motions) < _SURE * values
    return Spectrum(values, motions, free)


def solve_observable(spectral: Spectrum, gradient: Array, curvature: Array | None = None) -> Array:
    """Return the step in the observable motions only, shape (6,), scaled.

    Parameters
    ----------
    spectral : Spectrum
    gradient : ndarray, shape (6,)
    curvature : ndarray, shape (6, 6), optional
        What Newton's matrix has beyond ``J^T J``; left out where the sum is not positive definite.
    """
    keep = ~spectral.free
    basis = spectral.motions[:, keep]
    pull = basis.T @ gradient
    step: Array = -basis @ (pull / spectral.values[keep])
    if curvature is not None and keep.any():
        root = np.sqrt(spectral.values[keep])
        relative = np.eye(len(root)) + (basis.T @ curvature @ basis) / np.outer(root, root)
        if np.linalg.eigvalsh(relative)[0] > _NEWTON_FLOOR:
            step = -basis @ (np.linalg.solve(relative, pull / root) / root)
    return step


def free_part(spectral: Spectrum, motion: Array) -> Array:
    """Return the free motion that takes a given motion's rotation away, and then its translation.

    Of all placements that fit equally well, the one without turning is the one that a person expects.

    Parameters
    ----------
    spectral : Spectrum
    motion : ndarray, shape (6,)
        Scaled.

    Returns
    -------
    ndarray, shape (6,)
        To be subtracted from `motion`.
    """
    basis = spectral.motions[:, spectral.free]
    weight = np.array([1.0, 1.0, 1.0, _AFTER, _AFTER, _AFTER])
    share = np.linalg.lstsq(basis * weight[:, None], motion * weight, rcond=None)[0]
    part: Array = basis @ share
    return part


def uncertain_axes(spectral: Spectrum) -> NDArray[np.bool_]:
    """Return which of (rx, ry, rz, tx, ty, tz) a free motion has a part in, shape (6,)."""
    share = np.linalg.norm(spectral.motions[:, spectral.free], axis=1)
    uncertain: NDArray[np.bool_] = share > _PURE
    return uncertain


def free_motions_in_words(spectral: Spectrum, centroid_mm: Array, length_mm: float) -> tuple[str, ...]:
    """Name the free motions as a person at the machine would.

    Parameters
    ----------
    spectral : Spectrum
    centroid_mm : ndarray, shape (3,), mm, frame `part`
        Where the motions turn about.
    length_mm : float
        Length that the rotation columns were scaled by, mm.

    Returns
    -------
    tuple of str
        One sentence a motion: translations first, then rotations with their axis.
    """
    free = spectral.motions[:, spectral.free]
    if free.shape[1] == 0:
        return ()
    # Turn the basis of the free space so that as many motions as possible are pure translations.
    _, rotation_share, mixing = np.linalg.svd(free[:3, :])
    rank = int(np.count_nonzero(rotation_share > _PURE))
    turned = free @ mixing.T
    rotations, translations = turned[:, :rank], turned[:, rank:]
    words = [f"translation along {_direction(t[3:])}" for t in _tidied(translations[3:].T, translations).T]
    for twist in _tidied(rotations[:3].T, rotations).T:
        w, t = twist[:3] / length_mm, twist[3:]
        size = float(np.linalg.norm(w))
        axis = w / size
        point = centroid_mm + np.cross(w, t) / size**2
        pitch = float(axis @ t) / size
        kind = (
            "rotation"
            if abs(pitch) < _PURE * length_mm
            else f"screw motion ({pitch * 2 * np.pi:.4g} mm/turn)"
        )
        words.append(f"{kind} about the axis through ({_place(point)}) mm along {_direction(axis)}")
    return tuple(words)


def _tidied(directions: Array, motions: Array) -> Array:
    """Turn motions so that their directions line up with the coordinate axes where they can.

    Parameters
    ----------
    directions : ndarray, shape (k, 3)
        Direction of each motion.
    motions : ndarray, shape (6, k)
    """
    k = motions.shape[1]
    if k < 2:
        return motions
    span = np.linalg.svd(directions)[2][:k]
    reach = np.linalg.norm(span, axis=0)  # how much of each axis lies in the span
    axes = np.sort(np.argsort(reach)[::-1][:k])
    mixing, *_ = np.linalg.lstsq(directions.T, np.eye(3)[:, axes], rcond=None)
    tidy: Array = motions @ mixing
    tidy /= np.linalg.norm(tidy, axis=0)
    return tidy


def _direction(vector: Array) -> str:
    """Write a direction as an axis name where it is one, else by its components."""
    unit = vector / np.linalg.norm(vector)
    k = int(np.argmax(np.abs(unit)))
    if abs(unit[k]) > 1.0 - 1e-6:
        return "xyz"[k]
    unit = np.round(unit * np.sign(unit[k]), 3) + 0.0  # no minus before a zero
    return f"({unit[0]:.3f}, {unit[1]:.3f}, {unit[2]:.3f})"


def _place(point_mm: Array) -> str:
    """Write a place with a sensible number of digits."""
    return ", ".join(f"{float(value) + 0.0:.3f}" for value in np.round(point_mm, 3))


def lined_up(basis: Array) -> Array:
    """Turn orthonormal motions, shape (6, k), so that each holds as much of one axis as it can."""
    rest, turned = basis.T.copy(), []
    for _ in range(basis.shape[1]):
        reach = np.linalg.norm(rest, axis=0)
        first = first_of_most(reach)
        unit = rest[:, first] / reach[first]
        turned.append(unit)
        rest -= np.outer(unit, unit @ rest)
    result: Array = basis @ np.column_stack(turned) if turned else basis
    return result


def first_of_most(values: Array) -> int:
    """Return where values, shape (n,), none negative, are largest; of ties the first, not a chance one."""
    return int(np.argmax(values >= (1.0 - _TIE) * values.max()))
