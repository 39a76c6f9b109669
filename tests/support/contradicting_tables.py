"""Calibration tables of chains and of other laboratories, and faults in them.

Healthy tables are those of the families of `tests.support.chains` and of `STRANGERS`, which imitate
other laboratories: weights with errors of their own, aftereffect, dry friction, coarse displays,
mounting positions, untared zeros, ramps. The examination was developed on the chains only; the
strangers had no influence on it.

Faults are injected at random rows from the fourth to the third last, with sizes that are uniformly
distributed on a logarithmic scale from 3 U to 30 U, where U (k = 2) is that of a further reading,
estimated from the healthy table.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from tests.support.chains import make_chain

from torquebench.calibration import CalibrationData, Examination, examine_table, infer_branch

__all__ = [
    "FAULTS",
    "LARGEST",
    "POINTS",
    "STRANGERS",
    "Trial",
    "chain_table",
    "inject",
    "stranger",
    "trial",
]

FloatArray = NDArray[np.float64]
FAULTS = ("zero", "scale", "temporary zero", "sign", "stuck", "row")
LARGEST = 30.0
POINTS = (24, 50, 100)
"""Points of one loop 0 → +FS → 0 → −FS → 0; with two loops, each has 24."""


def chain_table(family: str, seed: int, points: int, loops: int = 1) -> CalibrationData:
    """Return the calibration of a test chain with `points` points in each loop.

    The zero drifts on from loop to loop.
    """
    chain = make_chain(family, seed)
    drawn = [chain.calibration(points, number) for number in range(loops)]
    drift = chain.range_nm * chain.noise.drifted(points)[-1]
    reading = [each.X[:, 0] + number * drift for number, each in enumerate(drawn)]
    series = [each.X[:, 2] + 2 * number for number, each in enumerate(drawn)]
    return CalibrationData(
        np.concatenate(reading),
        np.concatenate([each.standard_nm for each in drawn]),
        np.concatenate(series).astype(np.int64),
        np.concatenate([each.X[:, 1] for each in drawn]).astype(np.int8),
        chain.range_nm,
    )


# ---- tables of other laboratories ---------------------------------------------------------------


def _path(
    steps: Sequence[float], cycles: int = 1, both: bool = True
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return torques that rise from zero and fall back, and the number of each torque's series."""
    rise = np.array([0.0, *steps])
    loop = np.concatenate([rise, rise[-2::-1]])
    whole = [loop * sign for sign in ((1.0, -1.0) if both else (1.0,))]
    torque = np.concatenate(whole * cycles)
    return torque, np.repeat(np.arange(1, cycles * len(whole) + 1), loop.size).astype(np.int64)


def _table(
    torque: FloatArray,
    series: NDArray[np.int64],
    error: FloatArray,
    noise: FloatArray,
    position_deg: FloatArray | None = None,
) -> CalibrationData:
    """Return a table with a range of 1 N·m."""
    reading, branch = torque - error + noise, infer_branch(torque, series)
    return CalibrationData(reading, torque, series, branch, 1.0, position_deg=position_deg)


def _weights(rng: np.random.Generator) -> CalibrationData:
    """Draw a table of weights with errors of their own, on a lever that shortens as it tilts."""
    steps = np.linspace(0.1, 1.0, 10)
    own = dict(
        zip([0.0, *steps.tolist()], [0.0, *np.cumsum(4e-4 * rng.normal(size=10))], strict=True)
    )
    torque, series = _path(steps.tolist(), int(rng.integers(1, 4)))
    error = np.array([np.sign(t) * own[abs(t)] for t in torque]) + 3e-3 * rng.normal() * torque**3
    return _table(torque, series, error, 1.5e-4 * rng.normal(size=torque.size))


def _aftereffect(rng: np.random.Generator) -> CalibrationData:
    """Draw a table of rubber and glue: the reading lags the torque by some steps."""
    torque, series = _path(np.linspace(0.05, 1.0, 20).tolist())
    lag = rng.uniform(1.0, 8.0)
    slow, behind = 0.0, []
    for value in torque:
        slow += (value - slow) / lag
        behind.append(value - slow)
    error = rng.uniform(0.001, 0.01) * np.array(behind) + 0.01 * rng.normal() * torque
    return _table(torque, series, error, 2e-4 * rng.normal(size=torque.size))


def _friction(rng: np.random.Generator) -> CalibrationData:
    """Draw a table of bearings with dry friction: a loop of some per cent that reverses at once."""
    torque, series = _path(np.linspace(0.1, 1.0, 10).tolist(), int(rng.integers(1, 3)))
    branch = infer_branch(torque, series)
    loss = rng.uniform(0.002, 0.02) * (0.3 + np.abs(torque)) * branch * np.sign(torque)
    loss[np.abs(torque) == 1.0] *= rng.uniform(0.8, 1.0)
    return _table(torque, series, loss, 3e-4 * rng.normal(size=torque.size))


def _display(rng: np.random.Generator) -> CalibrationData:
    """Draw a table of a display with a few hundred steps."""
    torque, series = _path(np.linspace(0.05, 1.0, 20).tolist())
    table = _table(
        torque, series, 0.02 * rng.normal() * torque, 1e-3 * rng.normal(size=torque.size)
    )
    step = rng.choice([0.001, 0.002, 0.005])
    return replace(table, reading_nm=step * np.round(table.reading_nm / step))


def _proportional(rng: np.random.Generator) -> CalibrationData:
    """Draw a table with noise of some tenths of a per cent of the torque, almost none at zero."""
    torque, series = _path(np.linspace(0.04, 1.0, 25).tolist())
    noise = (1e-5 + rng.uniform(5e-4, 5e-3) * np.abs(torque)) * rng.normal(size=torque.size)
    return _table(
        torque, series, 0.01 * rng.normal() * torque + 0.005 * torque * np.abs(torque), noise
    )


def _positions(rng: np.random.Generator) -> CalibrationData:
    """Draw a table of three or four mounting positions, each with its own span and zero."""
    steps = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0]
    places = [0.0, 0.0, 120.0, 240.0][: rng.integers(3, 5)]
    torque, series = _path(steps, len(places), both=False)
    position = np.array(places)[series - 1]
    spans = {place: 1e-3 * rng.normal() for place in places}
    zeros = {place: 5e-4 * rng.normal() for place in places}
    error = np.array([spans[p] * t + zeros[p] for p, t in zip(position, torque, strict=True)])
    error += 2e-3 * torque + 1e-3 * torque**2
    return _table(torque, series, error, 5e-5 * rng.normal(size=torque.size), position_deg=position)


def _untared(rng: np.random.Generator) -> CalibrationData:
    """Draw a table with untared zeros of some per cent, different in each series."""
    torque, series = _path(np.linspace(0.1, 1.0, 10).tolist(), 2)
    zeros = 0.05 + 0.02 * rng.normal(size=int(series.max()) + 1)
    error = zeros[series] + 0.003 * torque * np.abs(torque)
    return _table(torque, series, error, 2e-4 * rng.normal(size=torque.size))


def _rising(rng: np.random.Generator) -> CalibrationData:
    """Draw a table of eleven rising points."""
    torque = np.linspace(0.0, 1.0, 11)
    error = 0.01 * rng.normal() + 0.02 * rng.normal() * torque + 0.01 * rng.normal() * torque**2
    return _table(torque, np.ones(11, dtype=np.int64), error, 3e-4 * rng.normal(size=11))


def _few(rng: np.random.Generator) -> CalibrationData:
    """Draw a table of six to ten points up and down."""
    torque, series = _path(np.linspace(0.0, 1.0, int(rng.integers(4, 7)))[1:].tolist(), both=False)
    error = 0.01 * rng.normal() * torque + 0.003 * rng.normal() * torque * (1 - torque)
    return _table(torque, series, error, 5e-4 * rng.normal(size=torque.size))


def _air(rng: np.random.Generator) -> CalibrationData:
    """Draw a table whose zero swings with the air conditioning."""
    torque, series = _path(np.linspace(0.05, 1.0, 20).tolist(), 2)
    time = np.arange(torque.size) / torque.size
    swing = 6e-4 * np.sin(2 * np.pi * (rng.uniform(1.5, 5.0) * time + rng.uniform()))
    return _table(torque, series, swing + 0.004 * torque, 2e-4 * rng.normal(size=torque.size))


def _converter(rng: np.random.Generator) -> CalibrationData:
    """Draw a table of a converter whose code errors repeat over the range."""
    torque, series = _path(np.linspace(0.02, 1.0, 50).tolist())
    width = rng.uniform(0.05, 0.15)
    return _table(
        torque, series, 4e-4 * ((torque / width) % 1.0), 1e-4 * rng.normal(size=torque.size)
    )


def _uneven(rng: np.random.Generator) -> CalibrationData:
    """Draw a table with spans that differ by some per cent, and a step between directions."""
    torque, series = _path(np.linspace(0.1, 1.0, 10).tolist())
    error = np.where(torque > 0, 0.03, -0.02) * rng.uniform(0.3, 1.5) * torque
    error = error + 0.003 * rng.normal() * np.sign(torque)
    return _table(torque, series, error, 2e-4 * rng.normal(size=torque.size))


def _ramp(rng: np.random.Generator) -> CalibrationData:
    """Draw a table of a slow ramp: six hundred points with correlated noise."""
    torque = np.concatenate([np.linspace(0, 1, 300), np.linspace(1, 0, 300)])
    noise = np.zeros(600)
    for k in range(1, 600):
        noise[k] = 0.8 * noise[k - 1] + 2e-4 * rng.normal()
    return _table(
        torque, np.ones(600, dtype=np.int64), 0.01 * torque + 0.002 * np.sin(6 * torque), noise
    )


def _scale(rng: np.random.Generator) -> CalibrationData:
    """Draw a table of an unadjusted amplifier: span wrong by 10 to 30 %, cubic deviation."""
    torque, series = _path(np.linspace(0.1, 1.0, 10).tolist())
    error = rng.choice([-1, 1]) * rng.uniform(0.1, 0.3) * torque + 0.01 * torque**3
    return _table(torque, series, error, 3e-4 * rng.normal(size=torque.size))


def _spikes(rng: np.random.Generator) -> CalibrationData:
    """Draw a table in which two per cent of the readings are outliers."""
    torque, series = _path(np.linspace(0.04, 1.0, 25).tolist())
    noise = 2e-4 * rng.normal(size=torque.size)
    noise += np.where(rng.random(torque.size) < 0.02, 6e-3 * rng.normal(size=torque.size), 0.0)
    return _table(torque, series, 0.004 * torque, noise)


def _clearance(rng: np.random.Generator) -> CalibrationData:
    """Draw a table of a coupling with clearance: the reading stays zero up to some per cent."""
    torque, series = _path(np.linspace(0.05, 1.0, 20).tolist())
    gap = rng.uniform(0.005, 0.02)
    error = np.clip(torque, -gap, gap)
    return _table(torque, series, error, 2e-4 * rng.normal(size=torque.size))


def _scattered(rng: np.random.Generator) -> CalibrationData:
    """Draw a table whose torques are in random order."""
    torque = rng.uniform(-1.0, 1.0, 40)
    error = 0.004 * torque + 0.002 * np.sign(torque) + 0.003 * torque**2
    return _table(torque, np.ones(40, dtype=np.int64), error, 2e-4 * rng.normal(size=40))


def _exact(rng: np.random.Generator) -> CalibrationData:
    """Draw a table without noise, as in a made-up example."""
    torque, series = _path([0.25, 0.5, 0.75, 1.0], int(rng.integers(1, 4)))
    return _table(torque, series, 0.01 * rng.normal() * torque, np.zeros(torque.size))


STRANGERS: dict[str, Callable[[np.random.Generator], CalibrationData]] = {
    "weights": _weights,
    "aftereffect": _aftereffect,
    "friction": _friction,
    "display": _display,
    "proportional": _proportional,
    "positions": _positions,
    "untared": _untared,
    "rising": _rising,
    "few": _few,
    "air": _air,
    "converter": _converter,
    "uneven": _uneven,
    "ramp": _ramp,
    "scale": _scale,
    "spikes": _spikes,
    "clearance": _clearance,
    "scattered": _scattered,
    "exact": _exact,
}
"""Tables as other laboratories make them; the examination wasn't adapted to them."""


def stranger(family: str, seed: int) -> CalibrationData:
    """Return a healthy table of another laboratory."""
    return STRANGERS[family](np.random.default_rng([zlib.crc32(family.encode()), seed]))


# ---- faults -------------------------------------------------------------------------------------


def inject(
    data: CalibrationData, kind: str, size_nm: float, rng: np.random.Generator
) -> tuple[CalibrationData, slice]:
    """Return a table with an injected fault, and the fault's rows."""
    n = len(data)
    first = int(rng.integers(3, n - 2))
    rows, sign = slice(first, n), float(rng.choice([-1, 1]))
    reading, standard = data.reading_nm.copy(), data.standard_nm
    if kind == "zero":
        reading[rows] += sign * size_nm
    elif kind == "scale":
        reading[rows] += sign * size_nm * standard[rows] / np.max(np.abs(standard[rows]))
    elif kind == "row":
        rows = slice(first, first + 1)
        reading[rows] += sign * size_nm
    elif kind == "temporary zero":
        length = int(rng.integers(3, max(4, n // 3)))
        first = min(first, n - length - 1)
        rows = slice(first, first + length)
        reading[rows] += sign * size_nm
    elif kind == "sign":
        label = np.cumsum(np.append(0, np.diff(data.series) != 0))
        legs = [np.flatnonzero(label == number) for number in np.unique(label)]
        leg = legs[int(rng.integers(len(legs)))] if len(legs) > 1 else np.arange(n // 2, n)
        rows = slice(int(leg[0]), int(leg[-1]) + 1)
        reading[rows] *= -1.0
    elif kind == "stuck":
        length = int(rng.integers(3, 9))
        first = min(first, n - length)
        rows = slice(first, first + length)
        reading[rows] = reading[first - 1]
    return replace(data, reading_nm=reading), rows


def remaining(data: CalibrationData, effect: FloatArray) -> float:
    """Return the largest part of a fault's effect that no property of a healthy chain can explain.

    A healthy chain may have a zero, span, curvature and loop in each direction, and a drift; the
    loop is elastic or caused by dry friction, so that each branch has a line of its own.
    """
    u, direction = data.standard_nm / data.range_nm, data.loading_direction()
    columns = [np.linspace(0.0, 1.0, u.size)]
    for sign in np.unique(direction):
        here = (direction == sign).astype(np.float64)
        loop = here * data.branch
        columns += [here, here * u, here * u * np.abs(u), loop, loop * u]
    left, scale, _ = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    axes = left[:, scale > 1e-9 * scale[0]]
    return float(np.max(np.abs(effect - axes @ (axes.T @ effect))))


@dataclass(frozen=True)
class Trial:
    """One table, with or without a fault, and the examination's findings."""

    family: str
    fault: str
    size: float
    """Size of the fault in U; `apparent` is the part that a healthy chain can't explain, in U."""
    apparent: float
    refused: bool
    named: bool
    """Whether the table is refused or doubted."""
    placed: bool
    """Whether the fault is found at the right rows."""
    rows_left_out: int


def trial(
    data: CalibrationData,
    healthy: Examination,
    family: str,
    fault: str,
    seed: int,
    least: float = 0.0,
) -> Trial | None:
    """Examine a table with an injected fault, and return the findings.

    None where the fault can't be injected, or where a healthy chain could explain all but less than
    `least` U of it.
    """
    if not fault:
        refused = bool(healthy.disagreements)
        named = refused or bool(healthy.doubts)
        return Trial(family, "", 0.0, 0.0, refused, named, False, len(healthy.wrong_rows))
    if not np.isfinite(healthy.expanded_nm) or len(data) < 12:
        return None
    rng = np.random.default_rng([zlib.crc32(fault.encode(), zlib.crc32(family.encode())), seed])
    size = 3.0 * (LARGEST / 3.0) ** rng.uniform()
    faulty, rows = inject(data, fault, size * healthy.expanded_nm, rng)
    effect = faulty.reading_nm - data.reading_nm
    changed = np.abs(effect) > healthy.expanded_nm
    if not np.any(changed):
        return None
    apparent = remaining(data, effect) / healthy.expanded_nm
    if apparent < least:
        return None
    result = examine_table(faulty)
    if fault == "row":
        rows_named = {each.point for each in result.wrong_rows}
        rows_named |= {each.first for each in result.doubts if each.first == each.last}
        named = placed = rows.start in rows_named
        return Trial(family, fault, size, apparent, False, named, placed, len(result.wrong_rows))
    parts = (*result.disagreements, *result.doubts)
    placed = _placed(result, rows, changed)
    return Trial(
        family, fault, size, apparent, bool(result.disagreements), bool(parts), placed,
        len(result.wrong_rows),
    )  # fmt: skip


def _placed(result: Examination, rows: slice, changed: NDArray[np.bool_]) -> bool:
    """Return whether the fault's rows are named, or all others, with at most one row wrong.

    Rows that the fault changes by less than U may be named or not.
    """
    parts = (*result.disagreements, *result.doubts)
    if not parts:
        return False
    said = np.zeros(changed.size, dtype=np.bool_)
    for part in parts:
        said[part.first : part.last + 1] = True
        credible = (
            part.first_range[0] - 1 <= rows.start <= part.first_range[1] + 1
            and part.last_range[0] - 1 <= rows.stop - 1 <= part.last_range[1] + 1
        )
        if credible:
            return True
    for each in result.wrong_rows:
        said[each.point] = True
    affected = np.zeros(changed.size, dtype=np.bool_)
    affected[rows] = True
    weak = affected & ~changed
    return bool(min(np.sum((said != each) & ~weak) for each in (affected, ~affected)) <= 1)
