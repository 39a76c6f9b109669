"""Basis functions of temperature, speed, load, acceleration and time.

Physical forms (Coulomb, powers of the speed, Stribeck's fall at low speeds, viscosity that falls
about exponentially with temperature) and local bumps for deviations from these. Speeds are relative
to the largest measured speed, so that no form needs a constant in rpm: the basis contains Stribeck
falls with widths from a hundredth of that speed to the speed itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from torquebench.chain.effects.rotation import STANDSTILL_RPM
from torquebench.chain.readings import FloatArray

_KELVIN = 20.0
"""Unit of temperature changes, K."""
_FALLS = 2.0 ** -np.arange(1, 8)
_POWERS = (0.5, 1.0, 1.5, 2.0)
_SPEED_CENTRES, _SPEED_WIDTH = np.linspace(0.0, 1.0, 9), 0.15
_WARM_CENTRES, _WARM_WIDTH = np.arange(-40.0, 41.0, 10.0), 13.0
_CREEPS_S = (10.0, 100.0)
_WAVES, _WANDER_S = 12, 100.0
"""Number of waves in the random walk of each run's zero, and the time in s over which it changes by
its scale."""
_VISCOSITIES = (0.02, 0.05)  # 1/K, as for oils and greases


@dataclass(frozen=True, eq=False)
class Circumstances:
    """Conditions under which readings were taken; arrays of one length.

    Parameters
    ----------
    share : float64 array of shape (n,)
        True torque as a share of full scale.
    speed : float64 array of shape (n,)
        Speed as a share of the largest measured speed.
    turning : float64 array of shape (n,)
        Direction of the speed, 0 at standstill.
    warmth_k : float64 array of shape (n,)
        Temperature, less that of the static curve.
    zeroed_k : float64 array of shape (n,)
        Temperature difference at the time of the zero that is subtracted from the reading, K.
    acceleration, time_s : float64 array of shape (n,)
        Acceleration as a share of the largest measured one.
    branch : float64 array of shape (n,)
    run : float64 array of shape (n,)
        Number of the empty run from 1, 0 for points of a calibration.
    since : float64 array of shape (n,)
        Time since the run began, s.
    """

    share: FloatArray
    speed: FloatArray
    turning: FloatArray
    warmth_k: FloatArray
    zeroed_k: FloatArray
    acceleration: FloatArray
    time_s: FloatArray
    branch: FloatArray
    run: FloatArray
    since: FloatArray

    @classmethod
    def of(cls, size: int, **known: FloatArray | float) -> Circumstances:
        """Return conditions that are 0 except for the given ones."""
        values = {
            item.name: np.broadcast_to(np.asarray(known.get(item.name, 0.0), float), (size,))
            for item in fields(cls)
        }
        return cls(**values)

    def __len__(self) -> int:
        return int(self.share.size)

    def at(self, rows: slice | NDArray[np.intp]) -> Circumstances:
        """Return the conditions of some rows."""
        return Circumstances(*(getattr(self, item.name)[rows] for item in fields(self)))


def direction(speed_rpm: FloatArray) -> FloatArray:
    """Return the direction of rotation, 0 at standstill."""
    return np.where(np.abs(speed_rpm) > STANDSTILL_RPM, np.sign(speed_rpm), 0.0)


Columns = Callable[[Circumstances], FloatArray]


@dataclass(frozen=True)
class Block:
    """Columns whose weights have one common scale.

    Parameters
    ----------
    group : str
        The table to which it contributes, "" for effects of the calibration only.
    columns : callable
        Function from conditions to float64 array of shape (n, k).
    scale : float
        Typical size of the weights, in 1e-4 of full scale.
    spread : float
        Standard deviation of that size's logarithm between chains.
    """

    name: str
    group: str
    columns: Columns
    scale: float
    spread: float = 1.5


def _stack(*columns: FloatArray) -> FloatArray:
    return np.column_stack(columns)


def _warm(c: Circumstances, power: int) -> FloatArray:
    """Power of the difference to the static curve's temperature, in units of `_KELVIN`."""
    return (c.warmth_k / _KELVIN) ** power


def _warm_bumps(c: Circumstances) -> FloatArray:
    """Local bumps over temperature, less their value at the static curve's temperature."""
    bumps = np.exp(-0.5 * ((c.warmth_k[:, None] - _WARM_CENTRES) / _WARM_WIDTH) ** 2)
    return np.asarray(bumps - np.exp(-0.5 * (_WARM_CENTRES / _WARM_WIDTH) ** 2))


def _since_zero(columns: Columns) -> Columns:
    """Return the columns' change since the zero was taken."""
    return lambda c: columns(c) - columns(replace(c, warmth_k=c.zeroed_k))


def _speed_bumps(c: Circumstances) -> FloatArray:
    """Local bumps over the absolute speed."""
    size = np.abs(c.speed)[:, None]
    return np.asarray(np.exp(-0.5 * ((size - _SPEED_CENTRES) / _SPEED_WIDTH) ** 2))


def _powers(c: Circumstances) -> FloatArray:
    return _stack(*(np.abs(c.speed) ** power for power in _POWERS))


def _falls(c: Circumstances) -> FloatArray:
    ratio = np.abs(c.speed)[:, None] / _FALLS
    return np.concatenate([np.exp(-ratio), np.exp(-(ratio**2))], axis=1)


def _thinning(c: Circumstances) -> FloatArray:
    """Viscosity over temperature, less its value at the static curve's temperature."""
    limited = np.clip(c.warmth_k, -60.0, 60.0)
    return _stack(*(np.exp(-rate * limited) - 1.0 for rate in _VISCOSITIES))


def _times(columns: FloatArray, others: FloatArray) -> FloatArray:
    product = columns[:, :, None] * others[:, None, :]
    return np.asarray(product.reshape(columns.shape[0], -1))


def _forms(c: Circumstances) -> FloatArray:
    return _stack(np.ones(len(c)), _powers(c), _falls(c))


def _static_columns(c: Circumstances) -> FloatArray:
    """Return columns for errors of the preliminary static curve."""
    x, side = c.share, np.sign(c.share)
    waves = [f(k * np.pi * x) for k in range(1, 5) for f in (np.sin, np.cos)]
    loops = [c.branch * side * (1 - np.abs(x)) ** k for k in (1, 2)]
    return _stack(np.ones(len(c)), x, np.abs(x), x**2, x * np.abs(x), x**3, *waves, *loops)


def _on(factor: Columns | str, columns: Columns) -> Columns:
    """Return columns times a factor: a quantity by its name, or the first of other columns."""

    def product(c: Circumstances) -> FloatArray:
        of = getattr(c, factor) if isinstance(factor, str) else factor(c)
        return np.asarray(np.reshape(of, (len(c), -1))[:, :1] * columns(c))

    return product


def _turns(c: Circumstances) -> FloatArray:
    return np.abs(c.turning)


def _drag_on_load(c: Circumstances) -> FloatArray:
    size = np.abs(c.share)
    return _stack(size, size * np.abs(c.speed), size * _falls(c)[:, 2], size * _falls(c)[:, 4])


def _bent_drag_on_load(c: Circumstances) -> FloatArray:
    """Return columns for a drag that isn't proportional to the load."""
    size = np.abs(c.share)
    return _stack(size**2, size**0.5)


def _zeros_of_runs(runs: int) -> Columns:
    """Return columns for each run's zero by creep and remanence: constant and decaying."""

    def columns(c: Circumstances) -> FloatArray:
        """Return a constant for each run, and constants that fade after its start."""
        own = c.run[:, None] == np.arange(1, runs + 1)
        fading = np.exp(-c.since[:, None] / np.array(_CREEPS_S))
        return np.concatenate(
            [own, *(own * fading[:, k : k + 1] for k in range(len(_CREEPS_S)))], axis=1
        )

    return columns


def _random_walks(lengths_s: FloatArray) -> Columns:
    """Return columns for the drift of each run's zero: the largest parts of a random walk.

    They are its Karhunen-Loève expansion, the best approximation with a given number of waves. The
    temperature hardly changes within a run: without these columns, the slow drift would be fitted
    as a steep change of the zero over temperature.
    """
    waves = (np.arange(_WAVES) + 0.5) * np.pi
    sizes = np.sqrt(2.0 * np.maximum(lengths_s, 1e-9) / _WANDER_S)

    def columns(c: Circumstances) -> FloatArray:
        """Return sine waves over each run's length, which are zero in the other runs."""
        waves_of_runs = np.zeros((len(c), lengths_s.size, _WAVES))
        for run, (length_s, size) in enumerate(zip(lengths_s, sizes, strict=True)):
            rows = c.run == run + 1
            phase = c.since[rows, None] / max(length_s, 1e-9) * waves
            waves_of_runs[rows, run] = size * np.sin(phase) / waves
        return waves_of_runs.reshape(len(c), -1)

    return columns


def blocks(lengths_s: Sequence[float]) -> tuple[Block, ...]:
    """Return all blocks of columns for empty runs of given lengths."""

    def warm(power: int) -> Columns:
        return lambda c: _stack(_warm(c, power))

    one: Columns = lambda c: np.ones((len(c), 1))  # noqa: E731
    return (
        Block("zero, linear in temperature", "zero", _since_zero(warm(1)), 10.0),
        Block("zero, square of temperature", "zero", _since_zero(warm(2)), 2.0),
        Block("zero, bumps over temperature", "zero", _since_zero(_warm_bumps), 0.5, 1.0),
        Block("span, linear in temperature", "span", _on("share", warm(1)), 5.0),
        Block("span, square of temperature", "span", _on("share", warm(2)), 1.0),
        Block("span, bumps over temperature", "span", _on("share", _warm_bumps), 0.3, 1.0),
        Block("zero, powers of speed", "even", _on(_turns, _powers), 0.5),
        Block("zero, bumps over speed", "even", _on(_turns, _speed_bumps), 0.1),
        Block("zero, falls over speed", "even", _on(_turns, _falls), 0.05),
        Block(
            "zero, speed and temperature",
            "even",
            _on(_turns, lambda c: _times(_powers(c), _thinning(c))),
            0.1,
        ),
        Block("drag, Coulomb", "odd", _on("turning", one), 0.7),
        Block("drag, powers of speed", "odd", _on("turning", _powers), 0.7),
        Block("drag, Stribeck", "odd", _on("turning", _falls), 0.3),
        Block("drag, bumps over speed", "odd", _on("turning", _speed_bumps), 0.1),
        Block(
            "drag, viscosity", "odd", _on("turning", lambda c: _times(_forms(c), _thinning(c))), 0.3
        ),
        Block(
            "drag, bumps over speed and temperature",
            "odd",
            _on("turning", lambda c: _times(_speed_bumps(c), _warm_bumps(c)[:, 1::2])),
            0.05,
        ),
        Block("drag over load", "load", _on("turning", _drag_on_load), 0.3),
        Block("drag over load, bent", "load", _on("turning", _bent_drag_on_load), 0.1),
        Block(
            "span over speed",
            "speed span",
            _on(_turns, lambda c: c.share[:, None] * _powers(c)[:, 1::2]),
            0.15,
        ),
        Block("inertia", "inertia", lambda c: c.acceleration[:, None], 10.0, 2.5),
        Block("zero of empty runs", "", lambda c: np.sign(c.run)[:, None], 1.0),
        Block("zero of each empty run", "", _zeros_of_runs(len(lengths_s)), 0.1, 1.0),
        Block("wandering zero of empty runs", "", _random_walks(np.array(lengths_s)), 0.3),
        Block("static curve", "", _on(lambda c: 1.0 - np.sign(c.run), _static_columns), 0.3),
    )


def running_in_columns(time_s: float) -> Columns:
    """Return columns for a drag that decays with a time constant."""

    def columns(c: Circumstances) -> FloatArray:
        """Return terms of the speed that fade with time, opposite in both directions."""
        share = c.turning * np.exp(-np.maximum(c.time_s, 0.0) / time_s)
        return share[:, None] * _stack(np.ones(len(c)), _powers(c)[:, :2])

    return columns
