"""Ripple within a revolution: orders of the shaft's angle in empty runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from torquebench.chain.effects import Ripple
from torquebench.chain.effects.ripple import speed_terms
from torquebench.chain.grid import numbers
from torquebench.chain.identification.records import EmptyRun
from torquebench.chain.readings import FloatArray, Readings
from torquebench.units import MINUTE

ORDERS = (1, 2, 3, 4, 5, 6)
_TERMS = 5
_SLOW_S = 0.5
"""Time over which means contain only slow changes, by temperature, drag and ramps, s."""
_FEWEST_ROWS = 200
_LEAST_GAIN = 40.0
"""Smallest fall of the sum of squares by an order's ten columns, in variances (by chance: 10 ±
4.5)."""
_SPEEDS = 24
_MOST_TURNS = 0.9
"""Periods of an order in a window, from which on the mean over the window removes nearly all of
it."""


@dataclass(frozen=True, eq=False)
class _Rows:
    """Readings of one run and the columns of all orders, both without slow changes."""

    columns: FloatArray
    target: FloatArray

    @classmethod
    def of(cls, run: EmptyRun, angle: FloatArray, largest: float, window_s: float) -> _Rows:
        """Return a run's readings and the orders' terms, both without slow changes."""
        from scipy.ndimage import uniform_filter1d  # imported late: empty runs only

        size = max(round(_SLOW_S / window_s) | 1, 3)
        terms = speed_terms(run.speed_rpm, largest)
        columns = []
        for order in ORDERS:
            attenuation = np.sinc(order * run.speed_rpm / MINUTE * window_s)
            seen = np.abs(order * run.speed_rpm / MINUTE * window_s) < _MOST_TURNS
            part = seen * attenuation * terms
            columns += [part * np.cos(order * angle), part * np.sin(order * angle)]
        every = np.concatenate(columns).T
        return cls(
            every - uniform_filter1d(every, size, axis=0, mode="nearest"),
            run.reading_nm - uniform_filter1d(run.reading_nm, size, mode="nearest"),
        )

    def chosen(self, members: FloatArray) -> _Rows:
        return _Rows(self.columns[:, members], self.target)


def identify_ripple(runs: Sequence[EmptyRun]) -> Ripple | None:
    """Return the ripple of all significant orders; None without any, or without angles.

    Parameters
    ----------
    runs : sequence of EmptyRun
        Empty runs; those without an angle are ignored.
    """
    usable = [run for run in runs if run.angle_rad is not None and len(run) >= _FEWEST_ROWS]
    if not usable:
        return None
    largest = max(float(np.max(np.abs(run.speed_rpm))) for run in usable)
    if largest < 1.0:
        return None
    window_s = float(np.median(np.concatenate([np.diff(run.time_s) for run in usable])))
    rows = [
        _Rows.of(run, run.angle_rad, largest, window_s)
        for run in usable
        if run.angle_rad is not None
    ]
    orders = _standing_out(rows)
    if not orders:
        return None
    members = _members(orders)
    rows = [each.chosen(members) for each in rows]
    variance = _residual_variance(rows)
    scale = _scale(rows, variance)
    weights, spread = _solved(rows, variance, scale)
    single = [_solved([each], variance, scale)[0] - weights for each in rows if len(rows) > 1]
    speeds = np.linspace(0.0, largest, _SPEEDS)
    by_speed = _by_speed(orders, speeds, largest, window_s)
    own = np.einsum("knp,pq,knq->n", by_speed, spread, by_speed)
    between = [np.sum((by_speed @ each) ** 2, axis=0) for each in single]
    u = np.sqrt(0.5 * np.maximum(own, np.mean(between, axis=0) if between else 0.0))
    table = weights.reshape(len(orders), 2, _TERMS)
    return Ripple(
        "empty runs " + ", ".join(run.source for run in usable),
        largest,
        window_s,
        numbers(orders),
        tuple(numbers(row) for row in table[:, 0]),
        tuple(numbers(row) for row in table[:, 1]),
        numbers(speeds),
        numbers(u),
    )


def without_ripple(ripple: Ripple | None, runs: Sequence[EmptyRun]) -> list[EmptyRun]:
    """Return runs with the ripple subtracted, where their angle is known."""
    corrected = []
    for run in runs:
        if ripple is None or run.angle_rad is None:
            corrected.append(run)
            continue
        readings = Readings(run.reading_nm, speed_rpm=run.speed_rpm, angle_rad=run.angle_rad)
        (part,) = ripple.components(readings, run.reading_nm)
        corrected.append(replace(run, reading_nm=run.reading_nm + part.value_nm))
    return corrected


def _members(orders: Sequence[int]) -> FloatArray:
    """Return the columns that belong to some orders, among the columns of all `ORDERS`."""
    width = 2 * _TERMS
    return np.concatenate([np.arange(width) + width * ORDERS.index(order) for order in orders])


def _standing_out(rows: Sequence[_Rows]) -> list[int]:
    """Return the orders whose columns lower the sum of squares by more than chance does."""
    orders = list(ORDERS)
    variance = _residual_variance(rows)
    for order in ORDERS:
        without = [other for other in orders if other != order]
        part = [row.chosen(_members(without)) for row in rows] if without else None
        before = [row.chosen(_members(orders)) for row in rows]
        squares = _squares(part) if part else sum(float(row.target @ row.target) for row in rows)
        if (squares - _squares(before)) / variance < _LEAST_GAIN:
            orders = without
    return orders


def _normal(rows: Sequence[_Rows]) -> tuple[FloatArray, FloatArray]:
    """Return matrix and right side of the normal equations of a least-squares fit."""
    matrix = sum((row.columns.T @ row.columns for row in rows[1:]),
                 rows[0].columns.T @ rows[0].columns)  # fmt: skip
    vector = sum((row.columns.T @ row.target for row in rows[1:]),
                 rows[0].columns.T @ rows[0].target)  # fmt: skip
    return matrix, vector


def _weights(rows: Sequence[_Rows]) -> FloatArray:
    """Return the least-squares amplitudes of all terms."""
    matrix, vector = _normal(rows)
    return np.asarray(np.linalg.lstsq(matrix, vector, rcond=1e-10)[0])


def _squares(rows: Sequence[_Rows]) -> float:
    """Return the sum of the squares that the best amplitudes leave of the readings."""
    weights = _weights(rows)
    squares = [np.sum((row.target - row.columns @ weights) ** 2) for row in rows]
    return float(np.sum(squares))


def _residual_variance(rows: Sequence[_Rows]) -> float:
    size = sum(row.target.size for row in rows)
    return float(max(_squares(rows) / max(size - rows[0].columns.shape[1], 1), 1e-300))


def _solved(rows: Sequence[_Rows], variance: float, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return the weights and their covariance, for given noise and prior size."""
    matrix, vector = _normal(rows)
    inverse = np.linalg.inv(matrix / variance + np.eye(vector.size) / scale**2)
    return inverse @ vector / variance, np.asarray(inverse, dtype=float)


def _scale(rows: Sequence[_Rows], variance: float) -> float:
    """Return the prior size of the weights under which the rows are most probable.

    At speeds that the runs don't contain, the polynomials can't be distinguished: the evidence only
    counts the directions that the data determine.
    """
    matrix, vector = _normal(rows)
    size, axes = np.linalg.eigh(matrix)
    size, along = np.maximum(size, 0.0), (axes.T @ vector) ** 2
    usual = np.sqrt(sum(float(row.target @ row.target) for row in rows) / vector.size)

    def evidence(scale: float) -> float:
        """Return the log evidence of a scale of the orders' prior."""
        spread = variance + scale**2 * size
        explained = float(np.sum(scale**2 * along / spread)) / variance
        return explained - float(np.sum(np.log(spread / variance)))

    scales = usual * np.geomspace(1e-5, 10.0, 49)
    return float(scales[np.argmax([evidence(each) for each in scales])])


def _by_speed(
    orders: Sequence[int], speeds: FloatArray, largest: float, window_s: float
) -> FloatArray:
    """Return the map from weights to amplitudes at speeds, (2 orders, speeds, weights).

    Each order's cosine and sine have weights of their own over the terms of speed; the counter's
    window attenuates the amplitudes.
    """
    terms = speed_terms(speeds, largest)
    size = 2 * len(orders)
    amplitudes = np.zeros((size, speeds.size, size * _TERMS))
    for amplitude in range(size):
        attenuation = np.sinc(orders[amplitude // 2] * speeds / MINUTE * window_s)
        weights = slice(amplitude * _TERMS, (amplitude + 1) * _TERMS)
        amplitudes[amplitude, :, weights] = (attenuation * terms).T
    return amplitudes
