"""What a Monte Carlo of the measurement says of an alignment: numbers to record, and the spread of points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cmm_align.model.points import IntArray
from cmm_align.surfaces.protocol import Array


@dataclass(frozen=True, slots=True)
class Spread:
    """One number of the deviations over all simulated measurements, um."""

    measured_um: float
    """As measured, without simulated errors."""
    mean_um: float
    std_um: float
    low_um: float
    """2.5 % of the simulations are below."""
    high_um: float
    """2.5 % are above."""

    @property
    def bias_um(self) -> float:
        """What errors of the machine add on average, um: the measured value is too large by about this."""
        return self.mean_um - self.measured_um


@dataclass(frozen=True, slots=True)
class MonteCarlo:
    """Simulated repetitions of a measurement, each fitted anew."""

    mpe: str
    """Statement of the machine's length error that the simulated errors meet."""
    coverage_factor: float
    """The statement in standard deviations of a length."""
    probe_share: float
    """Share of lobing in the variance of the constant part."""
    n: int
    """Simulated measurements."""
    seed: int
    n_points: int
    """Deviations behind PV and RMS; PV grows with them."""
    pose_sigma: Mapping[str, float]
    """Standard uncertainties rx_urad, ry_urad, rz_urad, tx_um, ty_um, tz_um about the centroid of the
    tip centres, frame `part`; infinite where a motion is unobservable, 0 where it is locked."""
    pose_interval: Mapping[str, tuple[float, float]]
    """Where the middle 95 % of each motion lie, keys and units as in `pose_sigma`."""
    covariance: tuple[tuple[float, ...], ...]
    """Of (rx, ry, rz, tx, ty, tz), 6 x 6, rad and mm, as `Alignment.covariance`."""
    pv: Spread
    """PV of the deviations."""
    rms: Spread
    """RMS of the deviations."""


@dataclass(frozen=True, slots=True)
class PointSpread:
    """How much single deviations vary from one simulated measurement to the next.

    Attributes
    ----------
    index : ndarray of int64, shape (n,)
        Which points of the alignment were simulated, rising.
    sigma_mm : ndarray, shape (n,), mm
        Standard deviation of the deviation of each, after the fit.
    """

    index: IntArray
    sigma_mm: Array
