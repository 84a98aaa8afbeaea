"""Causes that are found beside those that are there: ``python tests/bench/root_causes.py [SEEDS]``.

Tip centres of a steep freeform (the demo window, lines of a scan) are made with one thing wrong at a time
and 0.3 um of noise, and go through the real `align`. Then: several causes at once, causes beside form
error, a cap that is nearly a sphere, and parts whose error has no single cause."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from table import Row, Stopwatch, show

from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.pose import Pose
from cmm_align.stages.align import align
from cmm_align.stages.root_causes import root_causes
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.virtual.cmm import machine_from_part, scan_lines
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.window import window

sys.path.append(str(Path(__file__).resolve().parents[1]))
from truth_maps import Quadric, aligned, random_places

NOISE_MM = 0.3e-3
RADIUS_MM = 1.5
ARCSEC = np.pi / 180.0 / 3600.0
WINDOW = window()
DIGEST = "0" * 64
CAP = """
schema = "cmm-align/prescription/1"
[aperture]
shape = "circle"
radius = 45.0
[[term]]
kind = "conic"
radius = -100.0
conic = 0.0
[[term]]
kind = "xy_polynomial"
coefficients = { "3,0" = 2e-6, "2,1" = -2e-6, "0,2" = 2e-5 }
"""
"""R = 100 mm, with as much asymmetry as lets the pose be found."""


class Made:
    """What stands behind a measurement; every cause changes one of these."""

    def __init__(self, surface, places, machine):
        self.x, self.y = places
        jet = surface.jet(self.x, self.y)
        self.p = np.stack([self.x, self.y, jet.z], axis=1)
        self.n = unit_normal(jet, 1)
        self.t = np.linspace(-0.5, 0.5, len(self.x))
        self.machine = machine
        self.centre = self.p.mean(axis=0)
        self.n_machine = machine.rotate(self.n)


Ground = Callable[[Made], np.ndarray]
"""Deviation of the part along the normal, mm."""
Measured = Callable[[Made, np.ndarray], np.ndarray]
"""What the machine reports in place of true tip centres, mm, frame machine."""


def straight(_, tips):
    """A machine without error."""
    return tips


def flat(made):
    """A part without error."""
    return np.zeros(len(made.x))


def rho(made):
    """Unit vectors away from the axis of rotation."""
    return made.p[:, :2] / np.hypot(made.x, made.y)[:, None]


def stretched(k, ppm):
    """A machine whose axis reads too long."""

    def report(_, tips):
        out = tips.copy()
        out[:, k] = tips[:, k].mean() + (tips[:, k] - tips[:, k].mean()) * (1.0 + ppm * 1e-6)
        return out

    return report


def sheared(i, j, arcsec):
    """A machine whose axis j leans towards axis i."""

    def report(_, tips):
        out = tips.copy()
        out[:, i] += arcsec * ARCSEC * (tips[:, j] - tips[:, j].mean())
        return out

    return report


def drifting(k, um):
    """A machine that moves while it measures."""

    def report(made, tips):
        out = tips.copy()
        out[:, k] += um * 1e-3 * made.t
        return out

    return report


def lobes(made, order, um, angle_deg):
    """A shape with lobes, of the given amplitude at the furthest point."""
    w = (made.x + 1j * made.y) / np.hypot(made.x, made.y).max()
    return um * 1e-3 * (w**order * np.exp(-1j * order * np.radians(angle_deg))).real


def probe(made, um, angle_deg):
    """A probe with three lobes."""
    w = (made.n_machine[:, 0] + 1j * made.n_machine[:, 1]) ** 3
    return um * 1e-3 * (w * np.exp(-3j * np.radians(angle_deg))).real


TRUTHS: dict[str, tuple[float, Ground, Measured, float]] = {
    # name: value, the part, the machine, how much larger the stylus is than what was entered
    "wheel radius": (-30.0, lambda m: 0.030 + flat(m), straight, 0.0),
    "stylus radius": (20.0, flat, straight, 0.020),
    "thermal scale": (300.0, lambda m: 300e-6 * np.sum((m.p - m.centre) * m.n, axis=1), straight, 0.0),
    "wheel offset": (-4.0, lambda m: 0.004 * np.sum(rho(m) * m.n[:, :2], axis=1), straight, 0.0),
    "wheel wear over a spiral": (
        4.0,
        lambda m: 0.004 * (np.hypot(m.x, m.y) / np.hypot(m.x, m.y).max()) ** 2,
        straight,
        0.0,
    ),
    "scale of x": (60.0, lambda m: 60e-6 * (m.p - m.centre)[:, 0] * m.n[:, 0], straight, 0.0),
    "scale of y": (-90.0, lambda m: -90e-6 * (m.p - m.centre)[:, 1] * m.n[:, 1], straight, 0.0),
    "scale of z": (150.0, lambda m: 150e-6 * (m.p - m.centre)[:, 2] * m.n[:, 2], straight, 0.0),
    "squareness of x and y": (40.0, lambda m: 40.0 * ARCSEC * m.y * m.n[:, 0], straight, 0.0),
    "squareness of x and z": (60.0, lambda m: 60.0 * ARCSEC * m.p[:, 2] * m.n[:, 0], straight, 0.0),
    "squareness of y and z": (-100.0, lambda m: -100.0 * ARCSEC * m.p[:, 2] * m.n[:, 1], straight, 0.0),
    "measuring machine's scale of x": (60.0, flat, stretched(0, 60.0), 0.0),
    "measuring machine's scale of y": (150.0, flat, stretched(1, 150.0), 0.0),
    "measuring machine's scale of z": (300.0, flat, stretched(2, 300.0), 0.0),
    "measuring machine's squareness of x and y": (40.0, flat, sheared(0, 1, 40.0), 0.0),
    "measuring machine's squareness of x and z": (60.0, flat, sheared(0, 2, 60.0), 0.0),
    "measuring machine's squareness of y and z": (60.0, flat, sheared(1, 2, 60.0), 0.0),
    "clamping, two lobes": (np.nan, lambda m: lobes(m, 2, 2.0, 31.0), straight, 0.0),
    "clamping, three lobes": (np.nan, lambda m: lobes(m, 3, 2.0, 17.0), straight, 0.0),
    "probe lobing, three lobes": (np.nan, lambda m: probe(m, 6.0, 50.0), straight, 0.0),
    "drift along x": (8.0, flat, drifting(0, 8.0), 0.0),
    "drift along y": (8.0, flat, drifting(1, 8.0), 0.0),
    "drift along z": (8.0, flat, drifting(2, 8.0), 0.0),
    "drift of the probe": (6.0, lambda m: 0.006 * m.t, straight, 0.0),
}


def measured(surface, places, seed, ground=flat, report=straight, stylus_mm=0.0, pose=None):
    """Make tip centres, and align them as a user would."""
    machine = machine_from_part() if pose is None else pose
    made = Made(surface, places, machine)
    noise = NOISE_MM * np.random.default_rng(seed).standard_normal(len(made.x))
    height = RADIUS_MM + stylus_mm + ground(made) + noise
    tips = report(made, machine.apply(made.p + height[:, None] * made.n))
    nominal = Nominal(surface, 1, RADIUS_MM, Pose.identity("surface", "part"), DIGEST)
    points = PointSet.of(tips, kind=PointKind.TIP_CENTRE)
    return align(points, nominal), made


def looks_like(cause, name):
    """Whether a cause is the one asked for, alone or among those that the data cannot tell from it."""
    return name == cause.name or any(name == m.name for m in cause.alternatives)


def value_of(cause, name):
    """Value and uncertainty of a cause, whatever name stands first."""
    for member in (cause, *cause.alternatives):
        if member.name == name:
            return member.value, member.u
    return np.nan, np.nan


def each_alone(seeds):
    """Every signature alone: is it named first, and does its interval hold the truth?"""
    rows, all_z = [], []
    for name, (value, ground, report, stylus) in TRUTHS.items():
        first = among = 0
        z, others = [], 0
        for seed in range(seeds):
            places = scan_lines(WINDOW.bounds, lines=31, per_line=81, seed=seed)
            alignment, made = measured(WINDOW, places, seed, ground, report, stylus)
            found = root_causes(alignment)
            truth = value if np.isfinite(value) else float(np.ptp(ground(made))) * 1e3
            if found.causes:
                first += found.causes[0].name == name
                among += looks_like(found.causes[0], name)
                got, u = value_of(found.causes[0], name)
                z.append((got - truth) / u)
                others += len(found.causes) > 1
        z = np.array(z)
        all_z.append(z)
        held = 100.0 * np.mean(np.abs(z) <= 1.96) if len(z) else 0.0
        told = f"first {first}/{seeds}, in the first combination {among}/{seeds}"
        rows.append(
            Row(name, "first; 93-97 %", f"{told}; held {held:.0f} %; bias {np.mean(z):+.2f} u; more {others}")
        )
    z = np.concatenate(all_z)
    rows.append(Row("all together", "93-97 %", f"held {100.0 * np.mean(np.abs(z) <= 1.96):.1f} %"))
    return rows


def near_sphere(seeds):
    """A cap of R = 100 mm: the look-alikes are one combination."""
    surface = prescription_from_toml(CAP, where="the cap")
    names = ("wheel radius", "stylus radius", "thermal scale")
    rows = []
    for name, ground, stylus in (
        ("stylus radius", flat, 0.020),
        ("thermal scale", lambda m: 200e-6 * np.sum((m.p - m.centre) * m.n, axis=1), 0.0),
    ):
        together, words, z = 0, "", []
        for seed in range(seeds):
            x, y = random_places(Quadric(half_x=44.0, half_y=44.0, round=True), 2500, seed)
            alignment, _ = measured(surface, (x, y), seed, ground, straight, stylus)
            found = root_causes(alignment)
            if len(found.causes) == 1 and all(looks_like(found.causes[0], n) for n in names):
                together += 1
                got, u = value_of(found.causes[0], name)
                z.append((got - (20.0 if stylus else 200.0)) / u)
            words = found.words
        held = 100.0 * np.mean(np.abs(z) <= 1.96)
        rows.append(Row(f"cap R = 100, {name}", "one combination", f"{together}/{seeds}; held {held:.0f} %"))
        rows.append(Row("  words", "-", words))
    return rows


def together(seeds):
    """Several causes at once, on a form error that is small beside them and on one that is not."""
    return [*several(0.05, seeds), *several(0.4, seeds)]


def several(form_um, seeds):
    """Three causes at once."""
    names = {"scale of x": 300.0, "wheel offset": -12.0, "clamping, three lobes": np.nan}
    z, found_all, extra = [], 0, 0
    for seed in range(seeds):
        form = random_form(WINDOW, 25.0, form_um * 1e-3, seed)

        def ground(m, form=form):
            part = 300e-6 * (m.p - m.centre)[:, 0] * m.n[:, 0]
            part = part + 0.012 * np.sum(rho(m) * m.n[:, :2], axis=1) + lobes(m, 3, 8.0, 17.0)
            return part + form(m.x, m.y)

        places = scan_lines(WINDOW.bounds, lines=31, per_line=81, seed=seed)
        found = root_causes(measured(WINDOW, places, seed, ground)[0])
        hits = {name: c for name in names for c in found.causes if looks_like(c, name)}
        found_all += len(hits) == len(names)
        extra += len(found.causes) > len(names)
        for name, cause in hits.items():
            if np.isfinite(names[name]):
                got, u = value_of(cause, name)
                z.append((got - names[name]) / u)
    held = 100.0 * np.mean(np.abs(z) <= 1.96)
    return [
        Row(
            f"scale, offset and lobes, {form_um} um of form",
            "all three",
            f"{found_all}/{seeds}; held {held:.0f} %; invented {extra}",
        ),
        Row("  words of the last", "-", found.words),
    ]


def random_form(surface, length_mm, rms_mm, seed, *, rough=False):
    """A random freeform: 400 waves, smooth, or with a tail of short ones."""
    rng = np.random.default_rng([seed, int(length_mm)])
    k = rng.standard_normal((400, 2)) / length_mm
    if rough:
        k = k / np.sqrt(rng.chisquare(3, size=(400, 1)) / 3.0)
    phase = rng.uniform(0.0, 2.0 * np.pi, (400, 1))
    size = rms_mm * np.sqrt(2.0 / 400.0)

    def at(x, y):
        return size * np.cos(k[:, :1] * x + k[:, 1:] * y + phase).sum(axis=0)

    return at


def nothing_there(seeds):
    """Parts whose error has no single cause."""
    rows = []
    fields = {"noise alone": lambda _: lambda x, _y: 0.0 * x}
    for length in (10.0, 20.0, 40.0, 80.0):
        fields[f"smooth form, waves of {length:.0f} mm"] = lambda s, v=length: random_form(WINDOW, v, 5e-3, s)
        fields[f"rough form, waves of {length:.0f} mm"] = lambda s, v=length: random_form(
            WINDOW, v, 5e-3, s, rough=True
        )
    fields["form of the demo (27 um; astigmatism and trefoil in it)"] = lambda s: (
        form_error(WINDOW, seed=s).at
    )
    for name, make in fields.items():
        named, shown, which = 0, 0, ""
        for seed in range(seeds):
            places = random_places(Quadric(half_x=50.0, half_y=30.0), 2500, seed)
            found = root_causes(aligned(WINDOW, make(seed), places, noise_mm=NOISE_MM, seed=seed))
            named += bool(found.causes)
            shown += bool(found.relevant)
            which = found.causes[0].name if found.causes else which
        rows.append(Row(name, "none", f"{named}/{seeds} named, {shown} of them shown {which}"))
    return rows


def beside_form(seeds):
    """One cause that matters, beside form error: intervals with correlated errors."""
    rows = []
    for length, rms_um in ((15.0, 0.5), (30.0, 0.5), (60.0, 0.5)):
        z, found_it = [], 0
        for seed in range(seeds):
            form = random_form(WINDOW, length, rms_um * 1e-3, seed)

            def error(x, y, form=form):
                n = unit_normal(WINDOW.jet(x, y), 1)
                return 0.020 * (x * n[:, 0] + y * n[:, 1]) / np.hypot(x, y) + form(x, y)

            places = random_places(Quadric(half_x=50.0, half_y=30.0), 2500, seed)
            found = root_causes(aligned(WINDOW, error, places, noise_mm=NOISE_MM, seed=seed))
            hits = [c for c in found.causes if looks_like(c, "wheel offset")]
            found_it += bool(hits)
            if hits:
                got, u = value_of(hits[0], "wheel offset")
                z.append((got + 20.0) / u)
        z = np.array(z)
        rows.append(
            Row(
                f"wheel offset beside {rms_um} um of form, {length:.0f} mm",
                "93-97 %",
                f"found {found_it}/{seeds}; held {100.0 * np.mean(np.abs(z) <= 1.96):.0f} %; "
                f"rms {np.sqrt(np.mean(z**2)):.2f} u",
            )
        )
    return rows


def large():
    """Time on a large cloud."""
    places = random_places(Quadric(half_x=50.0, half_y=30.0), 1_200_000)
    alignment = aligned(WINDOW, random_form(WINDOW, 30.0, 5e-3, 1), places, noise_mm=NOISE_MM)
    times = []
    for _ in range(5):
        with Stopwatch() as watch:
            root_causes(replace(alignment))
        times.append((watch.wall, watch.cpu))
    wall, cpu = min(times)
    return [Row("time, 1.2e6 points", "<= 0.3 s", f"{wall:.2f} s ({cpu:.2f} s of cores)")]


def main() -> None:
    """Print the tables."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    parts = sys.argv[2].split(",") if len(sys.argv) > 2 else []
    for what in (large, each_alone, near_sphere, together, beside_form, nothing_there):
        if not parts or what.__name__ in parts:
            show(f"Root causes, {what.__name__}, {seeds} seeds", what() if what is large else what(seeds))
            sys.stdout.flush()


if __name__ == "__main__":
    main()
