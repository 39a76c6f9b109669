"""Cuts a record of two encoders into runs in one direction, and checks ratio and slip."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import turning_points
from torquebench.units import ARCSEC, DEG_PER_RAD, DEG_PER_TURN, TURN

__all__ = ["Run", "check_ratio", "check_sampling", "check_slip", "runs_of"]

Floats = NDArray[np.float64]
SAMPLES_PER_PERIOD = 10.0
RATIO_TOLERANCE = 1e-3
"""Relative deviation of the ratio that is reported before any other check."""
GAP_STEPS = 25.0
"""A step of the angle that is this much larger than nearly all others is a gap."""
DRIFT_SHARE = 0.05
LEAST_DRIFT_ARCSEC = 2.0


@dataclass(frozen=True, eq=False)
class Run:
    """Samples in one direction.

    Parameters
    ----------
    direction : {"clockwise", "counter-clockwise"}
        Of the output.
    rows : slice
        Of the record.
    angle_rad : array of float, shape (n,)
        Output angle by the input encoder (θ_i/R), never falling; a run counter-clockwise is
        turned round in time.
    error_rad : array of float, shape (n,)
        θ_o − θ_i/R.
    """

    direction: Literal["clockwise", "counter-clockwise"]
    rows: slice
    angle_rad: Floats
    error_rad: Floats


def check_ratio(given: Floats, taken: Floats, ratio: float) -> None:
    """Refuse angles that don't turn by the ratio.

    Raises
    ------
    InputError
        Naming swapped columns, a wrong sign, or the ratio that the angles show.
    """
    span_in, span_out = float(np.ptp(given)), float(np.ptp(taken))
    if span_in == 0.0 or span_out == 0.0:
        side = "input" if span_in == 0.0 else "output"
        raise InputError(
            Message("an {side} angle that stands still", side),
            "both encoders turning",
            "check the encoder and the coupling",
        )
    slope = float(np.cov(given, taken)[0, 1] / np.var(given, ddof=1))
    found = 1.0 / slope if slope else np.inf
    if abs(found / ratio - 1.0) <= RATIO_TOLERANCE:
        return
    if abs(found * ratio - 1.0) <= 0.01:
        remedy = "input and output angle are swapped: name the columns the other way round"
    elif abs(found / ratio + 1.0) <= 0.01:
        remedy = "the output turns against the input: make the ratio negative"
    else:
        remedy = "check the ratio, the angles' units and counts per revolution, and slip"
    raise InputError(
        Message("angles that show a ratio of {found:.6g}", found),
        Message("{ratio:g} within 0.1 %", ratio),
        remedy,
    )


def runs_of(given: Floats, taken: Floats, ratio: float) -> list[Run]:
    """Return the runs in one direction that are at least one output revolution long.

    A run ends at a gap of the record (two concatenated recordings), and begins and ends exactly at
    a reversal of the input.

    Raises
    ------
    InputError
        Where there is none.
    """
    shared = given / ratio
    runs, longest = [], 0.0
    for start, stop in _one_way(shared):
        rows = slice(start, stop + 1)
        direction = np.sign(shared[stop] - shared[start])
        order = slice(None, None, int(direction))
        angle = np.maximum.accumulate(shared[rows][order])
        span = float(angle[-1] - angle[0])
        longest = max(longest, span)
        if span >= TURN * (1.0 - 1e-6):
            name: Literal["clockwise", "counter-clockwise"] = (
                "clockwise" if direction > 0 else "counter-clockwise"
            )
            runs.append(Run(name, rows, angle, (taken[rows] - shared[rows])[order]))
    if not runs:
        raise InputError(
            Message("{longest:.4g} output revolutions in one direction", longest / TURN),
            "at least one whole output revolution in each direction",
            Message(
                "turn the input by {ratio:g} revolutions or more without a reversal", abs(ratio)
            ),
        )
    return runs


def _one_way(angle: Floats) -> list[tuple[int, int]]:
    """Return first and last samples of the intervals in which an angle has one direction."""
    steps = np.abs(np.diff(angle))
    gaps = np.flatnonzero(steps > GAP_STEPS * np.quantile(steps, 0.95)) + 1
    found = []
    for begin, end in pairwise([0, *gaps.tolist(), angle.size]):
        piece = angle[begin:end]
        if piece.size < 2:
            continue
        for start, stop in pairwise(turning_points(piece).tolist()):
            # Reversals of a smoothed angle are only near the real ones.
            part = piece[start : stop + 1] * np.sign(piece[stop] - piece[start])
            if part.any():
                first, last = int(np.argmin(part)), int(np.argmax(part))
                found.append((begin + start + first, begin + start + last))
    return found


def check_sampling(run: Run, highest_order: float) -> None:
    """Refuse fewer than 10 samples per period of the highest order.

    Raises
    ------
    InputError
        With the highest order that the record supports.
    """
    steps = np.diff(run.angle_rad)
    step = float(np.quantile(steps[steps > 0], 0.95)) if np.any(steps > 0) else np.inf
    samples = TURN / highest_order / step
    if samples < SAMPLES_PER_PERIOD * (1.0 - 1e-6):
        raise InputError(
            Message(
                "{samples:.3g} samples per period of the order {highest_order:g}",
                samples,
                highest_order,
            ),
            Message("at least {limit:g}", SAMPLES_PER_PERIOD),
            Message(
                "turn more slowly or sample faster, or limit the report to order {turn:.4g}",
                TURN / step / SAMPLES_PER_PERIOD,
            ),
        )


def check_slip(run: Run, ratio: float) -> None:
    """Refuse an error that doesn't repeat after a revolution: slip or a wrong ratio.

    The error is fitted by parts periodic in output and input, plus either a line or one step; a
    significant line or step is reported.

    Raises
    ------
    InputError
    """
    count = min(6144, run.angle_rad.size)
    pick = np.unique(np.linspace(0, run.angle_rad.size - 1, count).astype(np.intp))
    # Means between the picked samples, so that noise doesn't hide a small step.
    edges = np.append(pick[:-1], run.angle_rad.size)
    weight = np.diff(edges)
    angle = np.add.reduceat(run.angle_rad, pick[:-1]) / weight
    error = np.add.reduceat(run.error_rad, pick[:-1]) / weight
    orders = [1.0, 2.0, 3.0, abs(ratio), 2.0 * abs(ratio)]
    basis = _periodic(angle, orders)
    rest = error - basis @ (basis.T @ error)
    orders += _strong_orders(angle, rest)
    basis = _periodic(angle, orders)
    rest = error - basis @ (basis.T @ error)
    line = angle - basis @ (basis.T @ angle)
    slope = float(line @ rest) / float(line @ line)
    left_line = float(rest @ rest) - slope**2 * float(line @ line)
    step, left_step, place = _best_step(angle, rest, basis)
    freedom = max(angle.size - basis.shape[1] - 1, 1)
    amplitude = float(np.quantile(error, 0.98) - np.quantile(error, 0.02))
    limit = max(DRIFT_SHARE * amplitude, LEAST_DRIFT_ARCSEC * ARCSEC)
    total = float(rest @ rest)
    drift, jump = abs(slope) * TURN, abs(step)
    significant = total - min(left_step, left_line) > 36.0 * min(left_step, left_line) / freedom
    if not significant:
        return
    if left_step <= left_line and jump > limit:
        raise InputError(
            Message(
                "the transmission error jumps by {jump:.3g} arcsec at {degrees:.4g}° of "
                "the output and doesn't come back",
                jump / ARCSEC,
                place * DEG_PER_RAD % DEG_PER_TURN,
            ),
            "an error that repeats with the revolution",
            "an encoder or its coupling slips: fasten it and measure again",
        )
    if left_line < left_step and drift > limit:
        raise InputError(
            Message(
                "the transmission error drifts by {drift:.3g} arcsec per output revolution",
                drift / ARCSEC,
            ),
            Message("at most {limit:.3g} arcsec", limit / ARCSEC),
            Message(
                "the ratio is wrong (the angles show {shown:.8g} instead of "
                "{ratio:.8g}), or an encoder creeps",
                ratio / (1.0 + slope),
                ratio,
            ),
        )


def _periodic(angle: Floats, orders: list[float]) -> Floats:
    columns = [np.ones_like(angle)]
    for order in orders:
        columns += [np.cos(order * angle), np.sin(order * angle)]
    return np.linalg.qr(np.column_stack(columns))[0]


def _strong_orders(angle: Floats, rest: Floats) -> list[float]:
    """Return the orders that stand out of the rest, above those of which a step consists."""
    per_turn = 2048
    first = angle[0]
    grid = first + np.arange(per_turn) * TURN / per_turn
    amplitude = np.abs(np.fft.rfft(np.interp(grid, angle, rest)))
    amplitude[:12] = 0.0
    floor = 8.0 * float(np.median(amplitude[12:]))
    strongest = np.argsort(-amplitude)[:16]
    return [float(order) for order in strongest if amplitude[order] > floor]


def _best_step(angle: Floats, rest: Floats, basis: Floats) -> tuple[float, float, float]:
    """Return the step, the remaining sum of squares and the place, with periodic parts."""
    size = angle.size
    # Projected step functions: the sums of the basis from each place on.
    tail_basis = np.cumsum(basis[::-1], axis=0)[::-1]
    tail_rest = np.cumsum(rest[::-1])[::-1]
    norm = (size - np.arange(size)) - np.sum(tail_basis**2, axis=1)
    usable = norm > 0.01 * size  # a step right at an end isn't one
    gain = np.where(usable, tail_rest**2 / np.where(usable, norm, 1.0), 0.0)
    best = int(np.argmax(gain))
    step = float(tail_rest[best] / norm[best]) if usable[best] else 0.0
    return step, float(rest @ rest) - float(gain[best]), float(angle[best])
