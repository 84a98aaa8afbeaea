import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay

from cmm_align.surfaces.triangulation import delaunay_triangles


def as_set(triangles):
    return set(map(tuple, np.sort(triangles, axis=1).tolist()))


@pytest.mark.parametrize("kind", ["random", "thin", "on a grid", "twice the same"])
def test_the_triangulation_is_delaunay(kind):
    rng = np.random.default_rng(5)
    xy = {
        "random": rng.uniform(-50, 50, (3000, 2)),
        "thin": rng.uniform(0, 1, (500, 2)) * [100.0, 0.01],
        "on a grid": np.stack(np.meshgrid(np.arange(20.0), np.arange(15.0)), axis=-1).reshape(-1, 2),
        "twice the same": np.repeat(rng.uniform(0, 1, (200, 2)), 2, axis=0),
    }[kind]

    found = delaunay_triangles(xy[:, 0], xy[:, 1])

    a, b, c = (xy[found[:, k]] for k in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert (area > 0).all()
    assert area.sum() == pytest.approx(ConvexHull(xy).volume, rel=1e-9)
    if kind == "random":  # the triangulation is unique where no four places lie on a circle
        assert as_set(found) == as_set(Delaunay(xy).simplices)
