"""How often verdicts are wrong: ``python tests/bench/verdict.py [PARTS]``, 200 of each kind unless said.

Parts of known form are measured with noise and judged; limits are drawn within 2.5 u about the truth, which
is the form over the whole nominal. Told are the pull (error over its stated uncertainty: 0 and 1 if that is
honest), PASS given out of tolerance and FAIL within as shares of all parts so near the limit, and the share
within tolerance among parts of a stated probability. Each part has another form, other noise, another limit.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from table import Row, show

from cmm_align.config import ErrorMapConfig
from cmm_align.stages.error_map import error_map

sys.path.append(str(Path(__file__).resolve().parents[1]))
from truth_maps import PLANE, aligned

SIZE_UM = 2.0
"""RMS of every part."""
POINTS = 6000
BINS = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
SETTINGS = {
    "RMS": "tolerance_rms_um",
    "PV": "tolerance_pv_um",
    "profile": "tolerance_profile_um",
    "slope": "tolerance_slope_mrad",
}


def form_of(rng):
    """Power, astigmatism and six waves 15 to 60 mm long, of no particular size."""
    angle, length = rng.uniform(0.0, np.pi, 6), rng.uniform(15.0, 60.0, 6)
    kx, ky = 2 * np.pi / length * np.array([np.cos(angle), np.sin(angle)])
    size, phase = rng.normal(size=6), rng.uniform(0.0, 6.0, 6)
    p, q = rng.normal(size=2)

    def form(x, y):
        u, v = x / 51.0, y / 31.0
        waves = sum(s * np.sin(a * x + b * y + f) for s, a, b, f in zip(size, kx, ky, phase, strict=True))
        return p * (u**2 + v**2) + q * (u**2 - v**2) + waves

    return form


def scan(_):
    """A scan over the whole nominal, border included."""
    nx = round(np.sqrt(POINTS * 102 / 62))
    x, y = np.meshgrid(np.linspace(-51, 51, nx), np.linspace(-31, 31, POINTS // nx))
    return x.ravel(), y.ravel()


def at_random(rng):
    """Places at random over the nominal."""
    return rng.uniform(-51, 51, POINTS), rng.uniform(-31, 31, POINTS)


def truth_of(form):
    """RMS, PV, profile and largest slope over the nominal, by 200 x 125 steps, border included."""
    x, y = np.meshgrid(np.linspace(-51, 51, 201), np.linspace(-31, 31, 126))
    e = form(x, y)
    w = np.outer(*(np.r_[0.5, np.ones(n - 2), 0.5] for n in (126, 201)))
    gy, gx = np.gradient(e, 62 / 125, 102 / 200)
    rms = float(np.sqrt(np.average(e**2, weights=w)))
    slope = float(np.hypot(gx, gy).max())
    return {"RMS": rms, "PV": float(np.ptp(e)), "profile": 2 * float(np.abs(e).max()), "slope": slope}


def judged(kind, parts, places_of, noise_um):
    """Return for every part: probability, verdict, whether it is within, pull."""
    rng = np.random.default_rng(7)
    found, u = [], 0.0
    for k in range(parts + 1):
        form = form_of(rng)
        truth = truth_of(form)
        scale = SIZE_UM / truth["RMS"]
        part = aligned(
            PLANE,
            lambda x, y, f=form, s=scale: 1e-3 * s * f(x, y),
            places_of(rng),
            noise_mm=noise_um * 1e-3,
            seed=1000 + k,
        )
        true = truth[kind] * scale
        limit = max(true + 2.5 * u * rng.uniform(-1.0, 1.0), 0.2 * true)
        m = error_map(part, ErrorMapConfig(**{SETTINGS[kind]: limit}))
        (j,) = m.conformance.judgements
        if k:  # the first one tells how uncertain they are
            found.append((j.probability, j.verdict, true <= limit, (j.value - true) / j.u))
        u = j.u
    return (np.array(v) for v in zip(*found, strict=True))


def main():
    """Print the tables."""
    parts = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    rates, calibration = [], []
    for kind in SETTINGS:
        for name, places_of, noise in (
            ("scan, noise 0.3 um", scan, 0.3),
            ("scan, noise 1 um", scan, 1.0),
            ("at random, noise 0.3 um", at_random, 0.3),
        ):
            p, verdict, within, pull = judged(kind, parts, places_of, noise)
            passed, failed = verdict == "pass", verdict == "fail"
            what = f"{kind}, {name}"
            rates.append(
                Row(
                    what,
                    "0.05",
                    f"wrong PASS {np.mean(passed & ~within):.3f}, wrong FAIL {np.mean(failed & within):.3f}; "
                    f"PASS {passed.mean():.2f}, FAIL {failed.mean():.2f}; "
                    f"pull {pull.mean():+.2f} +- {pull.std():.2f}",
                )
            )
            cells = []
            for low, high in pairwise(BINS):
                there = (p >= low) & (p <= high)
                cells.append(
                    f"{within[there].mean():.2f} of {there.sum():<3}" if there.any() else "-" + 9 * " "
                )
            calibration.append(Row(what, f"mean P {p.mean():.2f}: {within.mean():.2f}", "  ".join(cells)))
            print(f"{what}: {rates[-1].measured}", flush=True)
    show(f"Verdicts on {parts} parts each, limits within 2.5 u of the truth", rates)
    told = "  ".join(f"{low:.2f}-{high:.2f} " for low, high in pairwise(BINS))
    show(f"Share within tolerance where P is said to be  {told}", calibration)


if __name__ == "__main__":
    main()
