"""Single polynomials of Zernike and Forbes by prysm 0.21.1, of unit amplitude: writes prysm.csv.

Columns: family, n, m (negative = sine), u (normalised radius), t (rad), value.
"""

import csv
from pathlib import Path

import numpy as np
from prysm.polynomials import Q2d, Qbfs, Qcon
from prysm.polynomials.zernike import zernike_nm

PLACES = [(0.15, 0.3), (0.6, -2.0), (0.97, 1.1)]


def rows():
    for u, t in PLACES:
        r, a = np.array([u]), np.array([t])
        for n in (0, 1, 2, 3, 5, 9):
            yield "q_bfs", n, 0, u, t, Qbfs(n, r)[0]
            yield "q_con", n, 0, u, t, Qcon(n, r)[0]
        for n in (0, 1, 2, 3, 4, 6):
            for m in (2, -3, 4, 6):
                yield "q_2d", n, m, u, t, Q2d(n, m, r, a)[0]
        for n, m in [(2, 0), (3, 1), (3, -1), (4, -2), (5, 5), (7, -3), (10, 4)]:
            yield "zernike_norm", n, m, u, t, zernike_nm(n, m, r, a, norm=True)[0]


if __name__ == "__main__":
    with (Path(__file__).parent / "prysm.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["family", "n", "m", "u", "t", "value"])
        for *head, value in rows():
            writer.writerow([*head, repr(float(value))])
