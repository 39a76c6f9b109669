"""Synthetic torque chains with a known truth, each defined by a family and a seed.

A chain reads ``reading = torque - A(torque, branch)``, where the additional torque A is a sum of
terms. Everything here is written down from what misaligned shafts, bearings and splines do in
general; nothing comes from the simulated bench, so a model that does well here wasn't tuned to it.

Some families are made of shapes that a physical basis also holds (quadratics, a hyperbolic tangent
at reversal, a sine); the others hold none of them: power laws, rational steps, triangular and
chirped ripple, Lorentzian bumps, kinks, skewed loops, heavy-tailed noise, drift.

The *known-form bound* is what a fit reaches that is told the exact shapes: see :func:`known_form`.

Families in ``HELD_OUT_FAMILIES`` and seeds from ``HELD_OUT_SEED`` on are never looked at while a
model is developed; the benchmark reports them apart.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from benchmarks.chain_shapes import SHAPES, FloatArray

REPEATABILITY = 2e-4
"""Standard deviation of one reading, as a fraction of full scale (0.02 % FS)."""

HELD_OUT_SEED = 1000
"""Seeds from here on are kept for the final check."""

WILD_FACTOR = 5.0
"""How much wider than the others contaminated readings scatter."""

LOADING_ACCURACY = 1e-3
"""A commanded torque is met to this fraction of full scale, evenly distributed."""


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


@dataclass(frozen=True)
class Noise:
    """Noise of one reading, as fractions of full scale.

    ``freedom`` is Student's degrees of freedom (infinite: normal), and ``wild`` the share of
    readings whose noise is ``WILD_FACTOR`` times as large; either is scaled so that the standard
    deviation of all readings stays ``scale``. ``drift`` is what the zero gains from the first to
    the last reading,
    and ``drift_bend`` bends it (exponent of the elapsed fraction of the time).
    """

    scale: float = REPEATABILITY
    freedom: float = np.inf
    wild: float = 0.0
    drift: float = 0.0
    drift_bend: float = 1.0

    def draw(self, size: int, rng: np.random.Generator) -> FloatArray:
        """Random part, without drift."""
        if np.isfinite(self.freedom):
            return np.asarray(self.core * rng.standard_t(self.freedom, size))
        factor = np.where(rng.uniform(size=size) < self.wild, WILD_FACTOR, 1.0)
        return self.core * factor * rng.standard_normal(size)

    @property
    def core(self) -> float:
        """Scale of the distribution's middle part."""
        if np.isfinite(self.freedom):
            return float(self.scale * np.sqrt((self.freedom - 2) / self.freedom))
        return float(self.scale / np.sqrt(1 - self.wild + self.wild * WILD_FACTOR**2))

    def weights(self, residual: FloatArray) -> FloatArray:
        """Weights by which least squares becomes maximum likelihood, at these residuals."""
        scaled = residual**2 / self.core**2
        if np.isfinite(self.freedom):
            return np.asarray((self.freedom + 1) / (self.freedom + scaled))
        middle = (1 - self.wild) * np.exp(-0.5 * scaled)
        wild = self.wild / WILD_FACTOR * np.exp(-0.5 * scaled / WILD_FACTOR**2)
        return np.asarray((middle + wild / WILD_FACTOR**2) / (middle + wild + 1e-300))

    def drifted(self, size: int) -> FloatArray:
        """Drift of ``size`` readings taken at even times."""
        return self.drift * (np.arange(size) / max(size - 1, 1)) ** self.drift_bend


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
    noise: Noise = Noise()
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
        noise = self.noise.draw(points, rng) + self.noise.drifted(points)
        reading = self.reading(torque, branch) + self.range_nm * noise
        number = np.where(series > 0, 1.0, 2.0)
        return CalibrationSet(np.column_stack([reading, branch, number]), torque)

    def dense(self, points: int = 400) -> DenseSet:
        """Sweep ``points`` torques from −FS to +FS on each branch, without noise."""
        torque = np.linspace(-self.range_nm, self.range_nm, points + points % 2)
        torque = np.concatenate([torque, torque])
        branch = np.repeat([1.0, -1.0], torque.size // 2)
        series = np.where(torque > 0, 1.0, 2.0)
        return DenseSet(np.column_stack([self.reading(torque, branch), branch, series]), torque)


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


# --- families ---


def _main_quadratic(rng: np.random.Generator, shape_linear: float = 1.0) -> list[Term]:
    """Per-direction linear and quadratic terms, some 0.6 % of full scale together."""
    sign = rng.choice([-1.0, 1.0])
    linear = sign * rng.uniform(0.0020, 0.0050)
    bent = sign * rng.uniform(0.0015, 0.0040)
    terms = []
    for side in (1.0, -1.0):
        terms.append(Term("power", linear * rng.uniform(0.85, 1.15), (side, shape_linear), 1))
        terms.append(Term("power", bent * rng.uniform(0.7, 1.3), (side, 2.0), 1))
    return terms


def _sine_pair(rng: np.random.Generator, low: float, high: float) -> list[Term]:
    amplitude, phase = rng.uniform(low, high), rng.uniform(0, 2 * np.pi)
    period = rng.uniform(0.12, 0.40)
    return [
        Term("sine", amplitude * np.cos(phase), (period, 0.0)),
        Term("sine", amplitude * np.sin(phase), (period, 1.0)),
    ]


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _reference(rng: np.random.Generator) -> list[Term]:
    return [
        Term("offset", rng.normal(0, 5e-5)),
        *_main_quadratic(rng),
        Term("smooth-step", _sign(rng) * rng.uniform(3e-4, 7e-4), (rng.uniform(0.005, 0.02),)),
        *_sine_pair(rng, 1e-4, 3e-4),
        *[
            Term(
                "bump",
                _sign(rng) * rng.uniform(2e-4, 5e-4),
                (rng.uniform(-0.9, 0.9), rng.uniform(0.04, 0.12)),
            )
            for _ in range(2)
        ],
        *_loop_pair(rng, 1.0, 1.0),
    ]


def _loop_pair(rng: np.random.Generator, rise: float, fall: float) -> list[Term]:
    amplitude = _sign(rng) * rng.uniform(1e-4, 3e-4)
    return [
        Term("one-sided-loop", amplitude * rng.uniform(0.7, 1.3), (side, rise, fall), 1)
        for side in (1.0, -1.0)
    ]


def _quadratic(rng: np.random.Generator) -> list[Term]:
    return [Term("offset", rng.normal(0, 5e-5)), *_main_quadratic(rng)]


def _power_law(rng: np.random.Generator) -> list[Term]:
    terms = [Term("offset", rng.normal(0, 5e-5))]
    sign, exponent = _sign(rng), rng.uniform(1.3, 2.7)
    linear, bent = sign * rng.uniform(0.001, 0.003), sign * rng.uniform(0.002, 0.005)
    for side in (1.0, -1.0):
        terms.append(Term("power", linear * rng.uniform(0.8, 1.2), (side, 1.0), 1))
        bend = exponent * rng.uniform(0.9, 1.1)
        terms.append(Term("power", bent * rng.uniform(0.8, 1.2), (side, bend), 1))
    return [
        *terms,
        Term("rational-step", _sign(rng) * rng.uniform(1e-4, 4e-4), (rng.uniform(0.003, 0.02),)),
        Term("triangle", rng.uniform(1e-4, 3e-4), (rng.uniform(0.1, 0.3), rng.uniform(0, 6.28))),
        Term(
            "resonance",
            _sign(rng) * rng.uniform(2e-4, 5e-4),
            (rng.uniform(-0.9, 0.9), rng.uniform(0.02, 0.06)),
        ),
        Term("loop", _sign(rng) * rng.uniform(1e-4, 3e-4), (rng.uniform(0.4, 0.9), 0.7)),
    ]


def _skewed_hysteresis(rng: np.random.Generator) -> list[Term]:
    """Loops of different size and skew in each direction, open at zero or not."""
    width = _sign(rng) * rng.uniform(2e-4, 5e-4)
    rise = rng.choice([0.0, rng.uniform(0.3, 0.6), rng.uniform(1.5, 2.5)])
    fall = rng.uniform(0.6, 2.0)
    terms = []
    for side in (1.0, -1.0):
        # A loop that is open at zero passes from one direction into the other without a jump.
        amplitude = width * (rng.uniform(0.6, 1.4) if rise > 0 else 1.0)
        terms.append(Term("one-sided-loop", amplitude, (side, rise, fall), 1))
    return [
        Term("offset", rng.normal(0, 5e-5)),
        *_main_quadratic(rng, shape_linear=rng.uniform(0.95, 1.1)),
        Term("rational-step", _sign(rng) * rng.uniform(1e-4, 3e-4), (rng.uniform(0.003, 0.02),)),
        *terms,
    ]


def _contaminated(rng: np.random.Generator) -> list[Term]:
    return [*_skewed_hysteresis(rng), *_sine_pair(rng, 1e-4, 2e-4)]


def _heavy_tailed(rng: np.random.Generator) -> list[Term]:
    return [*_power_law(rng)]


def _drifting(rng: np.random.Generator) -> list[Term]:
    terms = [Term("offset", 0.0)]
    sign = _sign(rng)
    terms += [
        Term("saturation", sign * rng.uniform(0.002, 0.006), (side, rng.uniform(0.4, 2.0)), 1)
        for side in (1.0, -1.0)
    ]
    return [
        *terms,
        Term("power", sign * rng.uniform(0.001, 0.003), (1.0, rng.uniform(1.4, 2.2)), 1),
        Term("power", sign * rng.uniform(0.001, 0.003), (-1.0, rng.uniform(1.4, 2.2)), 1),
        Term("rational-step", _sign(rng) * rng.uniform(1e-4, 3e-4), (rng.uniform(0.003, 0.02),)),
        Term("loop", _sign(rng) * rng.uniform(1e-4, 3e-4), (0.8, 1.2)),
    ]


def _kinked(rng: np.random.Generator) -> list[Term]:
    """Contact that changes at a torque: slopes change over a short width."""
    kinks = [
        Term(
            "kink",
            _sign(rng) * rng.uniform(1e-3, 3e-3),
            (side, rng.uniform(0.2, 0.8), rng.uniform(0.01, 0.04)),
            1,
        )
        for side in (1.0, -1.0)
    ]
    return [
        Term("offset", rng.normal(0, 5e-5)),
        *_main_quadratic(rng, shape_linear=rng.uniform(1.0, 1.2)),
        *kinks,
        Term("rational-step", _sign(rng) * rng.uniform(1e-4, 4e-4), (rng.uniform(0.003, 0.02),)),
        Term("loop", _sign(rng) * rng.uniform(1e-4, 3e-4), (0.7, 1.3)),
    ]


def _rippled(rng: np.random.Generator) -> list[Term]:
    """Ripple that stretches and grows with the torque, and a wave packet of tooth engagement."""
    period, stretch = rng.uniform(0.12, 0.30), rng.uniform(-0.15, 0.15)
    amplitude, phase = rng.uniform(1e-4, 3e-4), rng.uniform(0, 2 * np.pi)
    exponent = rng.uniform(1.6, 2.4)
    main = [
        Term(t.shape, t.amplitude, (t.constants[0], exponent if t.constants[1] == 2 else 1.0), 1)
        for t in _main_quadratic(rng)
    ]
    return [
        Term("offset", rng.normal(0, 5e-5)),
        *main,
        Term("rational-step", _sign(rng) * rng.uniform(1e-4, 3e-4), (rng.uniform(0.003, 0.02),)),
        Term("chirp", amplitude * np.cos(phase), (period, stretch, 0.0)),
        Term("chirp", amplitude * np.sin(phase), (period, stretch, 1.0)),
        Term(
            "packet",
            _sign(rng) * rng.uniform(2e-4, 4e-4),
            (rng.uniform(-0.8, 0.8), rng.uniform(0.08, 0.15), rng.uniform(0.15, 0.3)),
        ),
        Term("loop", _sign(rng) * rng.uniform(1e-4, 3e-4), (1.3, 0.8)),
    ]


FAMILIES: dict[str, Callable[[np.random.Generator], list[Term]]] = {
    "reference": _reference,
    "quadratic": _quadratic,
    "power-law": _power_law,
    "skewed-hysteresis": _skewed_hysteresis,
    "heavy-tailed": _heavy_tailed,
    "drifting": _drifting,
    "contaminated": _contaminated,
    "kinked": _kinked,
    "rippled": _rippled,
}
"""Families by name; all but the first two hold nothing of any model's basis exactly."""

HELD_OUT_FAMILIES = ("heavy-tailed", "kinked", "rippled")
"""Families that no model was developed on."""


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
    noise = Noise()
    if family == "heavy-tailed":
        noise = Noise(freedom=3.0)
    if family == "contaminated":
        noise = Noise(wild=0.06)
    if family == "drifting":
        drift = _sign(rng) * rng.uniform(1e-4, 5e-4)
        noise = Noise(drift=drift, drift_bend=rng.uniform(0.7, 1.4))
    return Chain(family, seed, terms, noise, range_nm)


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
    heavy tails) and the drift's shape are told. With ``nonlinear=False``, the strictest bound,
    every constant inside a shape (period, centre, width, exponent) is told as well, and only the
    amplitudes are unknown: no method can be expected to do better. With ``nonlinear=True`` those
    constants are unknown too, and the fit starts from their true values.
    """
    x, branch = data.standard_nm / chain.range_nm, data.X[:, 1]
    target = (data.standard_nm - data.X[:, 0]) / chain.range_nm
    drift = _unit_drift(chain, x.size)

    def columns(terms: tuple[Term, ...]) -> FloatArray:
        return np.column_stack([term.unit(x, branch) for term in terms] + drift)

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
    if np.isinf(noise.freedom) and noise.wild == 0.0:
        return np.asarray(amplitudes)
    for _ in range(100):
        root = np.sqrt(noise.weights(target - matrix @ amplitudes))
        amplitudes = np.linalg.lstsq(matrix * root[:, None], target * root, rcond=None)[0]
    return np.asarray(amplitudes)
