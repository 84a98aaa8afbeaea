"""Small tables that say something of single points: limits, weights, datum points."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import MalformedInputError
from cmm_align.formats.named_table import ids_of, lengths_mm, names_of, numbers_of, read_table
from cmm_align.model import IntArray, frozen_array
from cmm_align.model.point_tables import Fiducials, PointLimits, PointWeights

_AXES: Final = ("x", "y", "z")
_FIRST: Final = 5


def read_limits(path: Path | str, units: str | None = None) -> PointLimits:
    """Return limits of the deviations of single points.

    Parameters
    ----------
    path : path
        Columns ``id, lower_um, upper_um``, in any unit. An empty field, nan or inf is no limit on that side.
    units : str, optional
        Unit of columns whose name states none.

    Raises
    ------
    MissingFileError
        If it cannot be read.
    MalformedInputError
        With file, line and column: a column is missing, an id is there twice, lower is above upper, or there
        is no limit in it at all.
    UnitsError
        If a column has no unit, or one that is not known.
    """
    table = read_table(path, ("id", "lower", "upper"))
    ids = ids_of(table)
    lower = lengths_mm(table, "lower", units, without=-math.inf)
    upper = lengths_mm(table, "upper", units, without=math.inf)
    crossed = lower > upper
    if crossed.any():
        row = int(np.argmax(crossed))
        raise MalformedInputError(
            f"the lower limit of point {ids[row]} is above the upper one",
            where=table.rows[row].place(table.columns["lower"]),
            expected="lower <= upper",
        )
    if not (np.isfinite(lower) | np.isfinite(upper)).any():
        raise MalformedInputError("there is no limit in it", where=table.where, expected="numbers")
    return PointLimits(ids, frozen_array(lower), frozen_array(upper))


def read_weights(path: Path | str) -> PointWeights:
    """Return how much single points count in the fit.

    Parameters
    ----------
    path : path
        Columns ``id, weight``; a weight has no unit.

    Raises
    ------
    MissingFileError
        If it cannot be read.
    MalformedInputError
        With file, line and column: a column is missing, an id is there twice, a weight is no number or below
        zero, or all are zero.
    """
    table = read_table(path, ("id", "weight"))
    ids = ids_of(table)
    column = table.columns["weight"]
    weight = numbers_of(table, "weight")
    if (weight < 0.0).any():
        row = int(np.argmax(weight < 0.0))
        raise MalformedInputError(
            f"weight {weight[row]:.12g} of point {ids[row]}",
            where=table.rows[row].place(column),
            expected="0 or more",
        )
    if not weight.any():
        raise MalformedInputError(
            "all weights are 0", where=table.rows[0].place(column), expected="some above 0"
        )
    return PointWeights(ids, frozen_array(weight))


def read_fiducials(path: Path | str, units: str | None = None) -> Fiducials:
    """Return datum points.

    Parameters
    ----------
    path : path
        Columns ``name, measured_x_mm, measured_y_mm, measured_z_mm, nominal_x_mm`` ... in any unit, and
        ``sigma_mm`` or ``sigma_x_mm, sigma_y_mm, sigma_z_mm``: standard uncertainties along the axes of
        frame `part`. An empty one, nan or inf leaves that axis out.
    units : str, optional
        Unit of columns whose name states none.

    Raises
    ------
    MissingFileError
        If it cannot be read.
    MalformedInputError
        With file, line and column: a column is missing, a name is missing or there twice, a coordinate is no
        number, a sigma is not above zero, or none of the axes is used.
    UnitsError
        If a column has no unit, or one that is not known.
    """
    coordinates = [f"{what}_{axis}" for what in ("measured", "nominal") for axis in _AXES]
    table = read_table(path, ("name", *coordinates))
    names = names_of(table)
    of_axes = [f"sigma{axis}" for axis in _AXES]
    there = [name for name in ("sigma", *of_axes) if name in table.columns]
    if there not in (["sigma"], of_axes):
        raise MalformedInputError(
            f"columns {', '.join(there) or 'without sigma'}",
            where=table.where,
            expected="sigma_mm, or sigma_x_mm, sigma_y_mm and sigma_z_mm",
        )
    sigma = np.stack([lengths_mm(table, name, units, without=math.inf) for name in (there * 3)[:3]], axis=1)
    if (sigma <= 0.0).any():
        row, axis = (int(k) for k in np.argwhere(sigma <= 0.0)[0])
        raise MalformedInputError(
            f"sigma {sigma[row, axis]:.12g} mm of {names[row]!r}",
            where=table.rows[row].place(table.columns[(there * 3)[axis]]),
            expected="above 0",
            remedy="lock the motion instead if the datum is to hold exactly",
        )
    if not np.isfinite(sigma).any():
        raise MalformedInputError("no axis of a datum point is used", where=table.where, expected="a sigma")
    measured, nominal = (
        np.stack([lengths_mm(table, f"{what}{axis}", units) for axis in _AXES], axis=1)
        for what in ("measured", "nominal")
    )
    return Fiducials(names, frozen_array(measured), frozen_array(nominal), frozen_array(sigma))


def matched(ids: IntArray, table_ids: IntArray, where: str) -> NDArray[np.intp]:
    """Return the row of a table that belongs to each point.

    Parameters
    ----------
    ids : ndarray of int64, shape (N,)
        Of the points; several points may have one id, and rows of points that are not there are passed over.
    table_ids : ndarray of int64, shape (n,)
        Of the rows, each once.
    where : str
        Name of the table, for messages.

    Returns
    -------
    ndarray of intp, shape (N,)
        ``table_ids[rows] == ids``.

    Raises
    ------
    MalformedInputError
        If points have no row; with how many, the first of them, and the rows that belong to no point.
    """
    order = np.argsort(table_ids, kind="stable")
    at = np.minimum(np.searchsorted(table_ids, ids, sorter=order), len(order) - 1)
    rows: NDArray[np.intp] = order[at]
    missing = np.unique(ids[table_ids[rows] != ids])
    if len(missing):
        unknown = np.setdiff1d(table_ids, ids)
        others = f"; of its {len(table_ids)} ids {_some(unknown)} belong to no point" if len(unknown) else ""
        raise MalformedInputError(
            f"no row for {_some(missing)} of {len(np.unique(ids))} ids{others}",
            where=where,
            expected="a row for each id of the points",
            remedy="give the table that was made for these points",
        )
    return rows


def _some(ids: IntArray) -> str:
    """Return how many ids these are, and the first of them."""
    listed = ", ".join(str(number) for number in ids[:_FIRST])
    return f"{len(ids)} ({listed}{' ...' if len(ids) > _FIRST else ''})"
