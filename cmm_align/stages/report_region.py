"""Which points count in numbers and map, chosen anew after the fit: the clear aperture of a part.

The fit, its pose and what is said of it stay as they are; only the points that are told change.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmm_align.errors import GeometryError
from cmm_align.model import Alignment, PointStatus, frozen_array
from cmm_align.surfaces.protocol import Array
from cmm_align.surfaces.region import Region, region_from_text


def reported_in(alignment: Alignment, region: Region) -> Alignment:
    """Return an alignment whose judged points are those that touched the nominal in a region.

    Parameters
    ----------
    alignment : Alignment
        A report region that it had is replaced.
    region : Region
        Of frame `surface`; foot points decide, and the border belongs to it.

    Raises
    ------
    GeometryError
        If no point lies in it.
    """
    touched = np.flatnonzero(
        np.isin(alignment.status, (PointStatus.USED, PointStatus.APART)) & np.isfinite(alignment.deviation_mm)
    )
    foot = _feet(alignment, touched)
    inside = touched[region.contains(foot[:, 0], foot[:, 1])]
    if not len(inside):
        raise GeometryError(
            f"none of the {len(touched)} points that touched the nominal lies in the {region.words}",
            expected="a report region that holds measured points",
            remedy=_where_they_are(foot),
        )
    judged = np.zeros(len(alignment.status), dtype=np.bool_)
    judged[inside] = True
    report = replace(alignment.report, report_region=region.words, report_region_text=region.text)
    return replace(alignment, judged=frozen_array(judged, np.bool_), report=report)


def outliers_mm(alignment: Alignment) -> Array:
    """Return the deviations of the outliers on the nominal, or in its report region, shape (k,), mm."""
    rows = np.flatnonzero((alignment.status == PointStatus.OUTLIER) & np.isfinite(alignment.deviation_mm))
    text = alignment.report.report_region_text
    if text:
        x, y, _ = _feet(alignment, rows).T
        rows = rows[region_from_text(text, alignment.nominal.surface).contains(x, y)]
    return np.asarray(alignment.deviation_mm[rows])


def _feet(alignment: Alignment, rows: NDArray[np.intp]) -> Array:
    """Return the foot points of some points, shape (k, 3), mm, frame `surface`."""
    e = alignment.deviation_mm[rows, None]
    return alignment.nominal.surface_from_part.apply(
        alignment.contact_part_mm[rows] - e * alignment.normals[rows]
    )


def _where_they_are(foot_mm: Array) -> str:
    """Say over which rectangle the points lie."""
    if not len(foot_mm):
        return "look at the alignment with cmm-align info"
    (x_low, y_low, _), (x_high, y_high, _) = foot_mm.min(axis=0), foot_mm.max(axis=0)
    return f"they lie from x {x_low:.4g} to {x_high:.4g} and from y {y_low:.4g} to {y_high:.4g} mm"
