"""The measuring chain that is in use on one side: its stream and its recent torques."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, isnan
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.acceleration import Acceleration
from torquebench.bench.roles import Side
from torquebench.chain import (
    ChainStream,
    Component,
    EffectState,
    MeasuredRotation,
    MeasuringChain,
    Readings,
    Ripple,
    Timebase,
    Torque,
    Zero,
    effect_states,
    rows_of,
)
from torquebench.errors import InputError, SignalFault
from torquebench.message import Message
from torquebench.units import HOUR

__all__ = ["ActiveChain", "StreamPart", "StreamReadings", "TimedTorque", "ZeroTaken"]

KEPT_S = 120.0


@dataclass(frozen=True)
class ZeroTaken:
    """A zero in use.

    Parameters
    ----------
    time_s : float
        When it was taken, s of bench time.
    temperature_c : float
        Temperature of the transducer then, °C; NaN without a probe.
    standard_uncertainty_nm : float
        Standard error of the mean that it is, N·m; NaN if it isn't known.
    """

    time_s: float
    temperature_c: float
    standard_uncertainty_nm: float


@dataclass(frozen=True, eq=False)
class TimedTorque:
    """Torques of the stream at the centres of their windows, s of bench time."""

    time_s: NDArray[np.float64]
    torque: Torque


StreamPart = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None]
"""Windows of one block: their centres, readings, and the readings' counting uncertainty."""


@dataclass(frozen=True, eq=False)
class StreamReadings:
    """Windows of consecutive blocks, with the other measured quantities.

    Parameters
    ----------
    time_s, reading_nm : float64 array of shape (n,)
        Centres of the windows, and readings (NaN at a fault), N·m.
    counter_nm : float64 array of shape (n,) or None
        Uncertainty of the readings by counting, N·m.
    speed_rpm, temperature_c : float64 array of shape (n,) or float
        Over a window's block; NaN where it isn't measured.
    until_s : float64 array of shape (n,), float or None
        Centre of the last window of a window's block; of all where not given.
    acceleration_rad_s2, acceleration_uncertainty_rad_s2 : float64 array of shape (n,) or float
        Over a window's block; NaN where it isn't measured.
    angle_rad : float64 array of shape (n,) or None
        Of the shaft when the torque in the middle of a window acted; None where it isn't known.
    window_s : float or None
        Length of the windows.
    """

    time_s: NDArray[np.float64]
    reading_nm: NDArray[np.float64]
    counter_nm: NDArray[np.float64] | None = None
    speed_rpm: NDArray[np.float64] | float = np.nan
    temperature_c: NDArray[np.float64] | float = np.nan
    until_s: NDArray[np.float64] | float | None = None
    acceleration_rad_s2: NDArray[np.float64] | float = np.nan
    acceleration_uncertainty_rad_s2: NDArray[np.float64] | float = np.nan
    angle_rad: NDArray[np.float64] | None = None
    window_s: float | None = None

    @classmethod
    def joined(
        cls,
        parts: Sequence[StreamPart],
        speed_rpm: Sequence[float],
        temperature_c: Sequence[float],
        accelerations: Sequence[Acceleration],
    ) -> StreamReadings:
        """Join blocks, each with its speed, temperature and acceleration."""
        until_s = [float(time_s[-1]) if time_s.size else np.nan for time_s, _, _ in parts]
        if len(parts) == 1:
            return cls(*parts[0], speed_rpm[0], temperature_c[0], until_s[0], *accelerations[0])
        counts = [time_s.size for time_s, _, _ in parts]
        acceleration, uncertainty = (
            np.repeat(each, counts) for each in zip(*accelerations, strict=True)
        )
        counted = [counter_nm for _, _, counter_nm in parts if counter_nm is not None]
        return cls(
            np.concatenate([time_s for time_s, _, _ in parts]),
            np.concatenate([reading_nm for _, reading_nm, _ in parts]),
            np.concatenate(counted) if len(counted) == len(parts) else None,
            np.repeat(speed_rpm, counts),
            np.repeat(temperature_c, counts),
            np.repeat(until_s, counts),
            acceleration,
            uncertainty,
        )


class ActiveChain:
    """Compensates a side's stream once, and keeps the results of the last two minutes.

    Blocks are to be handed over once and in order. For a model with branches of a hysteresis loop,
    the branch of a reading follows from the readings before it; after the start, a gap or a fault
    the past is unknown, which the uncertainty contains.

    Parameters
    ----------
    chain : MeasuringChain
    model_id, kind : str
        Number of its model in the registry, and the model's kind.
    calibration_age_h : float, optional
        Time since the calibration, h.

    Attributes
    ----------
    zero : ZeroTaken or None
        The zero in use; None if none was measured since the bench was opened.
    """

    def __init__(
        self,
        chain: MeasuringChain,
        model_id: str,
        kind: str,
        calibration_age_h: float | None = None,
    ) -> None:
        self.chain = chain
        self.model_id = model_id
        self.kind = kind
        self.zero: ZeroTaken | None = None
        self._calibration_age_h = calibration_age_h
        zero = chain.find(Zero)
        self._zero_scatter_nm = 0.0 if zero is None else zero.zero_nm
        self._stream = chain.stream()
        self._recent = _Recent()
        self._fine: tuple[ChainStream, _Recent] | None = None
        self._last: tuple[Readings, Torque] | None = None

    @property
    def accepted(self) -> Timebase | None:
        """The other counter's clock that was accepted for the model; None for its own."""
        return self.chain.find(Timebase)

    @property
    def corrects_rotation(self) -> bool:
        """Whether it corrects the effect of rotation on zero and drag."""
        measured = self.chain.find(MeasuredRotation) is not None
        return measured and "rotation" not in self.chain.switches

    @property
    def needs_angle(self) -> bool:
        """Whether it corrects what repeats with every turn of the shaft."""
        return self.chain.find(Ripple) is not None

    def warm_up(self) -> None:
        """Compile the kernels before the first block needs them; the past stays unknown."""
        self._stream.copy().push(Readings(np.zeros(1), counter_nm=np.zeros(1)))

    def push(self, readings: StreamReadings) -> Torque:
        """Compensate the next windows; those with a fault or out of range get no number."""
        known = self._known(readings)
        torque = self._stream.push(known)
        if len(torque):
            self._last = known, torque
        self._recent.append(self._acted_s(readings.time_s), torque, known)
        return torque

    def push_fine(self, readings: StreamReadings) -> None:
        """Compensate shorter windows of blocks, before `push` takes the blocks themselves."""
        if self._fine is None:
            self._fine = self._stream.copy(), _Recent()
        stream, recent = self._fine
        known = self._known(readings)
        recent.append(self._acted_s(readings.time_s), stream.push(known), known)

    def _acted_s(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the times of torques: those by a dynamic filter are later than their readings."""
        dynamics = self.chain.dynamics
        return time_s if dynamics is None else dynamics.acted_s(time_s)

    def end_fine(self) -> None:
        """Drop the shorter windows, which are no longer counted."""
        self._fine = None

    def _known(self, readings: StreamReadings) -> Readings:
        zero = self.zero
        age_h: NDArray[np.float64] | None = None
        if zero is not None and readings.time_s.size:
            until_s = readings.time_s[-1] if readings.until_s is None else readings.until_s
            age_h = np.maximum(until_s - zero.time_s, 0.0) / HOUR
        return Readings(
            readings.reading_nm,
            counter_nm=readings.counter_nm,
            time_s=readings.time_s,
            speed_rpm=readings.speed_rpm,
            acceleration_rad_s2=readings.acceleration_rad_s2,
            acceleration_uncertainty_rad_s2=readings.acceleration_uncertainty_rad_s2,
            angle_rad=readings.angle_rad,
            window_s=readings.window_s,
            temperature_c=readings.temperature_c,
            zero_age_h=age_h,
            zero_temperature_c=None if zero is None else zero.temperature_c,
            zero_nm=None if zero is None else self._zero_nm(zero),
            calibration_age_h=self._calibration_age_h,
            of_bench=True,
        )

    def _zero_nm(self, zero: ZeroTaken) -> float:
        """Return the standard uncertainty of a zero: its standard error, and the scatter of zeros.

        The standard error of one zero doesn't contain how the parts were seated, nor from which
        direction they were unloaded; the chain states this where a calibration has shown it.
        """
        return hypot(self._zero_scatter_nm, zero.standard_uncertainty_nm)

    def window(self, start_s: float, stop_s: float) -> TimedTorque | None:
        """Return the torques whose windows' centres lie in [start, stop); None for none."""
        return self._recent.window(start_s, stop_s)

    def fine_window(self, start_s: float, stop_s: float) -> TimedTorque | None:
        """Return the torques of shorter windows in [start, stop); None if there are none."""
        return None if self._fine is None else self._fine[1].window(start_s, stop_s)

    def refusal(self, side: Side, start_s: float, stop_s: float) -> InputError | None:
        """Return why there is no torque in [start, stop): the effect that refuses, and its range.

        It is asked with the conditions that the first refused reading had. None where no reading
        was refused; a fault of the signal has no reading.
        """
        fine = self._fine
        for recent in (self._recent, *(() if fine is None else fine[1:])):
            refused = recent.refused(start_s, stop_s)
            if refused is None:
                continue
            try:
                self.chain.refuse(refused, lambda _: Message("{side} module", side))
            except InputError as refusal:
                return refusal
        return None

    def refuse(self, side: Side, start_s: float, stop_s: float) -> NoReturn:
        """Raise that there is no torque somewhere in [start, stop), and why.

        Raises
        ------
        InputError
            A reading was refused; it names the effect.
        SignalFault
            No reading was refused.
        """
        raise self.refusal(side, start_s, stop_s) or SignalFault(
            Message(
                "no compensated torque of the {side} from {start_s:.2f} to {stop_s:.2f} s",
                side,
                start_s,
                stop_s,
            ),
            "an active model from the start of the interval",
            "activate the compensation before the test",
        )

    @property
    def late_windows(self) -> int:
        """Number of windows by which a dynamic filter's torques come later than their readings."""
        dynamics = self.chain.dynamics
        return 0 if dynamics is None else dynamics.rows_late

    def states(self) -> tuple[EffectState, ...]:
        """Return every effect's state at the newest window; nothing before the first window."""
        last, chain = self._last, self.chain
        if last is None:
            return ()
        row = slice(len(last[1]) - 1, len(last[1]))
        return tuple(
            effect_states(chain, rows_of(last[0], row), last[1].at(np.arange(1) + row.start))
        )

    def switch_off(self, off: Sequence[str]) -> None:
        """Switch corrections off from the next window on, and all others on.

        Parameters
        ----------
        off : sequence of str
            Out of `torquebench.chain.SWITCHES`.
        """
        self.chain = self.chain.switched("switched off at the bench", off)
        self._stream.chain = self.chain
        self._fine = None

    def standing(self, temperature_c: float = np.nan) -> Torque:
        """Return the chain's torque for a reading of 0 at the stream's present state."""
        nothing = np.zeros(1)
        known = Readings(
            nothing,
            counter_nm=nothing,
            speed_rpm=0.0,
            acceleration_rad_s2=0.0,
            temperature_c=temperature_c,
        )
        return self._stream.copy().push(known)


class _Recent:
    """Torques of the last two minutes, for one writer and many readers.

    Kept as plain arrays: the garbage collection would walk through thousands of components a second
    of the stream, and hold up acquisition.
    """

    def __init__(self) -> None:
        self._blocks: deque[tuple[NDArray[np.float64], NDArray[np.float64]]] = deque()
        self._components: tuple[Component, ...] = ()
        self._refused: deque[tuple[float, Readings]] = deque()
        self._lock = threading.Lock()

    def append(self, time_s: NDArray[np.float64], torque: Torque, readings: Readings) -> None:
        if not time_s.size:
            return
        rows = _rows(torque)
        refused = _first_refused(time_s, torque, readings)
        with self._lock:
            if refused is not None:
                self._refused.append(refused)
            while self._refused and self._refused[0][0] < float(time_s[-1]) - KEPT_S:
                self._refused.popleft()
            self._components = torque.components
            self._blocks.append((time_s, rows))
            oldest_s = float(time_s[-1]) - KEPT_S
            while self._blocks[0][0][-1] < oldest_s:
                self._blocks.popleft()

    def refused(self, start_s: float, stop_s: float) -> Readings | None:
        """Return the first refused reading with its conditions; None where none was refused."""
        with self._lock:
            return next((each for at, each in self._refused if start_s <= at < stop_s), None)

    def window(self, start_s: float, stop_s: float) -> TimedTorque | None:
        with self._lock:
            blocks = [
                each for each in self._blocks if each[0][-1] >= start_s and each[0][0] < stop_s
            ]
            components = self._components
        if not blocks:
            return None
        time_s = np.concatenate([each[0] for each in blocks])
        inside = np.flatnonzero((time_s >= start_s) & (time_s < stop_s))
        if not inside.size:
            return None
        rows = np.concatenate([each[1] for each in blocks], axis=1)[:, inside]
        return TimedTorque(time_s[inside], _torque(rows, components))


def _first_refused(
    time_s: NDArray[np.float64], torque: Torque, readings: Readings
) -> tuple[float, Readings] | None:
    """Return time and conditions of a block's first reading without a torque."""
    if not isnan(torque.value_nm.sum()):
        return None
    rows = np.flatnonzero(np.isnan(torque.value_nm) & np.isfinite(readings.reading_nm))
    if not rows.size:
        return None
    row = int(rows[0])
    return float(time_s[row]), rows_of(readings, slice(row, row + 1))


def _rows(torque: Torque) -> NDArray[np.float64]:
    """Return torques, then uncertainty, addition and place of one component after the other."""
    places = sum(each.place.shape[1] for each in torque.components if each.place is not None)
    rows = np.zeros((1 + 2 * len(torque.components) + places, torque.value_nm.size))
    rows[0] = torque.value_nm
    row = 1
    for _, _, uncertainty_nm, value_nm, place, _ in torque.components:
        rows[row] = uncertainty_nm
        if isinstance(value_nm, np.ndarray) or value_nm:
            rows[row + 1] = value_nm
        row += 2
        if place is not None:
            rows[row : row + place.shape[1]] = place.T
            row += place.shape[1]
    return rows


def _torque(rows: NDArray[np.float64], components: tuple[Component, ...]) -> Torque:
    """Return the torques of which these are the rows, by components of such torques."""
    found: list[Component] = []
    next_row = 1
    for each in components:
        first = next_row + 2
        next_row = first + (0 if each.place is None else each.place.shape[1])
        place = None if each.place is None else np.ascontiguousarray(rows[first:next_row].T)
        found.append(
            each._replace(uncertainty_nm=rows[first - 2], value_nm=rows[first - 1], place=place)
        )
    return Torque(rows[0], tuple(found))
