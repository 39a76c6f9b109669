"""Cuts a record of two encoders into runs in one direction, and checks ratio, sampling and slip.

The transmission error repeats with each turn of the output. The difference between two samples one
turn apart therefore contains none of its orders, only slip or an error of the ratio.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import noise_of, turning_points
from torquebench.units import ARCSEC, DEG_PER_RAD, DEG_PER_TURN, TURN

Floats = NDArray[np.float64]
Direction = Literal["clockwise", "counter-clockwise"]
SAMPLES_PER_PERIOD = 10.0
COARSE = 0.15
"""Relative deviation of the ratio over a run above which it is wrong: no transmission error is so
large."""
RATIO_TOLERANCE = 1e-3
"""Relative deviation of the ratio that is reported as a wrong ratio, not as a drift."""
GAP_STEPS = 25.0
"""Factor by which a gap exceeds nearly all other steps of the angle."""
DRIFT_SHARE = 0.05
LEAST_DRIFT_ARCSEC = 2.0
SIGNIFICANT = 6.0
"""Standard errors from which on a difference after one turn is significant."""


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
    counted_rad : float
        Step of both encoders' counts at the output; 0 if none is visible.
    """

    direction: Direction
    rows: slice
    angle_rad: Floats
    error_rad: Floats
    counted_rad: float = 0.0

    @property
    def step_rad(self) -> float:
        """95 % quantile of the steps between samples."""
        steps = np.diff(self.angle_rad)
        steps = steps[steps > 0.0]
        return float(np.quantile(steps, 0.95)) if steps.size else np.inf

    @property
    def turns(self) -> int:
        """Number of whole output revolutions; the last one may lack its final sample."""
        span = float(self.angle_rad[-1] - self.angle_rad[0]) + 1.05 * self.step_rad
        return int(span / TURN + 1e-6)


def unwrapped(angle_rad: Floats) -> Floats:
    """Unwrap an angle that restarts after each revolution, undisturbed by single outliers.

    Examples
    --------
    >>> turned = np.arange(0.0, 12.0, 0.1)
    >>> read = np.where(np.arange(120) == 7, 4.0, turned % TURN)
    >>> bool(np.allclose(np.delete(unwrapped(read), 7), np.delete(turned, 7)))
    True
    """

    def wrapped(step: Floats) -> Floats:
        return np.asarray((step + 0.5 * TURN) % TURN - 0.5 * TURN)

    if angle_rad.size < 4:
        return np.unwrap(angle_rad)
    # An outlier is far from both neighbours, which are close to each other.
    step, across = wrapped(np.diff(angle_rad)), wrapped(angle_rad[2:] - angle_rad[:-2])
    usual = float(np.median(np.abs(step)))
    nearer = np.minimum(np.abs(step[:-1]), np.abs(step[1:]))
    outlier = np.zeros(angle_rad.size, dtype=np.bool_)
    outlier[1:-1] = (nearer > 20.0 * usual + 1e-6) & (np.abs(across) < 0.3 * nearer)
    good = np.flatnonzero(~outlier)
    result = np.array(angle_rad)
    result[good] = np.unwrap(angle_rad[good])
    for row in np.flatnonzero(outlier):
        before = result[row - 1]
        result[row] = before + wrapped(angle_rad[row] - before)
    return result


def one_way(angle: Floats) -> list[tuple[int, int]]:
    """Return the first and last samples of the intervals in which an angle has one direction."""
    steps = np.abs(np.diff(angle))
    gaps = np.flatnonzero(steps > GAP_STEPS * np.quantile(steps, 0.95)) + 1
    runs = []
    for begin, end in pairwise([0, *gaps.tolist(), angle.size]):
        piece = angle[begin:end]
        if piece.size < 2:
            continue
        for start, stop in pairwise(turning_points(piece).tolist()):
            # Reversals of a smoothed angle are only close to the real ones.
            part = piece[start : stop + 1] * np.sign(piece[stop] - piece[start])
            if part.any():
                first, last = int(np.argmin(part)), int(np.argmax(part))
                runs.append((begin + start + first, begin + start + last))
    return runs


def check_ratio(input_rad: Floats, output_rad: Floats, ratio: float) -> None:
    """Refuse angles of another ratio than stated: swapped, reversed, or miscounted."""
    span_in, span_out = float(np.ptp(input_rad)), float(np.ptp(output_rad))
    if span_in == 0.0 or span_out == 0.0:
        side = "input" if span_in == 0.0 else "output"
        raise InputError(
            Message("an {side} angle that stands still", side),
            "both encoders turning",
            "check the encoder and the coupling",
        )
    start, stop = max(
        one_way(output_rad), key=lambda each: abs(output_rad[each[1]] - output_rad[each[0]])
    )
    through, out = (each[start : stop + 1] - each[start] for each in (input_rad, output_rad))
    measured = float(through[-1] / out[-1])
    if abs(measured / ratio - 1.0) > COARSE:
        _refuse_ratio(measured, ratio)
    out = np.abs(out)
    step = float(np.quantile(np.abs(np.diff(out)), 0.95))
    turns = int((out[-1] + step) / TURN)
    if not turns:
        return
    # Over whole output turns the orders cancel: what remains is the ratio, or slip.
    out = np.maximum.accumulate(out)
    measured = float(np.interp(turns * TURN, out, np.abs(through))) / (turns * TURN)
    if abs(measured / abs(ratio) - 1.0) > RATIO_TOLERANCE:
        angle = np.abs(through / ratio)
        jump, place_rad, _, stepped = _step_or_line(angle, out - angle, ratio)
        if stepped and abs(jump) > 0.5 * abs(measured / ratio - np.sign(measured / ratio)) * TURN:
            _refuse_slip(jump, place_rad + abs(float(output_rad[start])))
        _refuse_ratio(np.copysign(measured, ratio), ratio)


def _refuse_slip(jump_rad: float, place_rad: float) -> None:
    """Refuse a transmission error that jumps and doesn't come back."""
    raise InputError(
        Message(
            "the transmission error jumps by {jump:.3g} arcsec at {degrees:.4g}° of "
            "the output and doesn't come back",
            abs(jump_rad) / ARCSEC,
            place_rad * DEG_PER_RAD % DEG_PER_TURN,
        ),
        "an error that repeats with the revolution",
        "an encoder or its coupling slips: fasten it and measure again",
    )


def _refuse_ratio(measured: float, ratio: float) -> None:
    """Refuse angles that contradict the ratio; say which mistake explains them."""
    if abs(measured * ratio - 1.0) <= COARSE and abs(ratio**2 - 1.0) > COARSE:
        remedy = "input and output angle are swapped: name the columns the other way round"
    elif abs(measured / ratio + 1.0) <= COARSE:
        remedy = "the output turns against the input: make the ratio negative"
    else:
        remedy = "check the ratio, the angles' units and counts per revolution, and slip"
    raise InputError(
        Message("angles that show a ratio of {shown:.5g}", measured),
        Message("{ratio:g} within 0.1 %", ratio),
        remedy,
    )


def runs_of(
    input_rad: Floats, output_rad: Floats, ratio: float, counted_rad: float = 0.0
) -> list[Run]:
    """Return the runs in one direction, bounded by reversals of the input and by gaps."""
    shared = input_rad / ratio
    runs = []
    for start, stop in one_way(shared):
        rows = slice(start, stop + 1)
        direction = np.sign(shared[stop] - shared[start])
        order = slice(None, None, int(direction))
        angle = np.maximum.accumulate(shared[rows][order])
        name: Direction = "clockwise" if direction > 0 else "counter-clockwise"
        runs.append(Run(name, rows, angle, (output_rad[rows] - shared[rows])[order], counted_rad))
    return runs


def highest_supported(run: Run) -> float:
    """Return the highest order with ten samples in each period."""
    return TURN / run.step_rad / SAMPLES_PER_PERIOD * (1.0 + 1e-6)


def check_return(run: Run, ratio: float) -> None:
    """Refuse an error that doesn't return after a revolution: slip, or a wrong ratio."""
    angle, error = run.angle_rad, run.error_rad
    apart, noise = _after_a_turn(run, ratio)
    amplitude = float(np.quantile(error, 0.98) - np.quantile(error, 0.02))
    worst = int(np.argmax(np.abs(apart)))
    limit = max(DRIFT_SHARE * amplitude, LEAST_DRIFT_ARCSEC * ARCSEC, SIGNIFICANT * noise)
    if abs(apart[worst]) <= limit:
        return
    step, place_rad, line, stepped = _step_or_line(angle, error, ratio)
    if stepped:
        _refuse_slip(step, place_rad)
    per_turn = line * TURN
    raise InputError(
        Message(
            "the transmission error drifts by {drift:.3g} arcsec per output revolution",
            abs(per_turn) / ARCSEC,
        ),
        Message("at most {limit:.3g} arcsec", limit / ARCSEC),
        Message(
            "the ratio is wrong (the angles show {shown:.8g} instead of {ratio:.8g}), or an "
            "encoder creeps",
            ratio / (1.0 + line),
            ratio,
        ),
    )


def _after_a_turn(run: Run, ratio: float) -> tuple[Floats, float]:
    """Return block means of the error's change after one turn, and their standard error."""
    angle, error = run.angle_rad, run.error_rad
    noise = noise_of(error)
    last = float(angle[-1]) - TURN
    here = np.flatnonzero(angle <= max(last, float(angle[0])))
    change = np.interp(angle[here] + TURN, angle, error) - error[here]
    if last < float(angle[0]):  # the turn isn't quite complete: continue by the slope at both ends
        ends = [np.polyfit(angle[part], error[part], 1) for part in (slice(6), slice(-6, None))]
        slope = 0.5 * float(ends[0][0] + ends[1][0])
        gap = float(angle[0]) - last
        change = np.array([float(error[-1] - error[0]) + slope * gap])
        noise = float(np.hypot(noise, abs(ends[0][0] - ends[1][0]) * gap))
    if float(np.ptp(angle[here])) > 1.5 * TURN / abs(ratio) and here.size > 32:
        # If the ratio isn't an integer, an order of the input isn't one of the output.
        basis = _periodic(angle[here], [abs(ratio), 2.0 * abs(ratio)])
        change = change - basis @ (basis.T @ (change - change.mean()))
    parts = np.array_split(np.arange(change.size), max(1, min(8 * run.turns, change.size // 16)))
    means = np.array([change[part].mean() for part in parts])
    size = float(np.mean([part.size for part in parts]))
    # Counts may beat with the samples: their error doesn't average out.
    error_of = float(np.hypot(noise * (2.0 / size) ** 0.5, run.counted_rad / 6.0**0.5))
    return means, error_of


def _step_or_line(angle: Floats, error: Floats, ratio: float) -> tuple[float, float, float, bool]:
    """Return the best step, its angle, the best line's slope, and whether the step fits better.

    Each is fitted together with the orders of output and input.
    """
    count = min(6144, angle.size)
    pick = np.unique(np.linspace(0, angle.size - 1, count).astype(np.intp))
    # Average the samples of each block, so that noise doesn't hide a small step.
    edges = np.append(pick[:-1], angle.size)
    weight = np.diff(edges)
    angle = np.add.reduceat(angle, pick[:-1]) / weight
    error = np.add.reduceat(error, pick[:-1]) / weight
    highest = int(np.clip(angle.size / 24, 3, 60))
    orders = [*np.arange(1.0, highest + 1.0), abs(ratio), 2.0 * abs(ratio), 3.0 * abs(ratio)]
    basis = _periodic(angle, list(dict.fromkeys(orders)))
    residual = error - basis @ (basis.T @ error)
    line = angle - basis @ (basis.T @ angle)
    size = float(line @ line)
    slope = float(line @ residual) / size if size > 0.0 else 0.0
    left_by_line = float(residual @ residual) - slope**2 * size
    step, left_by_step, step_angle = _best_step(angle, residual, basis)
    return step, step_angle, slope, left_by_step <= left_by_line


def _periodic(angle: Floats, orders: list[float]) -> Floats:
    """Return an orthonormal basis of a constant and the orders of an angle."""
    columns = [np.ones_like(angle)]
    for order in orders:
        columns += [np.cos(order * angle), np.sin(order * angle)]
    return np.linalg.qr(np.column_stack(columns))[0]


def _best_step(angle: Floats, rest: Floats, basis: Floats) -> tuple[float, float, float]:
    """Return the best step beside periodic parts, the remaining sum of squares, and its angle."""
    size = angle.size
    # Project a step at each sample out of the basis, by sums from that sample on.
    tail_basis = np.cumsum(basis[::-1], axis=0)[::-1]
    tail_rest = np.cumsum(rest[::-1])[::-1]
    norm = (size - np.arange(size)) - np.sum(tail_basis**2, axis=1)
    usable = norm > 1e-3 * size  # a step at the very end can't be told
    gain = np.where(usable, tail_rest**2 / np.where(usable, norm, 1.0), 0.0)
    best = int(np.argmax(gain))
    step = float(tail_rest[best] / norm[best]) if usable[best] else 0.0
    return step, float(rest @ rest) - float(gain[best]), float(angle[best])
