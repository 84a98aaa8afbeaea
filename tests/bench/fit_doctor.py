"""What the fit doctor makes of good data and of every usual mistake: ``python tests/bench/fit_doctor.py``.

Good data must never give a clear finding. A mistake is *detected* by a clear finding that names it,
*suspected*, said to be *untold*, or *missed*; *refused* if the alignment itself says no.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import closed_forms as cf

import cmm_align as ca
from cmm_align.errors import CmmAlignError
from cmm_align.model import Nominal, PointKind, PointSet
from cmm_align.numerics.fit_steps import FitSettings
from cmm_align.numerics.linearisation import Placement, evaluate
from cmm_align.numerics.rigid_fit import fit
from cmm_align.pose import Pose, rotation_from_vector
from cmm_align.stages.fit_doctor import Evidence, diagnose, explain_failure
from cmm_align.stages.offset import surface_digest
from cmm_align.stages.plausibility import check_measured
from cmm_align.surfaces.distance import facet_measure, light_net, smooth_measure
from cmm_align.surfaces.geometry import unit_normal
from cmm_align.surfaces.prescription import prescription_from_toml
from cmm_align.virtual.cmm import machine_from_part, scan_lines
from cmm_align.virtual.form_error import form_error
from cmm_align.virtual.window import PRESCRIPTION, window

MIRROR = Path(__file__).resolve().parents[2] / "sample_data" / "mirror_m2"
HOME = Pose.identity("machine", "part")
DEMO = machine_from_part()
START = Pose.identity("part", "machine")
WEAK = (
    PRESCRIPTION.replace("-86.0", "-400.0")
    .replace("-0.55", "0.0")
    .replace("102.0", "100.0")
    .replace("62.0", "60.0")
)
WEAK = (
    WEAK[: WEAK.index("coefficients")]
    + 'coefficients = { "2,0" = 0.15, "3,0" = 0.1, "2,1" = 0.08, "0,3" = -0.06 }'
)


@dataclass(frozen=True)
class Part:
    """Contact points, normals and deviations of a part, and its surface."""

    name: str
    surface: object
    contacts_mm: np.ndarray
    normals: np.ndarray
    radius_mm: float
    side: int = 1

    def at(self, offset_mm):
        """Return points that lie `offset_mm` above the part."""
        return self.contacts_mm + offset_mm * self.normals


def nominal(surface, radius, side=1) -> Nominal:
    flat = Pose.identity("surface", "part")
    return Nominal(surface, side, radius, flat, surface_digest(surface, side, flat))


def part(name, surface, deviation, *, noise=3e-4, radius=1.5, keep=None, seed=3) -> Part:
    x, y = scan_lines(surface.bounds, lines=15, per_line=40)
    if keep is not None:
        x, y = x[keep(x, y)], y[keep(x, y)]
    jet = surface.jet(x, y)
    normals = unit_normal(jet, 1)
    height = deviation(x, y) + noise * np.random.default_rng(seed).standard_normal(len(x))
    return Part(name, surface, np.column_stack([x, y, jet.z]) + height[:, None] * normals, normals, radius)


def form(surface, pv=0.027):
    return form_error(surface, pv_mm=pv).at


def power(surface, pv=0.027):
    """Deviation that looks like a change of curvature, without what a rigid motion takes away."""
    b = surface.bounds

    def shape(x, y):
        return (2 * x / (b.x_max - b.x_min)) ** 2 + (2 * y / (b.y_max - b.y_min)) ** 2

    def rows(x, y):
        jet = surface.jet(x, y)
        n = unit_normal(jet, 1)
        return np.hstack([np.cross(np.column_stack([x, y, jet.z]) / b.diagonal_mm, n), n])

    net = [a.ravel() for a in np.meshgrid(np.linspace(*b[:2], 61), np.linspace(*b[2:], 41))]
    rigid = np.linalg.lstsq(rows(*net), shape(*net), rcond=None)[0]
    rest = shape(*net) - rows(*net) @ rigid
    return lambda x, y: pv / np.ptp(rest) * (shape(x, y) - rows(x, y) @ rigid)


def mirror() -> Part:
    """Return the real mirror; its contacts are those of the fit in its own frame."""
    surface = prescription_from_toml((MIRROR / "nominal.toml").read_text(), "mirror")
    tips = np.loadtxt(MIRROR / "points.csv", delimiter=",", skiprows=2)
    found = ca.align(PointSet.of(tips, kind=PointKind.TIP_CENTRE), nominal(surface, 19.05))
    normals = found.part_from_machine.inverse().rotate(found.normals)
    return Part("mirror", surface, tips - 19.05 * normals, normals, 19.05)


def scaled(surface, by):
    """Return a window of another size: only for the scaling, so the prescription is wrapped."""

    class Scaled:
        kind = surface.kind
        toml_text = f"{by} {surface.toml_text}"
        bounds = type(surface.bounds)(*(by * v for v in surface.bounds))

        def contains(self, x, y):
            return surface.contains(x / by, y / by)

        def jet(self, x, y):
            j = surface.jet(x / by, y / by)
            return j._replace(z=by * j.z, zxx=j.zxx / by, zxy=j.zxy / by, zyy=j.zyy / by)

    return Scaled()


def ordinary_fit(points, nom, *, contact):
    """Return ``part_from_machine`` of a plain fit of few points, as the first iterations of align find it."""
    few = points[np.linspace(0, len(points) - 1, min(len(points), 600)).round().astype(int)]
    centre = few.mean(axis=0)
    radius = 0.0 if contact else nom.tip_radius_mm
    length = float(np.sqrt(np.mean(np.sum((few - centre) ** 2, axis=1))))
    settings = FitSettings(nom.surface.bounds.diagonal_mm, length, 1e-7, 50, 0.5, 1e-8)
    net = light_net(nom.surface, nom.side, radius)
    everywhere = np.ones(len(few), dtype=bool)
    begun = Placement(np.eye(3), centre)
    coarse = facet_measure(net, nom.side)
    if np.mean(evaluate(coarse, few - centre, begun, length, used=everywhere).inside) < 0.25:
        begun = Placement(np.eye(3), net.points_mm.mean(axis=0))
    way = fit(
        coarse,
        few - centre,
        begun,
        replace(settings, tolerance=1e-3, min_observability=1e-5),
        used=everywhere,
    )
    near = fit(smooth_measure(nom.surface, nom.side, radius), few - centre, way.placement, settings)
    rms = float(np.sqrt(near.evaluation.cost_mm2))
    if np.mean(near.evaluation.inside) < 0.5 or rms > 0.01 * settings.size_mm:
        return None
    place = near.placement
    return Pose(place.rotation, place.position_mm - place.rotation @ centre, "part", "machine")


def look(points, kind, nom, pose):
    """Align and ask the doctor; return findings, or the refusal with its explanation."""
    measured = PointSet.of(pose.apply(points), kind=kind)
    contact = kind is PointKind.CONTACT
    try:
        check_measured(measured, nom)
        found = ordinary_fit(measured.points_mm, nom, contact=contact)
        refusal = "no fit" if found is None else ""
    except CmmAlignError as error:
        refusal = type(error).__name__
    begin = perf_counter()
    if refusal:
        why = explain_failure(measured.points_mm, nom, contact=contact)
        return f"refused: {refusal}", why, perf_counter() - begin
    seen = diagnose(measured.points_mm, nom, found, START, contact=contact)
    return seen, seen.findings, perf_counter() - begin


def good_battery():
    """Yield name, part, nominal and pose of data without a mistake."""
    w = window()
    weak = prescription_from_toml(WEAK, "weak")
    for tag, surface in (("window", w), ("weak", weak)):
        for shape_name, deviation in (
            ("form 27", form(surface)),
            ("form 300", form(surface, 0.3)),
            ("power 27", power(surface)),
            ("power -27", power(surface, -0.027)),
            ("none", lambda x, y: 0.0 * x),
        ):
            for noise in (3e-4, 3e-3):
                yield part(f"{tag} {shape_name} noise {1e3 * noise:g}", surface, deviation, noise=noise)
        yield part(f"{tag} half x", surface, form(surface), keep=lambda x, y: x > 0)
        yield part(f"{tag} half y", surface, form(surface), keep=lambda x, y: y < 0)
        yield part(f"{tag} quarter", surface, form(surface), keep=lambda x, y: (x > 0) & (y < 0))
        yield part(f"{tag} small ball", surface, form(surface), radius=0.15)
        yield part(f"{tag} large ball", surface, form(surface), radius=6.0)
    for by in (1e-3, 1e3):
        small = scaled(w, by)
        yield part(f"window x {by:g}", small, form(small, 0.027 * by), noise=3e-4 * by, radius=1.5 * by)
    for surface in (
        cf.Plane(),
        cf.Sphere(radius_mm=-50.0),
        cf.Sphere(radius_mm=60.0),
        cf.Cylinder(),
        cf.Paraboloid(),
    ):
        tag = f"{type(surface).__name__} {getattr(surface, 'radius_mm', 0.0):g}"
        yield part(tag, surface, lambda x, y: 0.0 * x)
        yield part(f"{tag} form", surface, form(surface, 0.01))
    yield mirror()


def poses(p: Part):
    yield "own frame", HOME
    yield (
        "demo pose",
        replace(DEMO, translation_mm=DEMO.translation_mm * p.surface.bounds.diagonal_mm / 119.0),
    )
    rng = np.random.default_rng(7)
    for _ in range(2):
        turn = rotation_from_vector(np.radians(rng.uniform(-12, 12, 3)))
        yield (
            "random",
            Pose(turn, rng.uniform(-0.1, 0.1, 3) * p.surface.bounds.diagonal_mm, "machine", "part"),
        )


def mistakes(p: Part):
    """Yield name, expected finding, points, kind and nominal."""
    r, s = p.radius_mm, p.surface
    tip, touch = PointKind.TIP_CENTRE, PointKind.CONTACT
    tips = p.at(r)
    up = np.array([0.0, 0.0, 1.0])
    yield "contacts given as centres", {"contact-points"}, p.at(0.0), tip, nominal(s, r)
    yield "diameter given as radius", {"diameter"}, tips, tip, nominal(s, 2 * r)
    yield "half the radius given", {"half-radius"}, tips, tip, nominal(s, r / 2)
    yield "radius in inch", {"radius-inch"}, tips, tip, nominal(s, r / 25.4)
    yield "wrong side", {"wrong-side"}, tips, tip, nominal(s, r, -1)
    yield "wrong side and diameter", {"wrong-side-diameter"}, tips, tip, nominal(s, 2 * r, -1)
    yield "taken off twice, as centres", {"wrong-side"}, p.at(-r), tip, nominal(s, r)
    yield "centres given as contacts", {"tip-centres"}, tips, touch, nominal(s, r)
    yield "half taken off", {"half-compensated"}, p.at(r / 2), touch, nominal(s, r)
    yield "taken off twice", {"compensated-twice"}, p.at(-r), touch, nominal(s, r)
    yield "taken off outwards", {"compensated-outwards"}, p.at(2 * r), touch, nominal(s, r)
    yield "taken off along Z", {"tip-centres"}, tips - r * up, touch, nominal(s, r)
    yield "along Z, as centres", {"frame-shifted", "contact-points"}, tips - r * up, tip, nominal(s, r)
    for name, flip in (("x", [-1, 1, 1]), ("y", [1, -1, 1]), ("z", [1, 1, -1])):
        yield f"{name} flipped", {"flipped-axis", "swapped-axes", "mirrored"}, tips * flip, tip, nominal(s, r)
    yield (
        "x and y swapped",
        {"swapped-axes", "flipped-axis", "mirrored"},
        tips[:, [1, 0, 2]],
        tip,
        nominal(s, r),
    )
    yield "cyclic axes", {"swapped-axes", "turned"}, tips[:, [1, 2, 0]], tip, nominal(s, r)
    for name, by in (("inch", 25.4), ("m", 1e3), ("cm", 10.0), ("um", 1e-3)):
        yield f"points in {name}", {"units"}, tips / by, tip, nominal(s, r)
    yield "ball 3 % worn", {"worn-ball", "power"}, p.at(0.97 * r), tip, nominal(s, r)


def verdict(seen, findings, expected) -> str:
    named = [f for f in findings if f.name in expected]
    if isinstance(seen, str):
        return (
            "refused, explained"
            if named
            else f"refused ({findings[0].name})"
            if findings
            else "refused, unexplained"
        )
    if any(f.evidence is Evidence.CLEAR for f in named):
        return "DETECTED"
    if any(f.evidence is Evidence.CLEAR for f in findings):
        return f"clear, as {findings[0].name}"
    if any(f.evidence is Evidence.SUSPECT for f in findings):
        return f"suspected ({next(f.name for f in findings if f.evidence is Evidence.SUSPECT)})"
    return "cannot be told" if any(f.evidence is Evidence.UNTOLD for f in findings) else "missed"


def main() -> None:
    slowest = 0.0
    count: Counter[str] = Counter()
    print("\nGood data\n")
    for p in good_battery():
        for where, pose in poses(p):
            for kind, points in ((PointKind.TIP_CENTRE, p.at(p.radius_mm)), (PointKind.CONTACT, p.at(0.0))):
                seen, findings, seconds = look(points, kind, nominal(p.surface, p.radius_mm), pose)
                slowest = max(slowest, seconds)
                if isinstance(seen, str):
                    count["not aligned"] += 1
                    continue
                worst = findings[0].evidence.value if findings else "nothing said"
                count[worst] += 1
                if worst == "clear" or (worst == "suspect" and where == "own frame"):
                    print(f"  {worst}: {p.name}, {where}, {kind}: {findings[0].words}")
    print("\n ", dict(count))
    w, weak = window(), prescription_from_toml(WEAK, "weak")
    for p in (part("steep window", w, form(w)), part("weak part", weak, form(weak)), mirror()):
        print(f"\nMistakes on the {p.name}, radius {p.radius_mm:g} mm\n")
        for name, expected, points, kind, nom in mistakes(p):
            cells = []
            for _, pose in list(poses(p))[:2]:
                seen, findings, seconds = look(points, kind, nom, pose)
                slowest = max(slowest, seconds)
                cells.append(verdict(seen, findings, expected))
                if "-v" in sys.argv:
                    for f in findings:
                        print("     ", f.evidence.value, f.name, "|", f.words)
            print(f"  {name:<28} own frame: {cells[0]:<32} elsewhere: {cells[1]}")
    print(f"\n  slowest look: {slowest:.2f} s")


if __name__ == "__main__":
    main()
