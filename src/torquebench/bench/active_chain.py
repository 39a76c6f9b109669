"""The measuring chain in use on one side: its stream and its recent torques."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, isnan
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.blocks import KEPT_S
from torquebench.bench.roles import Side
from torquebench.chain import (
    ChainStream,
    Component,
    EffectState,
    MeasuredRotation,
    MeasuringChain,
    Readings,
    Timebase,
    Torque,
    Zero,
    effect_states,
    rows_of,
)
from torquebench.elementwise import Values, functions_for, in_columns
from torquebench.errors import InputError, SignalFault
from torquebench.message import Message
from torquebench.signals import History, Record
from torquebench.units import HOUR

FloatArray = NDArray[np.float64]
LEAST_WINDOW_S = 0.001
MOST_REFUSED = 2400
"""Number of blocks with refused readings that are kept: two minutes of the usual 50 ms."""


@dataclass(frozen=True)
class ZeroTaken:
    """A zero in use.

    Attributes
    ----------
    time_s : float
        Bench time at which it was taken.
    temperature_c : float
        Temperature of the transducer then; NaN if unknown.
    standard_uncertainty_nm : float
        Standard error of its mean, N·m.
    """

    time_s: float
    temperature_c: float
    standard_uncertainty_nm: float


class ActiveChain:
    """Compensator of a side's stream, which keeps the torques of the last two minutes.

    Parameters
    ----------
    model_id, kind : str
        Identity and kind of the registered model.
    calibration_age_h : float, optional
        Time since its calibration.
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
        self._recent = _Torques()
        self._fine: tuple[ChainStream, _Torques] | None = None
        self._last: tuple[MeasuringChain, Readings, Torque] | None = None
        self.needs_angle = any("angle_rad" in effect.needs for effect in chain.stored)
        """Whether an effect of the chain depends on the shaft's angle."""

    @property
    def accepted(self) -> Timebase | None:
        """Accepted other counter clock of the model; None if it uses its own counter."""
        return self.chain.find(Timebase)

    @property
    def corrects_rotation(self) -> bool:
        """Whether the chain corrects the effect of rotation on zero and drag."""
        measured = self.chain.find(MeasuredRotation) is not None
        return measured and "rotation" not in self.chain.switches

    def take_zero(self, zero: ZeroTaken) -> None:
        """Let the next readings count from a zero that was just taken without load."""
        self.zero, self._fine = zero, None
        self._stream.take_zero()

    def push(
        self,
        record: Record,
        conditions: dict[str, Any],
        until_s: FloatArray | float,
        *,
        fine: bool = False,
    ) -> Torque:
        """Compensate the next windows; a window with a fault or out of range gets NaN.

        Parameters
        ----------
        record : Record
            `time_s`, `reading_nm` and `counter_nm` of the windows.
        conditions : dict
            Further quantities of `Readings`, one for all windows or one each.
        until_s : float or float64[n]
            End of the block of each window, for the age of the zero.
        fine : bool
            Whether they are shorter windows of blocks that will be pushed later.
        """
        zero, age_h = self.zero, None
        if zero is not None and len(record):
            age_h = functions_for(until_s).maximum(until_s - zero.time_s, 0.0) / HOUR
        readings = Readings(
            record["reading_nm"],
            counter_nm=record.get("counter_nm"),
            time_s=record.time_s,
            zero_age_h=age_h,
            zero_temperature_c=None if zero is None else zero.temperature_c,
            zero_nm=(
                None if zero is None else hypot(self._zero_scatter_nm, zero.standard_uncertainty_nm)
            ),
            calibration_age_h=self._calibration_age_h,
            of_bench=True,
            **conditions,
        )
        stream, recent = self._stream, self._recent
        if fine:
            if self._fine is None:
                self._fine = stream.copy(), _Torques()
            stream, recent = self._fine
        torque = stream.push(readings)
        if len(torque) and not fine:
            self._last = self.chain, readings, torque
        dynamics = self.chain.dynamics  # a dynamic filter delays the torques against their readings
        acted_s = record.time_s if dynamics is None else dynamics.acted_s(record.time_s)
        recent.append(acted_s, torque, readings)
        return torque

    def end_fine(self) -> None:
        """Discard the shorter windows, which are no longer counted."""
        self._fine = None

    def window(self, start_s: float, stop_s: float) -> tuple[FloatArray, Torque] | None:
        """Return centres, s, and torques of windows with centres in [start, stop).

        None if no window has its centre there.
        """
        return self._recent.window(start_s, stop_s)

    def fine_window(self, start_s: float, stop_s: float) -> tuple[FloatArray, Torque] | None:
        """Return torques of the shorter windows in [start, stop); None without any."""
        return None if self._fine is None else self._fine[1].window(start_s, stop_s)

    def refusal(self, side: Side, start_s: float, stop_s: float) -> InputError | None:
        """Return why a torque is missing in [start, stop): the refusing effect and its range.

        None if every reading was compensated.
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
        """Raise an error with the reason for a missing torque in [start, stop)."""
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
        """Number of windows by which a dynamic filter delays the torques."""
        dynamics = self.chain.dynamics
        return 0 if dynamics is None else dynamics.rows_late

    def states(self) -> tuple[EffectState, ...]:
        """Return every effect's state at the newest window; empty before the first window."""
        if (last := self._last) is None:
            return ()
        chain, readings, torque = last
        row = slice(len(torque) - 1, len(torque))
        return tuple(
            effect_states(chain, rows_of(readings, row), torque.at(np.arange(1) + row.start))
        )

    def switch_off(self, off: Sequence[str]) -> None:
        """Switch these corrections off from the next window on, and all others on."""
        self.chain = self.chain.switched("switched off at the bench", off)
        self._stream.chain = self.chain
        self._fine = None

    def standing(self) -> Torque:
        """Return the chain's torque for a reading of 0 in the stream's present state."""
        nothing = np.zeros(1)
        unloaded = Readings(
            nothing,
            counter_nm=nothing,
            speed_rpm=0.0,
            acceleration_rad_s2=0.0,
            temperature_c=np.nan,
        )
        return self._stream.copy().push(unloaded)


class _Torques:
    """Torques of the last two minutes, with one writer and many readers."""

    def __init__(self) -> None:
        self._recent: History | None = None
        self._components: tuple[Component, ...] = ()
        self._refused: deque[tuple[float, Readings]] = deque(maxlen=MOST_REFUSED)

    def append(self, time_s: FloatArray, torque: Torque, readings: Readings) -> None:
        """Keep the torques of a block, and its first reading that was refused."""
        if not time_s.size:
            return
        if self._recent is None:
            window_s = readings.window_s or LEAST_WINDOW_S
            self._recent = History(round(KEPT_S / window_s))
        self._components = torque.components
        self._recent.append(_record(time_s, torque))
        refused = _first_refused(time_s, torque, readings)
        if refused is not None:
            self._refused.append(refused)

    def refused(self, start_s: float, stop_s: float) -> Readings | None:
        """Return the first refused reading with its conditions; None if none was refused."""
        return next(
            (readings for at, readings in tuple(self._refused) if start_s <= at < stop_s), None
        )

    def window(self, start_s: float, stop_s: float) -> tuple[FloatArray, Torque] | None:
        """Return times and torques in [start, stop); None without any."""
        recent = None if self._recent is None else self._recent.window(start_s, stop_s)
        if recent is None or not len(recent):
            return None
        return recent.time_s, _torque(recent, self._components)


def _first_refused(
    time_s: FloatArray, torque: Torque, readings: Readings
) -> tuple[float, Readings] | None:
    """Return time and conditions of a block's first reading without a torque."""
    if not isnan(torque.value_nm.sum()):
        return None
    rows = np.flatnonzero(np.isnan(torque.value_nm) & np.isfinite(readings.reading_nm))
    if not rows.size:
        return None
    row = int(rows[0])
    return float(time_s[row]), rows_of(readings, slice(row, row + 1))


def _record(time_s: FloatArray, torque: Torque) -> Record:
    """Return torques as a record, with the uncertainties of their components as columns."""
    components, count = torque.components, time_s.size
    like: Values = torque.value_nm if count > 1 else torque.value_nm.item()
    uncertainty = in_columns(like, *[component.uncertainty_nm for component in components])
    added = in_columns(like, *[component.value_nm for component in components])
    places = [component.place for component in components if component.place is not None]
    columns: dict[str, NDArray[np.float64]] = {
        "time_s": time_s,
        "torque_nm": torque.value_nm,
        "uncertainty_nm": uncertainty,
        "added_nm": added,
    }
    if places:
        columns["place"] = np.concatenate(places, axis=1)
    return Record.unchecked(columns, count)


def _torque(record: Record, components: tuple[Component, ...]) -> Torque:
    """Return the torques of a record by `_record`; `components` are a template for their parts."""
    split: list[Component] = []
    next_place = 0
    for number, component in enumerate(components):
        place = component.place
        if place is not None:
            first, next_place = next_place, next_place + place.shape[1]
            place = np.ascontiguousarray(record["place"][:, first:next_place])
        split.append(
            component._replace(
                uncertainty_nm=np.ascontiguousarray(record["uncertainty_nm"][:, number]),
                value_nm=np.ascontiguousarray(record["added_nm"][:, number]),
                place=place,
            )
        )
    return Torque(record["torque_nm"], tuple(split))
