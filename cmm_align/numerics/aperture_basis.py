"""Shapes of low order over whatever part of an aperture carries data, made orthonormal on just those places.

Over a full disk Zernike's polynomials are orthogonal, over a full rectangle products of Legendre's; on a real
mask nothing is until it is made so, here by QR. The span then decides all: another centre or another length
to normalise by changes the conditioning, hardly the answer.

The order is that of a ladder: first what the caller brings (the rigid motions), then power, astigmatism,
coma, trefoil and spherical aberration, each in one scale for x and y so that they keep their meaning on a
rectangle that is no square; then piston and tilt, of which the rigid motions leave little; then the rest.
Power comes before piston because on a strongly curved surface a piston *is* mostly power: there a rigid
motion takes away n_z and not 1.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from cmm_align.numerics.chunked import chunks

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

KINDS: Final = (
    ("power", ((2, 0),)),
    ("astigmatism", ((2, 2), (2, -2))),
    ("coma", ((3, 1), (3, -1))),
    ("trefoil", ((3, 3), (3, -3))),
    ("spherical", ((4, 0),)),
)
"""Kinds of low order and their Zernike polynomials (n, m); m < 0 is the sine."""

LEAST_NEW: Final = 1e-4
"""A column is no new shape if the ones before it leave less than this share of it: the root of the share
below which an alignment calls a motion unobservable."""

ROUND: Final = "round"
ANNULAR: Final = "annular"
RECTANGULAR: Final = "rectangular"
IRREGULAR: Final = "irregular"

_FEW: Final = 0.1
"""Share of the corners of the bounding box that may be filled for it to be round, or missing, rectangular."""
_ASPECT: Final = 0.05
"""Largest difference of width and height of something round, as a share."""
_HOLE: Final = 0.1
"""Least share of the outer radius that the hole of an annulus has."""
_GROUPS: Final = 6
"""Groups n + |m| = 0, 2 ... 10 of the Fringe list: 36 polynomials."""
_DEGREE: Final = 7
"""Products of Legendre polynomials up to this total degree: 36 too."""


class Outline(NamedTuple):
    """What the places with data look like from outside."""

    shape: str
    """round, annular, rectangular or irregular."""
    centre: tuple[float, float]
    """Of the bounding box."""
    half: tuple[float, float]
    """Half width and half height of the box."""
    radius: float
    """Of the circle about the centre that holds all places."""


class Shapes(NamedTuple):
    """Named columns; the kinds come first, in the order of `KINDS`."""

    names: tuple[str, ...]
    columns: Array
    """Shape (n, 36)."""
    family: str
    """What the polynomials beyond the kinds are."""


def outline_of(x_nodes: Array, y_nodes: Array, known: Mask) -> Outline:
    """Return the outline of the known nodes of a grid.

    Parameters
    ----------
    x_nodes, y_nodes : ndarray, shape (nx,), (ny,)
        Evenly spaced, ascending; one unit of length for both.
    known : ndarray of bool, shape (ny, nx)
        At least one is.

    Returns
    -------
    Outline
        Looked at are the bounding box of the known nodes and its corners: the nodes outside its ellipse.
        *Rectangular*: nine tenths of the corners are known. *Round*: width and height differ by less
        than a twentieth (or two steps), and less than a tenth of the corners is known. *Annular*: round, and
        nothing known within a tenth of the radius (and two steps) of the centre. Else *irregular*.
    """
    iy, ix = np.nonzero(known)
    x, y = x_nodes[ix], y_nodes[iy]
    (cx, hx), (cy, hy) = _middle(x), _middle(y)
    step = max((float(a[1] - a[0]) for a in (x_nodes, y_nodes) if len(a) > 1), default=0.0)
    box = known[iy.min() : iy.max() + 1, ix.min() : ix.max() + 1]
    # Half a step beyond the outer nodes: where a disk would end.
    u = (x_nodes[ix.min() : ix.max() + 1] - cx) / (hx + 0.5 * step or 1.0)
    v = (y_nodes[iy.min() : iy.max() + 1] - cy) / (hy + 0.5 * step or 1.0)
    corners = u**2 + v[:, None] ** 2 > 1.0
    filled = float(box[corners].mean()) if corners.any() else 1.0
    r = np.hypot(x - cx, y - cy)
    shape = IRREGULAR
    if filled >= 1.0 - _FEW:
        shape = RECTANGULAR
    elif filled <= _FEW and abs(hx - hy) <= max(_ASPECT * max(hx, hy), step):
        hole = float(r.min()) > max(_HOLE * float(r.max()), 2.0 * step)
        shape = ANNULAR if hole else ROUND
    return Outline(shape, (cx, cy), (hx, hy), float(r.max()))


def low_order_shapes(outline: Outline, x: Array, y: Array) -> Shapes:
    """Return 36 polynomials by their kinds, not yet orthogonal to anything.

    Parameters
    ----------
    outline : Outline
    x, y : ndarray, shape (n,)
        Places, in the unit of the outline.

    Returns
    -------
    Shapes
        Round and annular: Zernike's, 1 to 36 of the Fringe list, over the bounding circle. Else all products
        of Legendre's up to total degree 7 over the bounding rectangle; those up to degree 3, and one of
        degree 4, are replaced by the kinds, piston and tilt, which leaves the span as it is.
    """
    radius = outline.radius or 1.0
    u, v = (x - outline.centre[0]) / radius, (y - outline.centre[1]) / radius
    low = [(n, m) for _, members in KINDS for n, m in members]
    names = [_name(kind, m) for kind, members in KINDS for _, m in members]
    names += ["piston", "tilt x", "tilt y"]
    low += [(0, 0), (1, 1), (1, -1)]
    columns = [zernike(n, m, u, v) for n, m in low]
    if outline.shape in {ROUND, ANNULAR}:
        listed = [(n, m) for n, m in _fringe() if (n, m) not in low]
        names += [f"Z{_fringe().index(pair) + 1}" for pair in listed]
        columns += [zernike(n, m, u, v) for n, m in listed]
        return Shapes(tuple(names), np.stack(columns).T, "Zernike, Fringe 1 to 36")
    p = legendre.legvander((x - outline.centre[0]) / (outline.half[0] or 1.0), _DEGREE)
    q = legendre.legvander((y - outline.centre[1]) / (outline.half[1] or 1.0), _DEGREE)
    for degree in range(4, _DEGREE + 1):
        for j in range(degree + 1):
            if (degree, j) != (4, 2):  # its place is taken by spherical aberration
                names.append(f"L{degree - j},{j}")
                columns.append(p[:, degree - j] * q[:, j])
    return Shapes(tuple(names), np.stack(columns).T, "Legendre products to degree 7")


def zernike(n: int, m: int, u: Array, v: Array) -> Array:
    """Return a Zernike polynomial with ``R(1) = 1``: ``R_n^|m|(r) cos(m t)``, or sin for negative m.

    Parameters
    ----------
    n, m : int
        Degree and azimuthal order, ``n - |m|`` even.
    u, v : ndarray, shape (k,)
        Places over the normalisation radius; t counts from +u towards +v.

    Returns
    -------
    ndarray, shape (k,)

    Notes
    -----
    ``R_n^m(r) = r^m P_k^(0,m)(2 r^2 - 1)``, ``k = (n - m) / 2``: NIST DLMF 18.37.1.
    """
    order = abs(m)
    around = (u + 1j * v) ** order
    radial = _jacobi((n - order) // 2, order, 2.0 * (u * u + v * v) - 1.0)
    return np.asarray(radial * (around.imag if m < 0 else around.real), dtype=np.float64)


def _jacobi(k: int, b: int, x: Array) -> Array:
    """Return ``P_k^(0,b)(x)`` by its recurrence in k: NIST DLMF 18.9.1 with 18.9.2, alpha = 0."""
    before, now = np.zeros_like(x), np.ones_like(x)
    for j in range(k):
        twice = 2 * j + b
        if j == 0:
            after = 0.5 * ((b + 2) * x - b)
        else:
            after = (twice + 1) * ((twice * (twice + 2)) * x - b * b) * now
            after -= 2 * j * (j + b) * (twice + 2) * before
            after /= 2 * (j + 1) * (j + b + 1) * twice
        before, now = now, after
    return now


def orthonormalised(
    columns: Array, least_new: float = LEAST_NEW, weights: Array | None = None
) -> tuple[Array, Mask]:
    """Return columns with ``mean(w q_i q_j) = delta_ij``: each the given one, less all before it.

    Parameters
    ----------
    columns : ndarray, shape (n, m), n >= m
    least_new : float
        A column that keeps less than this share of itself is no new shape.
    weights : ndarray, shape (n,), optional
        The w above, mean 1; without it, all alike.

    Returns
    -------
    q : ndarray, shape (n, m)
        Zero where a column is no new shape. ``mean(w q_i field)`` is the coefficient of a field, in its unit;
        its square is that shape's share of the mean square.
    fresh : ndarray of bool, shape (m,)

    Notes
    -----
    The Cholesky factor of the Gram matrix, twice, is as good as Householder's QR (Yamamoto et al., "Roundoff
    error analysis of the CholeskyQR2 algorithm", ETNA 44, 2015), and several times as fast on many places. A
    column that is no new shape is left out of the factor, so that no other is freed of its rounding.
    """
    m = columns.shape[1]
    gram = _gram(columns, np.eye(m), weights)
    lengths = np.sqrt(np.diag(gram))
    fresh = lengths > 0.0
    lengths = np.where(fresh, lengths, 1.0)
    lower, fresh = _cholesky(gram / np.outer(lengths, lengths), least_new**2)
    mixing = np.zeros((m, m))
    mixing[np.ix_(fresh, fresh)] = np.linalg.inv(lower).T / lengths[fresh, None]
    lower, _ = _cholesky(_gram(columns, mixing, weights)[np.ix_(fresh, fresh)], 0.0)
    again = np.zeros((m, m))
    again[np.ix_(fresh, fresh)] = np.linalg.inv(lower).T
    q = np.empty_like(columns)
    for part in chunks(len(q)):
        q[part] = columns[part] @ mixing @ again
    return q, fresh


def _gram(columns: Array, mixing: Array, weights: Array | None) -> Array:
    """Return the weighted mean products of mixed columns, shape (m, m)."""
    total = np.zeros_like(mixing)
    for part in chunks(len(columns)):
        q = columns[part] @ mixing
        total += (q if weights is None else q * weights[part, None]).T @ q
    return total / len(columns)


def node_widths(nodes: Array, low: float, high: float) -> Array:
    """Return how much of an extent each node of an axis stands for, in steps.

    Parameters
    ----------
    nodes : ndarray, shape (n,), at least 2
        Evenly spaced, ascending.
    low, high : float
        Ends of the data, in the unit of the nodes.

    Returns
    -------
    ndarray, shape (n,)
        1 inside; half a step, and what lies between node and end but at most another half, for the outer
        nodes. As weights of a mean over nodes they are the midpoint rule: with equal ones a border that lies
        a quarter of a step inside the data counts a third too much.
    """
    step = float(nodes[1] - nodes[0])
    widths = np.ones(len(nodes))
    widths[0] = 0.5 + min(max((float(nodes[0]) - low) / step, 0.0), 0.5)
    widths[-1] = 0.5 + min(max((high - float(nodes[-1])) / step, 0.0), 0.5)
    return widths


def _cholesky(gram: Array, least: float) -> tuple[Array, Mask]:
    """Return the Cholesky factor of the rows whose pivot exceeds `least`, and which rows those are."""
    m = len(gram)
    lower, rest = np.zeros((m, m)), gram.copy()
    fresh = np.diag(rest) > least
    for k in range(m):
        fresh[k] = rest[k, k] > least
        if fresh[k]:
            lower[k:, k] = rest[k:, k] / np.sqrt(rest[k, k])
            rest[k:, k:] -= np.outer(lower[k:, k], lower[k:, k])
    return lower[np.ix_(fresh, fresh)], fresh


def _name(kind: str, m: int) -> str:
    """Name one polynomial of a kind."""
    if kind == "coma":
        return f"coma {'x' if m > 0 else 'y'}"
    if m == 0:
        return kind
    return f"{kind} {0 if m > 0 else 90 // abs(m)}"


def _fringe() -> list[tuple[int, int]]:
    """Return (n, m) of the Fringe list from 1 to 36: by n + |m|, then falling |m|, cosine before sine."""
    pairs = []
    for group in range(_GROUPS):
        for m in range(group, -1, -1):
            pairs.append((2 * group - m, m))
            if m > 0:
                pairs.append((2 * group - m, -m))
    return pairs


def _middle(values: Array) -> tuple[float, float]:
    """Return centre and half extent."""
    low, high = float(values.min()), float(values.max())
    return 0.5 * (low + high), 0.5 * (high - low)
