"""Noise and drift of a synthetic chain's readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.chain_shapes import FloatArray

__all__ = ["NORMAL", "OUTLIER_FACTOR", "REPEATABILITY", "Noise"]

REPEATABILITY = 2e-4
"""Standard deviation of one reading, as a fraction of full scale (0.02 % FS)."""

OUTLIER_FACTOR = 5.0
"""How much wider than the others contaminated readings scatter."""


@dataclass(frozen=True)
class Noise:
    """Noise of one reading, as fractions of full scale.

    ``freedom`` is Student's degrees of freedom (infinite: normal), and ``outliers`` the share of
    readings whose noise is ``OUTLIER_FACTOR`` times as large; either is scaled so that the standard
    deviation of all readings stays ``scale``. ``drift`` is what the zero gains from the first to
    the last reading,
    and ``drift_bend`` bends it (exponent of the elapsed fraction of the time); with a ``lag`` above
    0 it settles exponentially instead (time constant as a fraction of the calibration), with an
    ``onset`` above 0 it creeps with the logarithm of the time from there on. ``growth``
    makes the noise grow with the load: by this factor, plus one, from zero to full scale; with
    ``share`` a part in proportion to the load adds to it as a root sum of squares, at full scale by
    this factor. ``cycles`` above 0 makes the zero swing by ``drift``, so often in a calibration.
    ``resolution`` is the step to which a reading is rounded.
    """

    scale: float = REPEATABILITY
    freedom: float = np.inf
    outliers: float = 0.0
    drift: float = 0.0
    drift_bend: float = 1.0
    lag: float = 0.0
    onset: float = 0.0
    growth: float = 0.0
    resolution: float = 0.0
    share: float = 0.0
    cycles: float = 0.0

    def draw(self, size: int, rng: np.random.Generator) -> FloatArray:
        """Random part, without drift."""
        if np.isfinite(self.freedom):
            return np.asarray(self.core * rng.standard_t(self.freedom, size))
        factor = np.where(rng.uniform(size=size) < self.outliers, OUTLIER_FACTOR, 1.0)
        return self.core * factor * rng.standard_normal(size)

    @property
    def core(self) -> float:
        """Scale of the distribution's middle part."""
        if np.isfinite(self.freedom):
            return float(self.scale * np.sqrt((self.freedom - 2) / self.freedom))
        return float(self.scale / np.sqrt(1 - self.outliers + self.outliers * OUTLIER_FACTOR**2))

    def weights(self, residual: FloatArray) -> FloatArray:
        """Weights by which least squares becomes maximum likelihood, at these residuals."""
        scaled = residual**2 / self.core**2
        if np.isfinite(self.freedom):
            return np.asarray((self.freedom + 1) / (self.freedom + scaled))
        middle = (1 - self.outliers) * np.exp(-0.5 * scaled)
        outlying = self.outliers / OUTLIER_FACTOR * np.exp(-0.5 * scaled / OUTLIER_FACTOR**2)
        return np.asarray((middle + outlying / OUTLIER_FACTOR**2) / (middle + outlying + 1e-300))

    def drifted(self, size: int) -> FloatArray:
        """Drift of ``size`` readings taken at even times."""
        time = np.arange(size) / max(size - 1, 1)
        if self.cycles > 0.0:
            return np.asarray(self.drift * np.sin(2.0 * np.pi * self.cycles * time))
        if self.lag > 0.0:
            return np.asarray(self.drift * np.expm1(-time / self.lag) / np.expm1(-1 / self.lag))
        if self.onset > 0.0:
            return np.asarray(self.drift * np.log1p(time / self.onset) / np.log1p(1 / self.onset))
        return self.drift * time**self.drift_bend

    def rounded(self, reading: FloatArray) -> FloatArray:
        """Round readings (fractions of full scale) to the resolution."""
        if self.resolution == 0.0:
            return reading
        return np.asarray(self.resolution * np.round(reading / self.resolution))

    def relative(self, x: FloatArray) -> FloatArray:
        """Return the noise at loads x over that of all readings, evenly loaded, together."""
        mean_square = 1.0 + self.growth + self.growth**2 / 3 + self.share**2 / 3
        square = (1.0 + self.growth * np.abs(x)) ** 2 + (self.share * x) ** 2
        return np.asarray(np.sqrt(square / mean_square))


NORMAL = Noise()
"""Normal, without drift."""
