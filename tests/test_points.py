"""Sets of points: what steers the fit is checked, and survives the joining of files."""

from __future__ import annotations

import numpy as np
import pytest

from cmm_align.errors import MalformedInputError
from cmm_align.model import PointKind, PointSet
from cmm_align.model.points import joined


def some(count, **given):
    return PointSet.of(np.arange(3.0 * count).reshape(count, 3), **given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"sigma_mm": [1.0, 0.0]}, "sigma 0 of point 2 of 2; expected above 0"),
        ({"sigma_mm": [-1.0, 1.0]}, "sigma -1 of point 1 of 2"),
        ({"sigma_mm": [1.0, np.nan]}, "sigma nan"),
        ({"sigma_mm": [1.0, np.inf]}, "sigma inf"),
        ({"sigma_mm": [1.0]}, r"sigma of shape \(1,\); expected one for each of 2 points"),
        ({"weight": [1.0, -1e-9]}, "weight -1e-09 of point 2 of 2; expected 0 or more"),
        ({"weight": [np.nan, 1.0]}, "weight nan"),
        ({"weight": [0.0, 0.0]}, "all values of weight are 0"),
        ({"weight": [[1.0, 1.0]]}, "weight of shape"),
    ],
)
def test_what_steers_the_fit_is_checked(given, words):
    with pytest.raises(MalformedInputError, match=words):
        some(2, **given)


def test_weights_are_kept_and_cannot_be_changed():
    points = some(3, weight=[0.0, 2.0, 0.5])

    assert points.weight.tolist() == [0.0, 2.0, 0.5]
    assert not points.weight.flags.writeable


def test_one_set_is_joined_to_itself():
    points = some(2, ids=[7, 3], weight=[1.0, 2.0])

    assert joined([points]) is points


def test_sets_are_joined_in_order_with_all_they_hold():
    first = some(
        2, ids=[7, 3], sigma_mm=[1e-3, 2e-3], weight=[1.0, 0.0], source="a.csv", kind=PointKind.CONTACT
    )
    second = some(1, ids=[5], sigma_mm=[3e-3], weight=[4.0], source="b.csv", kind=PointKind.CONTACT)

    both = joined([first, second])

    np.testing.assert_array_equal(both.points_mm, np.concatenate([first.points_mm, second.points_mm]))
    assert both.ids.tolist() == [7, 3, 5]
    assert both.sigma_mm.tolist() == [1e-3, 2e-3, 3e-3]
    assert both.weight.tolist() == [1.0, 0.0, 4.0]
    assert (both.kind, both.frame, both.source) == (PointKind.CONTACT, "machine", "a.csv, b.csv")


@pytest.mark.parametrize("ids", [[None, None], [[4, 5, 6], [6, 7]]])
def test_ids_that_two_sets_share_are_numbered_anew(ids):
    both = joined([some(3, ids=ids[0]), some(2, ids=ids[1])])

    assert both.ids.tolist() == [0, 1, 2, 3, 4]


def test_an_id_that_one_set_holds_twice_is_kept():
    assert joined([some(2, ids=[4, 4]), some(1, ids=[5])]).ids.tolist() == [4, 4, 5]


@pytest.mark.parametrize("name", ["sigma_mm", "weight"])
def test_a_column_that_one_file_lacks_is_not_dropped_silently(name):
    with_it, without = some(2, source="a.csv", **{name: [1.0, 1.0]}), some(2, source="b.csv")

    assert getattr(joined([without, without]), name) is None
    with pytest.raises(
        MalformedInputError, match=r"b\.csv: no column (sigma|weight); expected one, as a\.csv has"
    ):
        joined([with_it, without])
