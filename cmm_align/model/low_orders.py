"""What a form error consists of: kinds of low order, their terms, and what is left without them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Term:
    """One orthonormal shape."""

    name: str
    coefficient_um: float
    """RMS of this shape's share of the map, with the sign of the polynomial, um."""
    u_um: float
    """Standard uncertainty."""


@dataclass(frozen=True, slots=True)
class Kind:
    """What one kind of low order contributes to the map, beyond the rigid motion and the kinds before it.

    Attributes
    ----------
    name : str
        power, astigmatism, coma, trefoil or spherical.
    amplitude_um, u_um : float
        PV of its share over the known nodes, and standard uncertainty, um. Power and spherical carry a sign:
        + = the border stands higher than the middle, or, of spherical, than the zone between.
    angle_deg, u_angle_deg : float or None
        Direction in which the border stands highest, counted in frame `surface` from +x towards +y: the axis
        of astigmatism, 0 to 180; the direction of coma, 0 to 360; of one lobe of trefoil, 0 to 120. None
        where there is no direction. The uncertainty is at most that of an angle that is not known at all.
    rms_um : float
        RMS of its share, um.
    share : float
        Of the mean square beyond the rigid motion, 0 to 1.
    """

    name: str
    amplitude_um: float
    u_um: float
    angle_deg: float | None
    u_angle_deg: float | None
    rms_um: float
    share: float


@dataclass(frozen=True, slots=True)
class Rung:
    """What is left of the map without all that this rung and those before it remove, um."""

    removed: str
    pv_um: float
    rms_um: float
    pvr_um: float
    """PV of its share in the 36 terms, plus three times the RMS of what they leave."""


@dataclass(frozen=True, slots=True)
class LowOrders:
    """The low orders of a map, over its known nodes.

    Attributes
    ----------
    basis : str
        Which polynomials, made orthonormal on the nodes.
    shape : str
        What the known nodes look like: round, annular, rectangular or irregular.
    normalisation : str
        The circle or rectangle that the polynomials are counted over.
    rigid : str
        Which motions the ladder removes, and what the fit had not.
    n_nodes : int
    terms : tuple of Term
    kinds : tuple of Kind
        As many as the nodes carry.
    rungs : tuple of Rung
    words : str
        What the form error mostly is.
    """

    basis: str
    shape: str
    normalisation: str
    rigid: str
    n_nodes: int
    terms: tuple[Term, ...]
    kinds: tuple[Kind, ...]
    rungs: tuple[Rung, ...]
    words: str
