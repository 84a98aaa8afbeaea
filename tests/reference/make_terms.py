"""Heights and derivatives of every family of terms from their definitions, with 60 digits (mpmath).

Nothing of the package is used: sums are written out with factorials and powers, the polynomials of Forbes
are orthogonalised afresh from their inner product, derivatives are differences of 60-digit heights. Run
``python make_terms.py`` here: it writes terms.csv.
"""

import csv
import tomllib
from functools import cache
from pathlib import Path

import mpmath as mp

mp.mp.dps = 60
HERE = Path(__file__).parent
ZERO = mp.mpf(0)


def conic(x, y, radius, k):
    if radius is None:
        return ZERO
    c = 1 / radius
    q2 = x * x + y * y
    return c * q2 / (1 + mp.sqrt(1 - (1 + k) * c * c * q2))


def base(x, y, t):
    radius = 1 / mp.mpf(t["curvature"]) if "curvature" in t else t.get("radius")
    return conic(x, y, None if radius is None else mp.mpf(radius), mp.mpf(t.get("conic", 0)))


def obliquity(x, y, t):
    """1 / cos of the slope angle of the base, from its numerical slope."""
    r = mp.sqrt(x * x + y * y)
    slope = mp.diff(lambda s: base(s, ZERO, t), r)
    return mp.sqrt(1 + slope * slope)


def asphere(x, y, t):
    r = mp.sqrt(x * x + y * y) / mp.mpf(t.get("normalization_radius", 1))
    return base(x, y, t) + sum(value * r ** int(n) for n, value in t.get("coefficients", {}).items())


def biconic(x, y, t):
    def part(axis):
        c = 1 / mp.mpf(t[f"radius_{axis}"]) if f"radius_{axis}" in t else ZERO
        return c, mp.mpf(t.get(f"conic_{axis}", 0))

    (cx, kx), (cy, ky) = part("x"), part("y")
    root = mp.sqrt(1 - (1 + kx) * (cx * x) ** 2 - (1 + ky) * (cy * y) ** 2)
    return (cx * x * x + cy * y * y) / (1 + root)


def toroid(x, y, t):
    g = asphere(ZERO, y, t)
    if "radius_of_rotation" not in t:
        return g
    big = mp.mpf(t["radius_of_rotation"])
    return big - mp.sign(big) * mp.sqrt((big - g) ** 2 - x * x)


def xy_polynomial(x, y, t):
    size = mp.mpf(t["normalization_radius"])
    powers = ((*map(int, key.split(",")), value) for key, value in t["coefficients"].items())
    return sum(value * (x / size) ** i * (y / size) ** j for i, j, value in powers)


def product_series(x, y, t):
    one = mp.chebyt if t["kind"] == "chebyshev" else mp.legendre
    u, v = x / mp.mpf(t["half_width"]), y / mp.mpf(t["half_height"])
    total = ZERO
    for key, value in t["coefficients"].items():
        i, j = map(int, key.split(","))
        total += value * one(i, u) * one(j, v)
    return total


NOLL = {1: (0, 0), 2: (1, 1), 3: (1, -1), 4: (2, 0), 5: (2, -2), 6: (2, 2), 7: (3, -1), 8: (3, 1), 9: (3, -3)}
NOLL |= {11: (4, 0), 12: (4, 2), 13: (4, -2), 22: (6, 0), 35: (7, -7), 36: (7, 7), 66: (10, 10)}
FRINGE = {
    2: (1, 1),
    3: (1, -1),
    4: (2, 0),
    5: (2, 2),
    6: (2, -2),
    7: (3, 1),
    8: (3, -1),
    9: (4, 0),
    10: (3, 3),
}
FRINGE |= {11: (3, -3), 12: (4, 2), 17: (4, 4), 20: (5, -3), 21: (6, 2), 24: (7, -1), 26: (5, 5), 35: (9, -1)}
FRINGE |= {36: (10, 0), 37: (12, 0)}


def zernike(x, y, t):
    size = mp.mpf(t["normalization_radius"])
    r, angle = mp.sqrt(x * x + y * y) / size, mp.atan2(y, x)
    total = ZERO
    for key, value in t["coefficients"].items():
        n, signed = (NOLL if t["convention"] == "noll" else FRINGE)[int(key)]
        m = abs(signed)
        ring = ZERO
        for s in range((n - m) // 2 + 1):
            below = mp.factorial(s) * mp.factorial((n + m) // 2 - s) * mp.factorial((n - m) // 2 - s)
            ring += (-1) ** s * mp.factorial(n - s) / below * r ** (n - 2 * s)
        scale = mp.sqrt((n + 1) * (2 if m else 1)) if t["convention"] == "noll" else 1
        total += value * scale * ring * (mp.cos(m * angle) if signed >= 0 else mp.sin(m * angle))
    return total


@cache
def monomial_slopes(i, j, m):
    """Mean over the disk, weight 1 / (u sqrt(1 - u^2)), of grad(u^i cos) . grad(u^j cos).

    The integral of u^s / sqrt(1 - u^2) is sqrt(pi) Gamma((s + 1) / 2) / (2 Gamma(s / 2 + 1)); the mean is
    that divided by pi / 2. Over the angle the mean of cos^2 and sin^2 is 1/2, and 1 for m = 0.
    """
    s = i + j - 2
    if i * j + m * m == 0:
        return ZERO
    mean = mp.gamma(mp.mpf(s + 1) / 2) / (mp.sqrt(mp.pi) * mp.gamma(mp.mpf(s) / 2 + 1))
    return (i * j + m * m) * mean / (2 if m else 1)


@cache
def slope_orthonormal(m, n):
    """Powers of u of the n-th departure of azimuthal order m; the leading sign is (-1)^n."""

    def inner(a, b):
        return sum(va * vb * monomial_slopes(i, j, m) for i, va in a.items() for j, vb in b.items())

    if m == 0:
        row = {2 * n + 2: mp.mpf(-1) ** n, 2 * n + 4: -(mp.mpf(-1) ** n)}
    else:
        row = {m + 2 * n: mp.mpf(-1) ** n}
    for k in range(n):
        before = slope_orthonormal(m, k)
        share = inner(row, before)
        for i, value in before.items():
            row[i] = row.get(i, ZERO) - share * value
    size = mp.sqrt(inner(row, row))
    return {i: value / size for i, value in row.items()}


def slope_q(x, y, t, terms):
    size = mp.mpf(t["normalization_radius"])
    u, angle = mp.sqrt(x * x + y * y) / size, mp.atan2(y, x)
    total = ZERO
    for letter, m, n, value in terms:
        ring = sum(c * u**i for i, c in slope_orthonormal(m, n).items())
        total += value * ring * (mp.cos(m * angle) if letter == "a" else mp.sin(m * angle))
    return base(x, y, t) + total * obliquity(x, y, t)


def q_bfs(x, y, t):
    return slope_q(x, y, t, [("a", 0, int(n), value) for n, value in t["coefficients"].items()])


def q_2d(x, y, t):
    split = [(key[0], *map(int, key[1:].split(",")), value) for key, value in t["coefficients"].items()]
    return slope_q(x, y, t, split)


def q_con(x, y, t):
    v = (x * x + y * y) / mp.mpf(t["normalization_radius"]) ** 2
    total = sum(value * mp.jacobi(int(n), 0, 4, 2 * v - 1) for n, value in t["coefficients"].items())
    return base(x, y, t) + v * v * total


HEIGHTS = {
    "conic": base,
    "even_asphere": asphere,
    "odd_asphere": asphere,
    "biconic": biconic,
    "toroid": toroid,
}
HEIGHTS |= {"xy_polynomial": xy_polynomial, "chebyshev": product_series, "legendre": product_series}
HEIGHTS |= {"zernike": zernike, "q_bfs": q_bfs, "q_con": q_con, "q_2d": q_2d}


def height(x, y, t):
    """Height of a term; a tilted one by the secant method along the vertical."""
    own = HEIGHTS[t["kind"]]
    dx, dy, dz = [mp.mpf(v) for v in [*t.get("decentre", [0, 0]), 0][:3]]
    if "tilt_deg" not in t:
        return own(x - dx, y - dy, t) + dz
    a, b, c = (mp.radians(mp.mpf(v)) for v in t["tilt_deg"])
    rx = mp.matrix([[1, 0, 0], [0, mp.cos(a), -mp.sin(a)], [0, mp.sin(a), mp.cos(a)]])
    ry = mp.matrix([[mp.cos(b), 0, mp.sin(b)], [0, 1, 0], [-mp.sin(b), 0, mp.cos(b)]])
    rz = mp.matrix([[mp.cos(c), -mp.sin(c), 0], [mp.sin(c), mp.cos(c), 0], [0, 0, 1]])
    back = (rx * ry * rz).T

    def miss(w):
        p = back * mp.matrix([x - dx, y - dy, w])
        return p[2] - own(p[0], p[1], t)

    return mp.findroot(miss, (mp.mpf(0), mp.mpf("0.1"))) + dz


def jet(x, y, t):
    """Height and central differences of step 1e-16 with one Richardson step: more than 20 digits."""

    def d(h):
        f = {(i, j): height(x + i * h, y + j * h, t) for i in (-1, 0, 1) for j in (-1, 0, 1)}
        return [
            (f[1, 0] - f[-1, 0]) / (2 * h),
            (f[0, 1] - f[0, -1]) / (2 * h),
            (f[1, 0] - 2 * f[0, 0] + f[-1, 0]) / h**2,
            (f[1, 1] - f[1, -1] - f[-1, 1] + f[-1, -1]) / (4 * h**2),
            (f[0, 1] - 2 * f[0, 0] + f[0, -1]) / h**2,
        ]

    h = mp.mpf("1e-16")
    coarse, fine = d(h), d(h / 2)
    return [height(x, y, t)] + [(4 * b - a) / 3 for a, b in zip(coarse, fine, strict=True)]


SHARES = [
    (0.0, 0.0),
    (1e-7, -2e-7),
    (0.11, 0.05),
    (-0.31, 0.62),
    (0.77, -0.29),
    (-0.6, -0.93),
    (1.0, 1.0),
    (0.5, 0.0),
]
SHARES += [(0.0, -0.8)]


def main():
    with (HERE / "terms.toml").open("rb") as file:
        cases = tomllib.load(file)["case"]
    with (HERE / "terms.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["case", "x", "y", "z", "zx", "zy", "zxx", "zxy", "zyy"])
        for case in cases:
            for a, b in SHARES:
                if (a, b) == (0.0, 0.0) and case["name"] == "odd_asphere_cone":
                    continue
                x, y = a * case["half"], b * case["half"]
                values = jet(mp.mpf(x), mp.mpf(y), case["term"])
                writer.writerow(
                    [
                        case["name"],
                        repr(x),
                        repr(y),
                        *(mp.nstr(v, 20, min_fixed=1, max_fixed=0) for v in values),
                    ]
                )


if __name__ == "__main__":
    main()
