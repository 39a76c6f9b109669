"""Shapes of a torque chain's additional torque, each with unit amplitude, and its noise.

Every shape is a function of x = torque / full scale (-1 to 1), the branch (+1 up, -1 down) and its
own constants.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

__all__ = [
    "NORMAL",
    "OUTLIER_FACTOR",
    "REPEATABILITY",
    "SHAPES",
    "FloatArray",
    "Noise",
    "Shape",
    "Term",
    "draw_sign",
    "one_sided",
]

FloatArray = NDArray[np.float64]
Shape = Callable[..., FloatArray]


def one_sided(x: FloatArray, side: float) -> FloatArray:
    """Return the size of the torque on one side, 0 on the other."""
    return np.where(np.sign(x) == side, np.abs(x), 0.0)


def _offset(x: FloatArray, _branch: FloatArray) -> FloatArray:
    return np.ones_like(x)


def _power(x: FloatArray, _branch: FloatArray, side: float, exponent: float) -> FloatArray:
    return side * one_sided(x, side) ** exponent


def _whole_power(x: FloatArray, _branch: FloatArray, exponent: float) -> FloatArray:
    return np.asarray(x**exponent)


def _saturation(x: FloatArray, _branch: FloatArray, side: float, knee: float) -> FloatArray:
    return side * np.log1p(one_sided(x, side) / knee)


def _kink(
    x: FloatArray, _branch: FloatArray, side: float, start: float, width: float
) -> FloatArray:
    distance = (side * x - start) / width
    return np.asarray(side * width * np.logaddexp(0.0, distance))


def _smooth_step(x: FloatArray, _branch: FloatArray, width: float) -> FloatArray:
    return np.tanh(x / width)


def _rational_step(x: FloatArray, _branch: FloatArray, width: float) -> FloatArray:
    return x / (width + np.abs(x))


def _sine(x: FloatArray, _branch: FloatArray, period: float, quadrature: float) -> FloatArray:
    return np.sin(2 * np.pi * x / period + quadrature * np.pi / 2)


def _triangle(x: FloatArray, _branch: FloatArray, period: float, phase: float) -> FloatArray:
    return 2 / np.pi * np.arcsin(0.97 * np.sin(2 * np.pi * x / period + phase))


def _chirp(
    x: FloatArray,
    _branch: FloatArray,
    period: float,
    stretch: float,
    quadrature: float,
) -> FloatArray:
    angle = 2 * np.pi * (x + stretch * np.abs(x) * x) / period
    return np.sqrt(np.abs(x)) * np.sin(angle + quadrature * np.pi / 2)


def _bump(x: FloatArray, _branch: FloatArray, centre: float, width: float) -> FloatArray:
    return np.exp(-0.5 * ((x - centre) / width) ** 2)


def _resonance(x: FloatArray, _branch: FloatArray, centre: float, width: float) -> FloatArray:
    return 1.0 / (1.0 + ((x - centre) / width) ** 2)


def _packet(
    x: FloatArray,
    _branch: FloatArray,
    centre: float,
    width: float,
    period: float,
) -> FloatArray:
    return np.exp(-0.5 * ((x - centre) / width) ** 2) * np.cos(2 * np.pi * (x - centre) / period)


def _loop(x: FloatArray, branch: FloatArray, rise: float, fall: float) -> FloatArray:
    """Half the hysteresis loop, scaled to one at its widest; closes at full scale."""
    distance = np.minimum(np.abs(x), 1.0)
    widest = rise / (rise + fall)
    scale = widest**rise * (1 - widest) ** fall
    half = np.sign(x) * branch * distance**rise * (1 - distance) ** fall / scale
    return np.asarray(half)


def _one_sided_loop(
    x: FloatArray, branch: FloatArray, side: float, rise: float, fall: float
) -> FloatArray:
    return np.where(np.sign(x) == side, _loop(x, branch, max(rise, 1e-9), fall), 0.0)


def _arctangent(x: FloatArray, _branch: FloatArray, side: float, width: float) -> FloatArray:
    return side * np.arctan(one_sided(x, side) / width)


def _settling(x: FloatArray, _branch: FloatArray, side: float, knee: float) -> FloatArray:
    """Rational curve: quadratic at first, straight at last."""
    size = one_sided(x, side)
    return side * size**2 / (size + knee)


def _line_contact(x: FloatArray, _branch: FloatArray, side: float) -> FloatArray:
    """Deflection of a line contact over the load: x (1 - ln x), slope and all."""
    size = one_sided(x, side)
    return side * size * (1.0 - np.log(np.maximum(size, 1e-12)))


def _algebraic_step(x: FloatArray, _branch: FloatArray, width: float) -> FloatArray:
    return x / np.sqrt(width**2 + x**2)


def _warped_sine(
    x: FloatArray,
    _branch: FloatArray,
    period: float,
    warp: float,
    quadrature: float,
) -> FloatArray:
    angle = 2 * np.pi * np.arctan(warp * x) / (warp * period)
    return np.sin(angle + quadrature * np.pi / 2)


def _sech_bump(x: FloatArray, _branch: FloatArray, centre: float, width: float) -> FloatArray:
    return 1.0 / np.cosh((x - centre) / width)


def _slip(
    x: FloatArray, branch: FloatArray, side: float, level: float, gap: float, width: float
) -> FloatArray:
    """Smooth step at a level, lower by a gap on the way back."""
    size = one_sided(x, side)
    risen = np.clip((size - np.where(branch > 0, level, level - gap)) / width, 0.0, 1.0)
    return side * risen**2 * (3.0 - 2.0 * risen)


def _play_loop(
    x: FloatArray, branch: FloatArray, side: float, width: float, growth: float
) -> FloatArray:
    """Half the loop of a play that has been to full scale before; it grows with the load.

    The play's state on the way up is max(w, x - w), on the way down min(1 - w, x + w), at 0 alike.
    """
    size = np.minimum(one_sided(x, side), 1.0)
    up, down = np.maximum(width, size - width), np.minimum(1.0 - width, size + width)
    loop = (1.0 + growth * size) / (1.0 + growth) * (down - up) / (2.0 * width)
    return np.where(np.sign(x) == side, side * branch * loop, 0.0)


def _sawtooth(
    x: FloatArray, _branch: FloatArray, period: float, phase: float, sharpness: float
) -> FloatArray:
    angle = 2 * np.pi * x / period + phase
    tooth = np.arctan2(sharpness * np.sin(angle), 1.0 - sharpness * np.cos(angle))
    return np.asarray(np.sqrt(np.abs(x)) * tooth / np.arcsin(min(sharpness, 1.0)))


def _dead_band(
    x: FloatArray, branch: FloatArray, side: float, width: float, gap: float
) -> FloatArray:
    """Nothing until a clearance is taken up, straight from there; on the way back a gap lower."""
    size = np.minimum(one_sided(x, side), 1.0)
    edge = width - np.where(branch > 0, 0.0, gap * (1.0 - size))
    return side * np.maximum(size - edge, 0.0)


def _error_step(x: FloatArray, _branch: FloatArray, width: float) -> FloatArray:
    return np.asarray(erf(x / width), dtype=np.float64)


def _exponential(x: FloatArray, _branch: FloatArray, side: float, rate: float) -> FloatArray:
    return side * np.expm1(rate * one_sided(x, side)) / math.expm1(rate)


def _leaf_stops(
    x: FloatArray, _branch: FloatArray, side: float, first: float, spacing: float
) -> FloatArray:
    """Slopes of leaves that come to bear one after another, each over 3 % of the range."""
    size, starts = one_sided(x, side)[..., None], first + spacing * np.arange(3)
    bearing = np.hypot(0.03, size - starts) + size - np.hypot(0.03, starts)
    return np.asarray(side * np.sum(bearing, axis=-1) / 6.0)


def _saddle(x: FloatArray, _branch: FloatArray, centre: float, width: float) -> FloatArray:
    """Up and down around a torque, where contact passes from one flank to the next."""
    distance = (x - centre) / width
    return 2.0 * distance / (1.0 + distance**2)


SHAPES: dict[str, Shape] = {
    "offset": _offset,
    "power": _power,
    "whole-power": _whole_power,
    "saturation": _saturation,
    "kink": _kink,
    "smooth-step": _smooth_step,
    "rational-step": _rational_step,
    "sine": _sine,
    "triangle": _triangle,
    "chirp": _chirp,
    "bump": _bump,
    "resonance": _resonance,
    "packet": _packet,
    "loop": _loop,
    "one-sided-loop": _one_sided_loop,
    "arctangent": _arctangent,
    "settling": _settling,
    "line-contact": _line_contact,
    "algebraic-step": _algebraic_step,
    "warped-sine": _warped_sine,
    "sech-bump": _sech_bump,
    "slip": _slip,
    "play-loop": _play_loop,
    "sawtooth": _sawtooth,
    "dead-band": _dead_band,
    "error-step": _error_step,
    "exponential": _exponential,
    "leaf-stops": _leaf_stops,
    "saddle": _saddle,
}


@dataclass(frozen=True)
class Term:
    """One term of a chain's additional torque: amplitude (fraction of full scale) times shape.

    The first ``fixed`` constants of the shape are structure (a side, a quadrature), never fitted.
    """

    shape: str
    amplitude: float
    constants: tuple[float, ...] = ()
    fixed: int = 0

    def unit(self, x: FloatArray, branch: FloatArray) -> FloatArray:
        """Value with amplitude one."""
        return SHAPES[self.shape](x, branch, *self.constants)


def draw_sign(rng: np.random.Generator) -> float:
    """Return -1 or 1."""
    return float(rng.choice([-1.0, 1.0]))


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
