"""Synthetic torque chains with a known truth, each defined by a family and a seed.

A chain reads ``reading = torque - A(torque, branch)``, where the additional torque A is a sum of
terms. Everything here is written down from what misaligned shafts, bearings and splines do in
general; nothing comes from the simulated bench, so a model that does well here wasn't tuned to it.

Some families are made of shapes that a physical basis also holds (quadratics, a hyperbolic tangent
at reversal, a sine); the others hold none of them: power laws, rational steps, triangular and
chirped ripple, Lorentzian bumps, kinks, skewed loops, heavy-tailed noise, drift.

The *known-form bound* is what a fit reaches that is told the exact shapes: see :func:`known_form`.

The models were developed on all families but those in ``ASIDE_FAMILIES``, which nobody looked at
until the models were complete; the benchmark reports them apart. Seeds from ``REPORTED_SEED`` on
were used for nothing but the reported figures.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from tests.support.chain_families import ASIDE_FAMILIES, FAMILIES, Term, draw_noise
from tests.support.chain_shapes import NORMAL, REPEATABILITY, FloatArray, Noise

__all__ = [
    "ASIDE_FAMILIES",
    "FAMILIES",
    "LOADING_ACCURACY",
    "REPEATABILITY",
    "REPORTED_SEED",
    "CalibrationSet",
    "Chain",
    "DenseSet",
    "KnownForm",
    "Noise",
    "Term",
    "known_form",
    "make_chain",
    "path",
]

REPORTED_SEED = 5000
"""Seeds from here on are kept for the reported figures."""

LOADING_ACCURACY = 1e-3
"""A commanded torque is met to this fraction of full scale, evenly distributed."""


@dataclass(frozen=True)
class CalibrationSet:
    """What a calibration of a chain delivers, rows in the order of time.

    ``X`` has the columns reading (N·m), branch, series; ``standard_nm`` is the exact torque.
    """

    X: FloatArray
    standard_nm: FloatArray


@dataclass(frozen=True)
class DenseSet:
    """Noise-free readings over the whole range, both directions and both branches."""

    X: FloatArray
    torque_nm: FloatArray


@dataclass(frozen=True)
class Chain:
    """A torque chain whose true additional torque is known everywhere."""

    family: str
    seed: int
    terms: tuple[Term, ...]
    noise: Noise = NORMAL
    range_nm: float = 2000.0

    def additional_torque(self, torque_nm: FloatArray, branch: FloatArray) -> FloatArray:
        """Return the additional torque, N·m, at a true torque on a branch (+1 up, -1 down)."""
        x = np.asarray(torque_nm, dtype=float) / self.range_nm
        total = np.zeros_like(x)
        for term in self.terms:
            total += term.amplitude * term.unit(x, branch)
        return self.range_nm * total

    def reading(self, torque_nm: FloatArray, branch: FloatArray) -> FloatArray:
        """Noise-free reading, N·m."""
        return np.asarray(torque_nm, dtype=float) - self.additional_torque(torque_nm, branch)

    def calibration(self, points: int = 50, repeat: int = 0) -> CalibrationSet:
        """Calibrate with ``points`` readings: 0 → +FS → 0 → −FS → 0, a quarter on each leg.

        ``repeat`` draws another noise on the same chain.
        """
        rng = np.random.default_rng(
            [zlib.crc32(self.family.encode()), self.seed, 7, points, repeat]
        )
        torque, branch, series = path(points, self.range_nm)
        jitter = LOADING_ACCURACY * self.range_nm * rng.uniform(-1, 1, points)
        torque = np.clip(torque + jitter, -self.range_nm, self.range_nm)
        torque = np.where(torque * series < 0, -torque, torque)
        scatter = self.noise.relative(torque / self.range_nm) * self.noise.draw(points, rng)
        noise = scatter + self.noise.drifted(points)
        read = self.reading(torque, branch) / self.range_nm + noise
        reading = self.range_nm * self.noise.rounded(read)
        number = np.where(series > 0, 1.0, 2.0)
        return CalibrationSet(np.column_stack([reading, branch, number]), torque)

    def dense(self, points: int = 400) -> DenseSet:
        """Sweep ``points`` torques from −FS to +FS on each branch, without noise."""
        torque = np.linspace(-self.range_nm, self.range_nm, points + points % 2)
        torque = np.concatenate([torque, torque])
        branch = np.repeat([1.0, -1.0], torque.size // 2)
        series = np.where(torque > 0, 1.0, 2.0)
        return DenseSet(np.column_stack([self.reading(torque, branch), branch, series]), torque)

    def noisy(self, dense: DenseSet) -> FloatArray:
        """Return the readings of a sweep with new noise, counted from a zero just taken."""
        rng = np.random.default_rng([zlib.crc32(self.family.encode()), self.seed, 11])
        x = dense.torque_nm / self.range_nm
        noise = self.noise.relative(x) * self.noise.draw(x.size, rng)
        reading = self.range_nm * self.noise.rounded(dense.X[:, 0] / self.range_nm + noise)
        return np.column_stack([reading, dense.X[:, 1:]])


def path(points: int, range_nm: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Torque (N·m), branch and direction of ``points`` even steps of 0 → +FS → 0 → −FS → 0."""
    legs = np.full(4, points // 4)
    legs[: points % 4] += 1
    up, down, back, home = (
        np.arange(1, legs[0] + 1) / legs[0],
        np.arange(legs[1] - 1, -1, -1) / legs[1],
        np.arange(1, legs[2] + 1) / legs[2],
        np.arange(legs[3] - 1, -1, -1) / legs[3],
    )
    torque = range_nm * np.concatenate([up, down, -back, -home])
    branch = np.repeat([1.0, -1.0, 1.0, -1.0], legs)
    direction = np.repeat([1.0, 1.0, -1.0, -1.0], legs)
    return torque, branch, direction


def make_chain(family: str, seed: int, range_nm: float = 2000.0) -> Chain:
    """Draw a chain.

    Parameters
    ----------
    family : str
        A key of ``FAMILIES``.
    seed : int
        Same family and seed, same chain.
    range_nm : float
        Full scale, N·m.
    """
    rng = np.random.default_rng([zlib.crc32(family.encode()), seed])
    terms = tuple(FAMILIES[family](rng))
    return Chain(family, seed, terms, draw_noise(family, rng), range_nm)


# --- the known-form bound ---


@dataclass(frozen=True)
class KnownForm:
    """A chain's exact form with constants fitted to a calibration."""

    chain: Chain

    def predict(self, X: FloatArray) -> FloatArray:
        """Torque, N·m: solves ``torque = reading + A(torque)`` by fixed point (|A'| < 0.1)."""
        torque = X[:, 0].copy()
        for _ in range(30):
            torque = X[:, 0] + self.chain.additional_torque(torque, X[:, 1])
        return torque


def known_form(chain: Chain, data: CalibrationSet, nonlinear: bool = False) -> KnownForm:
    """Fit the chain's own exact form to a calibration of it: the bound to compare models with.

    The form, the noise's distribution (least squares for normal noise, Student's likelihood for
    heavy tails, weights where it grows with the load) and the drift's shape are told. With
    ``nonlinear=False``, the strictest bound, every constant inside a shape (period, centre, width,
    exponent) is told as well, and only the amplitudes are unknown: no method can be expected to do
    better. With ``nonlinear=True`` those
    constants are unknown too, and the fit starts from their true values.
    """
    x, branch = data.standard_nm / chain.range_nm, data.X[:, 1]
    relative = chain.noise.relative(x)
    target = (data.standard_nm - data.X[:, 0]) / chain.range_nm / relative
    drift = _unit_drift(chain, x.size)

    def columns(terms: tuple[Term, ...]) -> FloatArray:
        rows = np.column_stack([term.unit(x, branch) for term in terms] + drift)
        return np.asarray(rows / relative[:, None])

    terms = chain.terms
    if nonlinear:
        free = [(i, k) for i, t in enumerate(terms) for k in range(t.fixed, len(t.constants))]
        start = np.array([terms[i].constants[k] for i, k in free])

        def residual(values: FloatArray) -> FloatArray:
            matrix = columns(_with_constants(terms, free, values))
            return target - matrix @ _amplitudes(matrix, target, chain.noise)

        if start.size:
            scale = np.maximum(np.abs(start), 1e-2)

            def scaled(change: FloatArray) -> FloatArray:
                return residual(start + scale * change) / REPEATABILITY

            solution = least_squares(
                scaled,
                np.zeros(start.size),
                bounds=(-0.5, 0.5),
            )
            terms = _with_constants(terms, free, start + scale * solution.x)
    amplitudes = _amplitudes(columns(terms), target, chain.noise)
    fitted = tuple(replace(t, amplitude=float(a)) for t, a in zip(terms, amplitudes, strict=False))
    return KnownForm(replace(chain, terms=fitted))


def _unit_drift(chain: Chain, size: int) -> list[FloatArray]:
    if chain.noise.drift == 0.0:
        return []
    return [-replace(chain.noise, drift=1.0).drifted(size)]


def _with_constants(
    terms: tuple[Term, ...], free: list[tuple[int, int]], values: FloatArray
) -> tuple[Term, ...]:
    constants = [list(term.constants) for term in terms]
    for (i, k), value in zip(free, values, strict=True):
        constants[i][k] = float(value)
    return tuple(replace(t, constants=tuple(c)) for t, c in zip(terms, constants, strict=True))


def _amplitudes(matrix: FloatArray, target: FloatArray, noise: Noise) -> FloatArray:
    """Least squares, or maximum likelihood of the noise's own distribution by iterated weights."""
    amplitudes = np.linalg.lstsq(matrix, target, rcond=None)[0]
    if np.isinf(noise.freedom) and noise.outliers == 0.0:
        return np.asarray(amplitudes)
    for _ in range(100):
        root = np.sqrt(noise.weights(target - matrix @ amplitudes))
        amplitudes = np.linalg.lstsq(matrix * root[:, None], target * root, rcond=None)[0]
    return np.asarray(amplitudes)
