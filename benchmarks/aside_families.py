"""Families of chains kept aside: written before the models were changed, looked at afterwards.

Each is written down from the mechanics that its docstring names, not from what a model can hold.
Nothing is tuned to their results; the benchmark reports them apart.
"""

from __future__ import annotations

import numpy as np

from benchmarks.chain_noise import Noise
from benchmarks.chain_shapes import SHAPES, FloatArray, Term, draw_sign, one_sided

__all__ = ["ASIDE", "ASIDE_NOISE"]


def _soft_contact(x: FloatArray, _branch: FloatArray, side: float, cubic: float) -> FloatArray:
    """Deflection d of a soft contact with cubic stiffness, d + cubic d³ = load, 1 at full scale."""
    load = one_sided(x, side)
    full = float(_cubic_root(np.ones(1), cubic)[0])
    return side * _cubic_root(load, cubic) / full


def _cubic_root(load: FloatArray, cubic: float) -> FloatArray:
    """Solve d + cubic d³ = load (Cardano, in hyperbolic functions)."""
    scale = 2.0 * np.sqrt(1.0 / (3.0 * cubic))
    return np.asarray(scale * np.sinh(np.arcsinh(1.5 * load * np.sqrt(3.0 * cubic)) / 3.0))


def _stribeck(
    x: FloatArray, _branch: FloatArray, width: float, decay: float, excess: float
) -> FloatArray:
    """Friction that reverses with the torque: static at first, falling to its Coulomb value."""
    size = np.abs(x)
    return np.sign(x) * -np.expm1(-size / width) * (1.0 + excess * np.exp(-size / decay))


def _worn_ripple(
    x: FloatArray, branch: FloatArray, order: float, gap: float, wear: float, quadrature: float
) -> FloatArray:
    """Ripple of a worn spline: stronger under load on the worn flank, shifted by its clearance."""
    place = x - 0.5 * gap * branch * np.sign(x) * (1.0 - np.minimum(np.abs(x), 1.0))
    strength = np.where(x > 0, 0.4 + wear * np.abs(x), 0.4)
    return np.asarray(strength * np.sin(2.0 * np.pi * order * place + 0.5 * np.pi * quadrature))


def _preisach(x: FloatArray, branch: FloatArray, side: float, spread: float) -> FloatArray:
    """Half the loop of relays whose thresholds are exponentially distributed, closed at both ends.

    Relays with a lower threshold below x and an upper one above it are on only on the way back.
    """
    size = np.minimum(one_sided(x, side), 1.0)
    share = np.expm1(-size / spread) / np.expm1(-1.0 / spread)
    return np.where(np.sign(x) == side, 4.0 * side * branch * share * (1.0 - share), 0.0)


def _creep(x: FloatArray, branch: FloatArray, side: float, lag: float) -> FloatArray:
    """Part of the load that follows with a lag (of a leg), loaded and unloaded at an even rate."""
    size = np.minimum(one_sided(x, side), 1.0)
    up = size + lag * np.expm1(-size / lag)
    reached = 1.0 + lag * np.expm1(-1.0 / lag)
    down = size + lag + (reached - 1.0 - lag) * np.exp(-(1.0 - size) / lag)
    return side * np.where(np.sign(x) == side, np.where(branch > 0, up, down), 0.0)


SHAPES |= {
    "soft-contact": _soft_contact,
    "stribeck": _stribeck,
    "worn-ripple": _worn_ripple,
    "preisach": _preisach,
    "creep": _creep,
}


def _offset(rng: np.random.Generator) -> Term:
    return Term("offset", rng.normal(0, 7e-5))


def _both(shape: str, size: float, rng: np.random.Generator, *constants: float) -> list[Term]:
    """Return a shape in both directions, which differ a little."""
    return [
        Term(shape, size * rng.uniform(0.8, 1.2), (side, *constants), 1) for side in (1.0, -1.0)
    ]


def _one_signed_loops(rng: np.random.Generator, rise: float, fall: float) -> list[Term]:
    """Return loops whose error has the same sign in both directions."""
    size = draw_sign(rng) * rng.uniform(1e-4, 3e-4)
    return [Term("one-sided-loop", side * size, (side, rise, fall), 1) for side in (1.0, -1.0)]


def _lagging_loops(
    rng: np.random.Generator, rise: float, fall: float, largest: float = 3e-4
) -> list[Term]:
    """Return loops that lag behind the torque in both directions."""
    return _both("one-sided-loop", rng.uniform(1e-4, largest), rng, rise, fall)


def soft_contact(rng: np.random.Generator) -> list[Term]:
    """Elastomer coupling: contact with cubic stiffness, a loop of one sign, bearing friction."""
    size = draw_sign(rng) * rng.uniform(0.003, 0.008)
    return [
        _offset(rng),
        *_both("soft-contact", size, rng, rng.uniform(0.5, 8.0)),
        Term("error-step", draw_sign(rng) * rng.uniform(1e-4, 4e-4), (rng.uniform(0.003, 0.015),)),
        *_one_signed_loops(rng, rng.uniform(0.7, 1.3), rng.uniform(0.7, 1.3)),
    ]


def proportional_noise(rng: np.random.Generator) -> list[Term]:
    """Smooth chain with ripple whose readings scatter in proportion to the torque."""
    size = draw_sign(rng) * rng.uniform(0.002, 0.006)
    phase, order = rng.uniform(0, 2 * np.pi), rng.uniform(3.0, 7.0)
    ripple = rng.uniform(5e-5, 2e-4)
    return [
        _offset(rng),
        *_both("power", size, rng, 1.0),
        *_both("power", draw_sign(rng) * rng.uniform(0.001, 0.003), rng, rng.uniform(1.5, 3.0)),
        Term("sine", ripple * np.cos(phase), (1.0 / order, 0.0)),
        Term("sine", ripple * np.sin(phase), (1.0 / order, 1.0)),
        *_lagging_loops(rng, 1.0, 1.0),
    ]


def stribeck(rng: np.random.Generator) -> list[Term]:
    """Plain bearings: Stribeck friction at the reversal, stiffness that grows exponentially."""
    size = draw_sign(rng) * rng.uniform(0.003, 0.007)
    friction = (rng.uniform(0.002, 0.008), rng.uniform(0.05, 0.2), rng.uniform(0.5, 2.0))
    return [
        _offset(rng),
        *_both("exponential", size, rng, rng.uniform(0.5, 2.0)),
        Term("stribeck", draw_sign(rng) * rng.uniform(1e-4, 3e-4), friction),
        *_one_signed_loops(rng, rng.uniform(0.5, 1.5), rng.uniform(0.8, 1.2)),
    ]


def worn_spline(rng: np.random.Generator) -> list[Term]:
    """Spline whose one flank is worn: two harmonics that differ by direction and branch."""
    size = draw_sign(rng) * rng.uniform(0.003, 0.006)
    order, gap, wear = rng.uniform(2.5, 6.0), rng.uniform(0.005, 0.03), rng.uniform(0.3, 1.2)
    terms = [_offset(rng), *_both("power", size, rng, rng.uniform(1.0, 1.8))]
    for harmonic, largest in ((1.0, 2.5e-4), (2.0, 1e-4)):
        amplitude, phase = rng.uniform(0.4, 1.0) * largest, rng.uniform(0, 2 * np.pi)
        constants = (harmonic * order, gap, wear)
        terms.append(Term("worn-ripple", amplitude * np.cos(phase), (*constants, 0.0)))
        terms.append(Term("worn-ripple", amplitude * np.sin(phase), (*constants, 1.0)))
    width = rng.uniform(0.004, 0.02)
    return [*terms, Term("algebraic-step", draw_sign(rng) * rng.uniform(1e-4, 3e-4), (width,))]


def preisach(rng: np.random.Generator) -> list[Term]:
    """Magnetic or frictional parts that switch at distributed thresholds, saturating coupling."""
    size = draw_sign(rng) * rng.uniform(0.003, 0.007)
    return [
        _offset(rng),
        *_both("saturation", size, rng, rng.uniform(0.5, 2.0)),
        *_both("preisach", rng.uniform(1.5e-4, 5e-4), rng, rng.uniform(0.15, 1.0)),
        Term("rational-step", draw_sign(rng) * rng.uniform(1e-4, 3e-4), (rng.uniform(3e-3, 2e-2),)),
    ]


def lagging(rng: np.random.Generator) -> list[Term]:
    """Equal quadratic in both directions, and a lag behind the torque, widest at small torques."""
    return [
        _offset(rng),
        Term("whole-power", draw_sign(rng) * rng.uniform(0.001, 0.005), (1.0,), 1),
        Term("whole-power", draw_sign(rng) * rng.uniform(0.0005, 0.003), (2.0,), 1),
        *_lagging_loops(rng, rng.uniform(0.25, 0.5), rng.uniform(0.7, 1.3), 5e-4),
    ]


def viscoelastic(rng: np.random.Generator) -> list[Term]:
    """Transducer with creep: part of the load is indicated with a lag."""
    size = draw_sign(rng) * rng.uniform(0.002, 0.006)
    return [
        _offset(rng),
        *_both("power", size, rng, rng.uniform(1.0, 2.0)),
        *_both("creep", draw_sign(rng) * rng.uniform(3e-4, 8e-4), rng, rng.uniform(0.1, 0.8)),
        Term("rational-step", draw_sign(rng) * rng.uniform(1e-4, 3e-4), (rng.uniform(3e-3, 2e-2),)),
    ]


def room_cycle(rng: np.random.Generator) -> list[Term]:
    """Quadratic per direction in a room whose heating cycles while the chain is calibrated."""
    size = draw_sign(rng) * rng.uniform(0.002, 0.005)
    return [
        Term("offset", 0.0),
        *_both("power", size, rng, 1.0),
        *_both("power", draw_sign(rng) * rng.uniform(0.001, 0.003), rng, 2.0),
        Term("smooth-step", draw_sign(rng) * rng.uniform(1e-4, 4e-4), (rng.uniform(3e-3, 2e-2),)),
        *_lagging_loops(rng, 1.0, 1.0),
    ]


ASIDE = {
    "soft-contact": soft_contact,
    "proportional-noise": proportional_noise,
    "stribeck": stribeck,
    "worn-spline": worn_spline,
    "preisach": preisach,
    "lagging": lagging,
    "viscoelastic": viscoelastic,
    "room-cycle": room_cycle,
}
"""Families by name."""


def _growing(rng: np.random.Generator) -> Noise:
    return Noise(share=rng.uniform(2.0, 8.0))


def _slightly_growing(rng: np.random.Generator) -> Noise:
    return Noise(growth=rng.uniform(0.3, 1.5))


def _tailed(_rng: np.random.Generator) -> Noise:
    return Noise(freedom=5.0)


def _cycling(rng: np.random.Generator) -> Noise:
    return Noise(drift=draw_sign(rng) * rng.uniform(5e-5, 2e-4), cycles=rng.uniform(0.7, 2.5))


ASIDE_NOISE = {
    "proportional-noise": _growing,
    "lagging": _slightly_growing,
    "viscoelastic": _tailed,
    "room-cycle": _cycling,
}
"""Noise of families whose noise isn't even and normal."""
