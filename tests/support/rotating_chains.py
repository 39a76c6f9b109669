"""Synthetic chains that turn, with a known truth, each defined by a family and a seed.

A chain reads ``reading = torque - A(torque, branch) + e``, where A is a static chain's additional
torque (`tests.support.chains`) and e what temperature, speed, acceleration and time add. It is all
written down from what data sheets and textbooks say of transducers and bearings; nothing comes from
the simulated bench. Both are sums of terms with an amplitude, so that the bound ("known form") is a
fit that is told every shape and every constant in it and looks for the amplitudes only.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from tests.support.chain_shapes import FloatArray
from tests.support.chains import Chain, make_chain, path

__all__ = [
    "KEPT_ASIDE",
    "NOISE",
    "ROTATING_FAMILIES",
    "Measured",
    "RotatingChain",
    "State",
    "Term",
    "known_form",
    "make_rotating_chain",
]

RANGE_NM = 50.0
NOISE = 1.5e-4
"""Standard deviation of every reading, share of full scale."""
REFERENCE_C = 23.0
EMPTY_C = (12.0, 23.0, 38.0)
RATE_HZ = 50.0
LARGEST_RPM = 1200.0
STEEPEST_RPM_PER_S = 300.0
JERK_S = 0.2
"""Time in which a drive takes up a ramp."""
RPM = 2.0 * np.pi / 60.0


@dataclass(frozen=True)
class State:
    """Under which circumstances a torque is read; arrays of one length."""

    share: FloatArray
    branch: FloatArray
    speed_rpm: FloatArray
    temperature_c: FloatArray
    acceleration_rad_s2: FloatArray
    time_s: FloatArray

    def at(self, rows: FloatArray | slice) -> State:
        """Return some rows."""
        return State(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


Shape = Callable[[State], FloatArray]


@dataclass(frozen=True)
class Term:
    """One term of what turning and temperature add: an amplitude (share of full scale), a shape."""

    name: str
    amplitude: float
    shape: Shape


@dataclass(frozen=True)
class Measured:
    """Readings under known circumstances, with the true torque."""

    state: State
    reading_nm: FloatArray
    torque_nm: FloatArray


@dataclass(frozen=True)
class RotatingChain:
    """A chain whose reading is known for every torque, speed, temperature and acceleration."""

    family: str
    seed: int
    static: Chain
    terms: tuple[Term, ...]
    range_nm: float = RANGE_NM

    def reading(self, state: State) -> FloatArray:
        """Noise-free reading, N·m."""
        torque = self.range_nm * state.share
        turning = sum((t.amplitude * t.shape(state) for t in self.terms), np.zeros(torque.size))
        return self.static.reading(torque, state.branch) + self.range_nm * turning

    def _measured(self, state: State, what: int, noisy: bool = True) -> Measured:
        rng = self._generator(what)
        noise = NOISE * self.range_nm * rng.standard_normal(state.share.size)
        read = self.reading(state) + (noise if noisy else 0.0)
        return Measured(state, read, self.range_nm * state.share)

    def _generator(self, what: int) -> np.random.Generator:
        return np.random.default_rng([zlib.crc32(self.family.encode()), self.seed, 11, what])

    def calibration(self) -> Measured:
        """100 static points at 23 °C, 20 each at two other temperatures and at two speeds."""
        rng = self._generator(1)
        signs = rng.choice([-1.0, 1.0], 2)
        parts = [
            (100, REFERENCE_C, 0.0),
            (20, EMPTY_C[0], 0.0),
            (20, EMPTY_C[2], 0.0),
            (20, REFERENCE_C, signs[0] * 300.0),
            (20, REFERENCE_C, signs[1] * 900.0),
        ]
        states = []
        for points, celsius, speed in parts:
            torque, branch, _ = path(points, 1.0)
            ones = np.ones(points)
            warmth = celsius + rng.uniform(-0.2, 0.2, points)
            # long run in: a calibration takes its time
            states.append(State(torque, branch, speed * ones, warmth, 0.0 * ones, 1e5 * ones))
        return self._measured(_joined(states), 2)

    def empty_run(self, celsius: float) -> Measured:
        """Nothing mounted: through all speeds in both directions, gentle and steep ramps."""
        rng = self._generator(3 + int(celsius))
        speed = _followed(_empty_targets(), RATE_HZ)
        time_s = np.arange(speed.size) / RATE_HZ
        nothing = np.zeros(speed.size)
        warmth = celsius + 0.3 * np.sin(2 * np.pi * time_s / 200.0 + rng.uniform(0, 6))
        state = State(nothing, nothing, speed, warmth, _acceleration(speed), time_s)
        return self._measured(state, 50 + int(celsius))

    def empty_runs(self) -> list[Measured]:
        """Return the empty runs at all temperatures."""
        return [self.empty_run(celsius) for celsius in EMPTY_C]

    def use(self, *, noisy: bool) -> Measured:
        """Random trajectories of torque, speed and temperature over everything allowed."""
        rng = self._generator(100)
        targets = [
            (
                rng.uniform(-1, 1) * LARGEST_RPM,
                rng.uniform(0.1, 1.0) * STEEPEST_RPM_PER_S,
                rng.uniform(0.5, 3.0),
            )
            for _ in range(120)
        ]
        speed = _followed(targets, RATE_HZ)
        time_s = np.arange(speed.size) / RATE_HZ
        torque, branch = _torque_trajectory(time_s.size, rng)
        knots = rng.uniform(10.0, 50.0, 30)
        knots[:4] = (10.0, 50.0, 20.0, 40.0)
        warmth = np.interp(
            np.linspace(0, knots.size - 1, time_s.size), np.arange(knots.size), knots
        )
        state = State(torque, branch, speed, warmth, _acceleration(speed), time_s)
        return self._measured(state, 101, noisy)


def _joined(states: list[State]) -> State:
    names = State.__dataclass_fields__
    return State(*(np.concatenate([getattr(s, name) for s in states]) for name in names))


def _empty_targets() -> list[tuple[float, float, float]]:
    """Speed (1/min), slope (1/min per s) and time held (s), one after the other."""
    targets = [(0.0, 100.0, 4.0)]
    for sign in (1.0, -1.0):
        sizes = (10, 20, 40, 80, 150, 300, 500, 700, 900, 1050, 1200)
        targets += [(sign * size, 60.0, 2.0) for size in sizes]
        targets.append((0.0, 300.0, 2.0))
        targets.append((sign * 1200.0, 300.0, 2.0))
        targets.append((0.0, 60.0, 2.0))
    return targets


def _followed(targets: list[tuple[float, float, float]], rate_hz: float) -> FloatArray:
    speed, pieces = 0.0, [np.zeros(1)]
    for target, slope, held_s in targets:
        count = int(np.ceil(abs(target - speed) / slope * rate_hz))
        if count:
            pieces.append(np.linspace(speed, target, count + 1)[1:])
        pieces.append(np.full(int(held_s * rate_hz), target))
        speed = target
    sharp, width = np.concatenate(pieces), int(JERK_S * rate_hz)
    rounded = np.convolve(np.pad(sharp, width, mode="edge"), np.full(width, 1.0 / width), "same")
    return np.asarray(rounded[width:-width])


def _acceleration(speed_rpm: FloatArray) -> FloatArray:
    """Of the shaft at each sample, rad/s²; files don't state it."""
    return np.asarray(RPM * np.gradient(speed_rpm) * RATE_HZ)


def _torque_trajectory(count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Torque (share) from one random value to the next, and the branch that follows from it."""
    knots = rng.uniform(-1, 1, count // 400 + 2)
    torque = np.interp(np.linspace(0, knots.size - 1, count), np.arange(knots.size), knots)
    branch = np.where(np.gradient(np.abs(torque)) >= 0, 1.0, -1.0)
    return torque, branch


def make_rotating_chain(family: str, seed: int) -> RotatingChain:
    """Draw a chain: same family and seed, same chain."""
    rng = np.random.default_rng([zlib.crc32(family.encode()), seed, 4])
    static, draw = ROTATING_FAMILIES[family]
    return RotatingChain(
        family, seed, make_chain(static, 9000 + seed, RANGE_NM), tuple(draw(rng)), RANGE_NM
    )


# --- the bound ---


def known_form(chain: RotatingChain, *measured: Measured) -> RotatingChain:
    """Return the chain with all amplitudes fitted to what was measured, all shapes told."""
    rows, target = [], []
    for each in measured:
        x, branch = each.state.share, each.state.branch
        columns = [-term.unit(x, branch) for term in chain.static.terms]
        columns += [term.shape(each.state) for term in chain.terms]
        rows.append(np.column_stack(columns))
        target.append((each.reading_nm - each.torque_nm) / chain.range_nm)
    solved = np.linalg.lstsq(np.concatenate(rows), np.concatenate(target), rcond=None)[0]
    fixed = len(chain.static.terms)
    static = replace(
        chain.static,
        terms=tuple(
            replace(t, amplitude=float(a))
            for t, a in zip(chain.static.terms, solved[:fixed], strict=True)
        ),
    )
    terms = tuple(
        replace(t, amplitude=float(a)) for t, a in zip(chain.terms, solved[fixed:], strict=True)
    )
    return replace(chain, static=static, terms=terms)


def torque_by(chain: RotatingChain, measured: Measured) -> FloatArray:
    """Return the torque by a chain's form from readings: what it adds, at the true torque."""
    added = chain.reading(measured.state) - measured.torque_nm
    return measured.reading_nm - added


# --- families: shapes of temperature, speed, load, time ---


def _warmth(state: State) -> FloatArray:
    return (state.temperature_c - REFERENCE_C) / 10.0


def _turns(state: State) -> FloatArray:
    return np.sign(np.where(np.abs(state.speed_rpm) > 0.5, state.speed_rpm, 0.0))


def _size(state: State) -> FloatArray:
    return np.abs(state.speed_rpm) / 1000.0


def _thin(state: State, per_k: float) -> FloatArray:
    """Viscosity over temperature, 1 at 23 °C."""
    return np.exp(-per_k * (state.temperature_c - REFERENCE_C))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _inertia(rng: np.random.Generator) -> Term:
    return Term("inertia", rng.uniform(8e-4, 2e-3), lambda s: s.acceleration_rad_s2 / (300 * RPM))


def _warm_quadratic(rng: np.random.Generator) -> list[Term]:
    return [
        Term("zero/T", _sign(rng) * rng.uniform(4e-4, 8e-4), _warmth),
        Term("zero/T²", _sign(rng) * rng.uniform(2e-5, 8e-5), lambda s: _warmth(s) ** 2),
        Term("span/T", _sign(rng) * rng.uniform(1e-4, 4e-4), lambda s: s.share * _warmth(s)),
        Term("span/T²", _sign(rng) * rng.uniform(0, 4e-5), lambda s: s.share * _warmth(s) ** 2),
    ]


def _smooth(rng: np.random.Generator) -> list[Term]:
    per_k = rng.uniform(0.01, 0.03)
    return [
        *_warm_quadratic(rng),
        Term("zero/n", _sign(rng) * rng.uniform(5e-5, 1.5e-4), _size),
        Term("Coulomb", rng.uniform(3e-5, 1e-4), _turns),
        Term(
            "viscous", rng.uniform(5e-5, 1.5e-4), lambda s: _turns(s) * _size(s) * _thin(s, per_k)
        ),
        _inertia(rng),
    ]


def _power_law(rng: np.random.Generator) -> list[Term]:
    power, per_k = rng.uniform(0.5, 0.8), rng.uniform(0.02, 0.04)
    return [
        *_warm_quadratic(rng),
        Term("zero/n²", _sign(rng) * rng.uniform(5e-5, 1.5e-4), lambda s: _size(s) ** 2),
        Term(
            "lubricant",
            rng.uniform(1e-4, 2e-4),
            lambda s: _turns(s) * _size(s) ** power * _thin(s, per_k),
        ),
        Term("load", rng.uniform(5e-5, 2e-4), lambda s: _turns(s) * np.abs(s.share)),
        _inertia(rng),
    ]


def _loaded(rng: np.random.Generator) -> list[Term]:
    power, per_k = rng.uniform(1.1, 1.5), rng.uniform(0.01, 0.03)
    return [
        *_smooth(rng)[:4],
        Term("zero/n", _sign(rng) * rng.uniform(5e-5, 1.5e-4), _size),
        Term("Coulomb", rng.uniform(3e-5, 1e-4), lambda s: _turns(s) * _thin(s, 0.5 * per_k)),
        Term("viscous", rng.uniform(5e-5, 1.5e-4), lambda s: _turns(s) * _size(s)),
        Term("load", rng.uniform(1e-4, 3e-4), lambda s: _turns(s) * np.abs(s.share) ** power),
        Term("span/n", _sign(rng) * rng.uniform(5e-5, 1.5e-4), lambda s: s.share * _size(s)),
        _inertia(rng),
    ]


def _stribeck(rng: np.random.Generator) -> list[Term]:
    width, power, per_k = rng.uniform(20, 120), rng.uniform(0.8, 2.0), rng.uniform(0.01, 0.03)
    return [
        *_warm_quadratic(rng),
        Term("zero/n", _sign(rng) * rng.uniform(3e-5, 1e-4), _size),
        Term("Coulomb", rng.uniform(5e-5, 1e-4), _turns),
        Term(
            "Stribeck",
            rng.uniform(5e-5, 1.5e-4),
            lambda s: _turns(s) * np.exp(-((np.abs(s.speed_rpm) / width) ** power)),
        ),
        Term(
            "viscous", rng.uniform(5e-5, 1.5e-4), lambda s: _turns(s) * _size(s) * _thin(s, per_k)
        ),
        _inertia(rng),
    ]


def _running_in(rng: np.random.Generator) -> list[Term]:
    power, per_k, time_s = rng.uniform(0.6, 1.2), rng.uniform(0.01, 0.03), rng.uniform(20, 200)

    def drag(s: State) -> FloatArray:
        return np.asarray(_turns(s) * (0.5 + _size(s) ** power) * _thin(s, per_k))

    return [
        *_warm_quadratic(rng),
        Term("zero/n", _sign(rng) * rng.uniform(3e-5, 1e-4), _size),
        Term("drag", rng.uniform(5e-5, 1.5e-4), drag),
        Term("running in", rng.uniform(3e-5, 1e-4), lambda s: drag(s) * np.exp(-s.time_s / time_s)),
        _inertia(rng),
    ]


def _arctangent(rng: np.random.Generator) -> list[Term]:
    middle, width = rng.uniform(18, 32), rng.uniform(15, 30)
    bent = rng.uniform(18, 32), rng.uniform(15, 30)

    def turned(s: State, at: float, over: float) -> FloatArray:
        return np.asarray(
            np.arctan((s.temperature_c - at) / over) - np.arctan((REFERENCE_C - at) / over)
        )

    return [
        Term("zero/T", _sign(rng) * rng.uniform(8e-4, 1.5e-3), lambda s: turned(s, middle, width)),
        Term("span/T", _sign(rng) * rng.uniform(2e-4, 6e-4), lambda s: s.share * turned(s, *bent)),
        *_smooth(rng)[4:],
    ]


def _churned(rng: np.random.Generator) -> list[Term]:
    """Draw oil of Vogel viscosity that is churned, and a film that builds under load."""
    steep, asymptote = rng.uniform(500, 900), rng.uniform(90, 110)
    film_rpm, knee = rng.uniform(200, 600), rng.uniform(25, 40)

    def oil(s: State) -> FloatArray:
        cold = steep / (s.temperature_c + asymptote) - steep / (REFERENCE_C + asymptote)
        return np.asarray(np.exp(cold))

    def saturating(s: State, over: float) -> FloatArray:
        warm = s.temperature_c - REFERENCE_C
        return np.asarray(1.0 - np.exp(-warm / over))

    return [
        Term("zero/T", _sign(rng) * rng.uniform(4e-4, 8e-4), _warmth),
        Term("zero, settling", _sign(rng) * rng.uniform(1e-4, 4e-4), lambda s: saturating(s, knee)),
        Term("span/T", _sign(rng) * rng.uniform(2e-4, 6e-4), lambda s: s.share * saturating(s, 60)),
        Term("zero/n", _sign(rng) * rng.uniform(5e-5, 1.5e-4), lambda s: _size(s) ** 1.5),
        Term("viscous", rng.uniform(5e-5, 1.5e-4), lambda s: _turns(s) * _size(s) * oil(s)),
        Term(
            "churning", rng.uniform(3e-5, 1e-4), lambda s: _turns(s) * _size(s) ** 2 * oil(s) ** 0.3
        ),
        Term(
            "load",
            rng.uniform(5e-5, 2e-4),
            lambda s: _turns(s) * np.abs(s.share) * np.exp(-np.abs(s.speed_rpm) / film_rpm),
        ),
        _inertia(rng),
    ]


def _sealed(rng: np.random.Generator) -> list[Term]:
    """Draw a lip seal: it softens, grips at low speed and drags more in one direction."""
    grip_rpm, slow_rpm = rng.uniform(15, 90), rng.uniform(30, 150)
    softening, more = rng.uniform(0.005, 0.015), rng.uniform(0.05, 0.25) * _sign(rng)

    def seal(s: State) -> FloatArray:
        soft = 1.0 - softening * (s.temperature_c - REFERENCE_C)
        return np.asarray(_turns(s) * soft * (1.0 + more * (_turns(s) > 0)))

    def grip(s: State) -> FloatArray:
        return np.asarray(seal(s) / (1.0 + (s.speed_rpm / grip_rpm) ** 2))

    return [
        *_warm_quadratic(rng),
        Term("zero/T³", _sign(rng) * rng.uniform(2e-6, 1e-5), lambda s: _warmth(s) ** 3),
        Term("zero/n", _sign(rng) * rng.uniform(3e-5, 1e-4), _size),
        Term("seal", rng.uniform(5e-5, 1.5e-4), seal),
        Term("grip", rng.uniform(3e-5, 1.5e-4), grip),
        Term(
            "film",
            rng.uniform(1e-5, 5e-5),
            lambda s: seal(s) * np.log1p(np.abs(s.speed_rpm) / slow_rpm),
        ),
        Term("load", rng.uniform(5e-5, 2e-4), lambda s: _turns(s) * np.maximum(s.share, 0.0)),
        _inertia(rng),
    ]


ROTATING_FAMILIES: dict[str, tuple[str, Callable[[np.random.Generator], list[Term]]]] = {
    "smooth": ("plain", _smooth),
    "power-law drag": ("realistic", _power_law),
    "load and span": ("quadratic", _loaded),
    "Stribeck": ("realistic", _stribeck),
    "running-in": ("quadratic", _running_in),
    "arctangent": ("realistic", _arctangent),
    "churned oil": ("plain", _churned),
    "lip seal": ("realistic", _sealed),
}
"""Static family, and what temperature and rotation add."""
KEPT_ASIDE = ("churned oil", "lip seal")
"""Families written after the models, whose results changed nothing in them."""
NO_BASIS = ("Stribeck", "running-in", "arctangent", "churned oil", "lip seal")
"""Families with a shape that no basis holds."""
