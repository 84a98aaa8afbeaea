import closed_forms as cf
import numpy as np
import pytest

from cmm_align.errors import UsageError, WrongStageError
from cmm_align.model import PointKind, PointSet
from cmm_align.stages.estimated_contacts import METHODS, estimated_contacts, estimated_normals
from cmm_align.surfaces.geometry import unit_normal


def torus_cloud(noise_mm=0.0, step=1.0):
    torus = cf.Torus()
    x, y = (a.ravel() for a in np.meshgrid(np.arange(-15, 15.1, step), np.arange(-15, 15.1, step)))
    rng = np.random.default_rng(1)
    x, y = x + rng.uniform(-0.2, 0.2, x.size), y + rng.uniform(-0.2, 0.2, y.size)
    jet = torus.jet(x, y)
    normal = unit_normal(jet, 1)
    points = np.stack([x, y, jet.z], axis=1) + rng.normal(0.0, noise_mm, x.size)[:, None] * normal
    inner = (np.abs(x) < 12) & (np.abs(y) < 12)
    return points, normal, inner


def degrees_between(a, b):
    return np.degrees(np.arcsin(np.clip(np.linalg.norm(np.cross(a, b), axis=1), 0, 1)))


@pytest.mark.parametrize(
    ("method", "noise_mm", "worst_deg"),
    [
        # A quadratic over a reach of 3 mm misses the third derivative: z''' h^2 / 6 ~ 3e-5 * 9 / 6 rad.
        ("local-quadratic", 0.0, 0.01),
        ("mls", 0.0, 0.01),
        ("bspline", 0.0, 1e-4),
        # Noise s over 24 points of rms reach 2 mm: s / (2 sqrt 24) = 1e-4 rad = 0.006 degrees, 4 sigma.
        ("local-quadratic", 1e-3, 0.05),
        ("mls", 1e-3, 0.05),
        ("bspline", 1e-3, 0.1),
    ],
)
def test_the_angular_error_of_each_estimator(method, noise_mm, worst_deg):
    points, normal, inner = torus_cloud(noise_mm)

    found = estimated_normals(points, method)

    assert degrees_between(found, normal)[inner].max() < worst_deg
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("side", ["+z", "-z"])
def test_contacts_lie_on_the_part(method, side):
    points, normal, inner = torus_cloud()
    sign = 1.0 if side == "+z" else -1.0
    tips = PointSet.of(points + sign * 1.5 * normal, kind=PointKind.TIP_CENTRE)

    contacts, _ = estimated_contacts(tips, 1.5, method, side)

    assert contacts.kind is PointKind.CONTACT
    # r (1 - cos) of 0.01 degrees along the normal, r sin across.
    assert np.abs(np.sum((contacts.points_mm - points) * normal, axis=1))[inner].max() < 1e-6
    assert np.linalg.norm(contacts.points_mm - points, axis=1)[inner].max() < 4e-4


def test_contact_points_are_not_compensated_twice():
    points, _, _ = torus_cloud()

    with pytest.raises(WrongStageError):
        estimated_contacts(PointSet.of(points, kind=PointKind.CONTACT), 1.5, "mls")
    with pytest.raises(UsageError):
        estimated_contacts(PointSet.of(points), 1.5, "guess")
