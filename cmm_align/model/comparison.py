"""What changed between two measurements of one part, and whether noise can explain it."""

from __future__ import annotations

from dataclasses import dataclass

from cmm_align.model.statistics import Statistics
from cmm_align.surfaces.protocol import Array, Mask


@dataclass(frozen=True, slots=True)
class ChangeRung:
    """What is left of the difference without all that this rung and those before it remove, um.

    Attributes
    ----------
    removed : str
    pv_um, rms_um : float
    expected_rms_um : float
        From the noise of both measurements alone; with the rigid motion, from both poses too.
    p_value : float
        Chance that noise alone leaves as much.
    noise : bool
        Whether noise explains it.
    """

    removed: str
    pv_um: float
    rms_um: float
    expected_rms_um: float
    p_value: float
    noise: bool


@dataclass(frozen=True, slots=True)
class ChangeBand:
    """The difference in one band of wavelengths.

    Attributes
    ----------
    name : str
    shortest_mm, longest_mm : float
        Wavelengths of the band, where half is told; inf is no limit.
    rms_um, expected_rms_um : float
        Of the difference, and from noise alone.
    freedom : float
        Independent values in it.
    p_value : float
        Chance that noise alone gives as much.
    significant : bool
    """

    name: str
    shortest_mm: float
    longest_mm: float
    rms_um: float
    expected_rms_um: float
    freedom: float
    p_value: float
    significant: bool


@dataclass(frozen=True, slots=True)
class Change:
    """The numbers of a comparison; shares are of the common area, 0 to 1.

    Attributes
    ----------
    earlier : str
        Name of the earlier measurement.
    before, after, difference : Statistics
        Over the common nodes; the difference is after - before, positive where material came on.
    spacing_mm : float
        Of the common grid.
    common : float
        Share of the later map's area that both know.
    rungs : tuple of ChangeRung
    bands : tuple of ChangeBand
    false_discovery_rate : float
        Of the nodes that are called changed.
    least_significant_um : float
        Smallest difference that is called changed; NaN if none is.
    share_changed : float
        Of the area whose form (the difference without its rigid motion) changed beyond the noise.
    share_better, share_worse : float
        Changed, and now nearer to the nominal, or farther off.
    rms_change_um, u_rms_change_um : float
        Of the RMS, after - before, and its standard uncertainty.
    real : bool
        Whether anything differs beyond the noise.
    form_changed : bool
        Whether anything differs that a rigid motion of the part does not explain.
    worse_than_before, better_than_before : bool
        Whether the RMS rose, or fell, beyond the noise.
    words : tuple of str
        The verdict, a sentence each.
    """

    earlier: str
    before: Statistics
    after: Statistics
    difference: Statistics
    spacing_mm: float
    common: float
    rungs: tuple[ChangeRung, ...]
    bands: tuple[ChangeBand, ...]
    false_discovery_rate: float
    least_significant_um: float
    share_changed: float
    share_better: float
    share_worse: float
    rms_change_um: float
    u_rms_change_um: float
    real: bool
    form_changed: bool
    worse_than_before: bool
    better_than_before: bool
    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two measurements of one part on one grid, frame `surface`.

    Attributes
    ----------
    x_mm, y_mm : ndarray, shape (nx,), (ny,), mm, frame `surface`
    before_mm, after_mm : ndarray, shape (ny, nx), mm
        Deviations along the normal, positive = excess material; NaN where not both are known.
    u_mm : ndarray, shape (ny, nx), mm
        Standard uncertainty of ``after_mm - before_mm``.
    changed : ndarray of bool, shape (ny, nx)
        Where the difference, its rigid motion taken out, is beyond the noise.
    change : Change
    """

    x_mm: Array
    y_mm: Array
    before_mm: Array
    after_mm: Array
    u_mm: Array
    changed: Mask
    change: Change

    @property
    def difference_mm(self) -> Array:
        """After less before, shape (ny, nx), mm, NaN where unknown."""
        return self.after_mm - self.before_mm
