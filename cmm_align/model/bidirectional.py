"""The bidirectional check: what both directions of measuring said, side by side."""

from __future__ import annotations

from dataclasses import dataclass

from cmm_align.model.statistics import Statistics


@dataclass(frozen=True, slots=True)
class Bidirectional:
    """The nominal measured against the triangulated cloud, beside the cloud measured against the nominal.

    Attributes
    ----------
    forward : Statistics
        Deviations of the measured points that were triangulated, from the nominal.
    backward : Statistics
        Deviations at nodes of the nominal from the facets of the cloud; positive = excess material too.
    interpolated : Statistics
        The forward deviations at the same nodes, linear in each facet. White noise of sigma is left with
        ``sigma / sqrt(2)`` there, and in `backward` as well: facets average.
    n_measured : int
        Points that steered the alignment.
    spacing_mm : float
        Of the points that were triangulated, ``sqrt(area / n)``; wider than the cloud's if it was sampled.
    covered : float
        Share of the nodes over the measured region that lie under a facet: the rest are gaps and slivers.
    difference_rms_mm, difference_mean_mm : float
        Of backward minus interpolated, at the nodes.
    facets_rms_mm, facets_max_mm : float
        What the facets of the cloud must differ by, from the curvature of the nominal: ``h^2 k / 4`` at most
        for a square net of step h.
    rest_rms_mm : float
        What of the difference neither this nor the tilt of the facets explains.
    reverse_translation_mm : tuple of float
        Motion that lays the nominal on the cloud best, at the centroid of the nodes, frame `part`.
    reverse_rotation_rad : tuple of float
        Rotation vector of the same, frame `part`.
    reverse_edge_mm : float
        The most that it moves a node.
    reverse_rms_mm : float
        What it changes in the deviations, RMS.
    expected_rms_mm : float
        What it must change in them at the best pose: nodes count the same deviations in another proportion
        than the points do, and facets pull at them.
    unexplained_edge_mm, unexplained_rms_mm : float
        Reverse motion less the expected one: the most that it moves a node, and what it changes in the
        deviations.
    allowed_rms_mm : float
        The most that `unexplained_rms_mm` may be at the best pose: what is not linear in the above.
    agree : bool
        Whether the facets explain the difference: no more is left than they account for.
    at_rest : bool
        Whether the reverse motion is the expected one, as near as allowed.
    consistent : bool
        Both.
    words : str
        All this in a sentence.
    """

    forward: Statistics
    backward: Statistics
    interpolated: Statistics
    n_measured: int
    spacing_mm: float
    covered: float
    difference_rms_mm: float
    difference_mean_mm: float
    facets_rms_mm: float
    facets_max_mm: float
    rest_rms_mm: float
    reverse_translation_mm: tuple[float, float, float]
    reverse_rotation_rad: tuple[float, float, float]
    reverse_edge_mm: float
    reverse_rms_mm: float
    expected_rms_mm: float
    unexplained_edge_mm: float
    unexplained_rms_mm: float
    allowed_rms_mm: float
    agree: bool
    at_rest: bool
    consistent: bool
    words: str
