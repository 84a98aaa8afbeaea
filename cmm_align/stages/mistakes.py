"""At which distance from the nominal points truly lie after each of the usual mistakes with the tip radius.

===================  =======  =======================================
said                 h        what happened
===================  =======  =======================================
tip centres, r       0        contact points
tip centres, r       r/2      the diameter was given as the radius
tip centres, r       2r       half of the radius given, or added twice
tip centres, r       -r       wrong side, or taken off twice
tip centres, r       -r/2     wrong side and diameter
tip centres, r       25.4 r   radius in inch
contact points       r        tip centres, or taken off along one axis
contact points       r/2      half of the radius taken off
contact points       -r       taken off twice, or the diameter
contact points       2r       taken off with the wrong sign
===================  =======  =======================================

r is the radius as stated; distances are positive on the side that the probe was said to be on.
"""

from __future__ import annotations

from typing import NamedTuple

from cmm_align.units import mm_per


class Mistake(NamedTuple):
    """One way to go wrong."""

    name: str
    offset_mm: float
    """Distance of the points from the nominal, mm."""
    words: str
    remedy: str


def mistakes_of(tip_radius_mm: float, *, contact: bool) -> tuple[Mistake, ...]:
    """Return the distances from the nominal that the usual mistakes leave.

    Parameters
    ----------
    tip_radius_mm : float
        As stated, mm.
    contact : bool
        The points were said to be contact points.
    """
    r = tip_radius_mm
    if contact:
        return (
            Mistake(
                "tip-centres", r, "these are tip centres, not contact points", "leave --contact-points out"
            ),
            Mistake("half-compensated", 0.5 * r, "half of the radius was taken off", "give tip centres"),
            Mistake(
                "compensated-twice",
                -r,
                "the radius was taken off twice, or the diameter once",
                "give tip centres",
            ),
            Mistake(
                "compensated-outwards",
                2.0 * r,
                "the radius was taken off with the wrong sign",
                "give tip centres",
            ),
        )
    return (
        Mistake("contact-points", 0.0, "these are contact points, not tip centres", "say --contact-points"),
        Mistake("diameter", 0.5 * r, "the diameter was given as the radius", "halve --tip-radius of offset"),
        Mistake(
            "wrong-side",
            -r,
            "the probe was on the other side, or the radius was taken off twice",
            "check --side of offset, and that the points are tip centres",
        ),
        Mistake(
            "wrong-side-diameter",
            -0.5 * r,
            "the probe was on the other side and the diameter was given as the radius",
            "check --side and --tip-radius of offset",
        ),
        Mistake(
            "half-radius",
            2.0 * r,
            "half of the radius was given, or the radius was added to tip centres",
            "check --tip-radius of offset, and that the points are tip centres",
        ),
        Mistake(
            "radius-inch",
            mm_per("inch") * r,
            "the radius was given in inch",
            "give --tip-radius of offset with its unit",
        ),
    )
