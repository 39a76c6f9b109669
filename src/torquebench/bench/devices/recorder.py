"""Recorder of angles and torques of both sides at the same times."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from bluesky.protocols import Reading, Triggerable
from event_model import DataKey
from numpy.typing import NDArray
from ophyd_async.core import AsyncReadable, AsyncStatus, Device

from torquebench.bench.channels import FAST_WINDOW_S, FINE_WINDOW_S
from torquebench.bench.devices.context import BenchContext
from torquebench.bench.devices.data_keys import data_key
from torquebench.bench.roles import SIDES, Side, reference_channel, torque_channel
from torquebench.chain import SWITCHES, Torque, TorqueParts
from torquebench.errors import SignalFault
from torquebench.message import Message
from torquebench.signals import Record
from torquebench.units import DEG_PER_RAD, MS_PER_S, RAD_S_PER_RPM

FloatArray = NDArray[np.float64]

_LARGEST_JUMP_RAD: dict[Side, float] = {"input": 5e-3, "output": 5e-4}
"""Largest change of a side's angle within one sample beyond that by its present speed, rad."""


@dataclass(frozen=True, eq=False)
class SynchronousRecording:
    """Torques and angles of both sides in the counter's windows, or in finer ones.

    Parameters
    ----------
    time_s : float64[n]
        Bench time at which the torques acted (the transducers' group delay is subtracted), s.
    input_torque_nm, output_torque_nm : float64[n]
        Compensated torque if the side has an active model, else the reading, N·m.
    input_parts, output_parts : TorqueParts
        Standard uncertainty by the measuring chain, grouped by what shares the errors; NaN without
        an active chain.
    input_inertia_nm, output_inertia_nm : float64[n]
        The chain's correction by the inertia between transducer and flange, which the torques
        contain, N·m.
    input_angle_rad, output_angle_rad : float64[n]
        Mean angles of the same windows, unwrapped, rad.
    """

    time_s: FloatArray
    input_torque_nm: FloatArray
    output_torque_nm: FloatArray
    input_parts: TorqueParts
    output_parts: TorqueParts
    input_inertia_nm: FloatArray
    output_inertia_nm: FloatArray
    input_angle_rad: FloatArray
    output_angle_rad: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Concatenate recordings; without any, the columns are empty."""

        def column(name: str) -> Any:
            """Return an attribute of all parts as one."""
            columns = [getattr(part, name) for part in parts]
            if name.endswith("_parts"):
                return TorqueParts.joined(columns)
            return np.concatenate(columns or [np.zeros(0)])

        return cls(**{field.name: column(field.name) for field in fields(cls)})

    def torque_nm(self, side: Side) -> FloatArray:
        """Torque of a side, N·m."""
        return self.input_torque_nm if side == "input" else self.output_torque_nm

    def parts(self, side: Side) -> TorqueParts:
        """Return the standard uncertainty of a side's torque; NaN without an active chain."""
        return self.input_parts if side == "input" else self.output_parts

    def angle_rad(self, side: Side) -> FloatArray:
        """Angle of a side, rad."""
        return self.input_angle_rad if side == "input" else self.output_angle_rad


class _SideTorque(NamedTuple):
    """Torques of one side with their times, their uncertainty, and their correction by inertia."""

    time_s: FloatArray
    torque_nm: FloatArray
    parts: TorqueParts
    inertia_nm: FloatArray


class Recorder(Device, AsyncReadable, Triggerable):
    """Recorder of the bench's torques and angles over intervals.

    `set("mark")` begins an interval, `trigger()` ends it; `taken` and `angles` then hold its
    samples, and the next interval begins. `set("fine")` does the same with windows of
    `FINE_WINDOW_S` for the torques, which begin with the next block: set it a block earlier than
    needed. An instrument with its own counter has fixed windows. `set("input")` or `set("output")`
    counts that side and its side of the mounted standard in windows of `FAST_WINDOW_S`, as `fast`.
    The event stores only start, end and number of samples. The run's raw stream has the bench's
    windows, but no shorter ones: these are in the recording of a reducer test and the table of a
    turning run.
    """

    def __init__(self, context: BenchContext, name: str = "recorder") -> None:
        self._context = context
        self._start_s = self._stop_s = 0.0
        self._fine = False
        self._fast_side: Side | None = None
        self._stamp_s = time.time()
        self.taken: SynchronousRecording | None = None
        self.angles: dict[Side, Record] = {}
        self.modules: dict[Side, Record] = {}
        self.fast: Record | None = None
        super().__init__(name=name)

    @AsyncStatus.wrap
    async def set(self, value: Literal["mark", "fine"] | Side) -> None:
        """Begin an interval now, in the bench's windows or in shorter ones."""
        self._fine = value == "fine" and self._window_s > FINE_WINDOW_S
        self._fast_side = value if value in SIDES else None
        self._count_finely()
        self._start_s = self._context.clock.now()
        self.taken, self.angles, self.modules, self.fast = None, {}, {}, None

    @property
    def _window_s(self) -> float:
        return self._context.description.counter.window_s

    def _count_finely(self) -> None:
        """Let the channels of this recording count shorter windows in addition."""
        if self._fine:
            for side in SIDES:
                channel = self._context.acquisition.channel(torque_channel(side))
                channel.count_finely(FINE_WINDOW_S)
        if self._fast_side is not None:
            self._context.acquisition.use_reference(self._fast_side)
            for name in self._fast_channels(self._fast_side):
                self._context.acquisition.channel(name).count_finely(FAST_WINDOW_S)

    def _fast_channels(self, side: Side) -> tuple[str, str]:
        return torque_channel(side), reference_channel(side)

    @AsyncStatus.wrap
    async def trigger(self) -> None:
        """End the interval now, and keep its samples.

        Raises
        ------
        SignalFault
            A torque has a fault, an encoder jumped, or the interval is older than the kept samples.
        InputError
            An effect of the measuring chain refuses a reading.
        """
        self._context.supervisor.raise_if_latched()
        if self._fast_side is not None:
            self._stop_s = self._context.clock.now()
            self.fast = self._fast(self._fast_side, self._start_s, self._stop_s)
            self._count_finely()
            self._stamp_s = time.time()
            return
        start_s, self._stop_s = self._start_s, self._context.clock.now()
        self.angles = {
            side: self._context.acquisition.angles(side, start_s, self._stop_s) for side in SIDES
        }
        for side, samples in self.angles.items():
            _check_jumps(side, samples)
        self.taken = self._recording(start_s, self._stop_s)
        self.modules = {side: self._module(side, start_s, self._stop_s) for side in SIDES}
        self._count_finely()
        self._stamp_s = time.time()

    def _fast(self, side: Side, start_s: float, stop_s: float) -> Record:
        """Return time, reading and the standard's torque (N·m) in windows of `FAST_WINDOW_S`."""
        expected = int((stop_s - start_s) / FAST_WINDOW_S) - 2
        records: list[Record] = []
        for name in self._fast_channels(side):
            channel = self._context.acquisition.channel(name)
            # the interval's last window is complete only with the next block
            record = channel.fine_window(start_s - FAST_WINDOW_S, stop_s - FAST_WINDOW_S)
            if record is None or len(record) < expected:
                raise SignalFault(
                    Message(
                        "{name}: {size} windows of {fast_window_s:g} ms from {start_s:.2f} "
                        "to {stop_s:.2f} s",
                        name,
                        0 if record is None else len(record),
                        MS_PER_S * FAST_WINDOW_S,
                        start_s,
                        stop_s,
                    ),
                    Message("{expected}, from edges on the counter card", expected),
                    "wire transducer and standard to the counter card",
                )
            records.append(record.raise_on_fault(name))
        count = min(map(len, records))
        module, standard = (record.at(slice(count)) for record in records)
        if count and np.max(np.abs(module.time_s - standard.time_s)) > 0.01 * FAST_WINDOW_S:
            raise SignalFault(
                Message(
                    "windows of the {side} module and of the standard at different times", side
                ),
                "the same windows",
                "repeat the run",
            )
        columns = ("reading_nm", module["reading_nm"]), ("standard_nm", standard["reading_nm"])
        return Record({"time_s": module.time_s, **dict(columns)})

    def _module(self, side: Side, start_s: float, stop_s: float) -> Record:
        """Return time, reading, speed and angle of a module in the counter's windows."""
        context, half_s = self._context, 0.5 * self._window_s
        # angles end with the interval
        record = context.acquisition.window(torque_channel(side), start_s - half_s, stop_s - half_s)
        acted_s = record.time_s - context.description.module(side).transducer.group_delay_s
        angles = context.acquisition.angles(side, start_s - 2.0 * self._window_s, stop_s)
        at, angle = angles.time_s, angles["angle_rad"]
        first, last = (np.interp(acted_s + shift, at, angle) for shift in (-half_s, half_s))
        return Record(
            {
                "time_s": acted_s,
                "reading_nm": record["reading_nm"],
                "speed_rpm": (last - first) / (2.0 * half_s * RAD_S_PER_RPM),
                "angle_rad": np.interp(acted_s, at, angle),
            }
        )

    def _recording(self, start_s: float, stop_s: float) -> SynchronousRecording:
        """Return both sides' torques and shaft angles in the same windows of an interval."""
        fine = [self._fine_torque(side, start_s, stop_s) for side in SIDES]
        window_s, first, second = self._window_s, fine[0], fine[1]
        if first is None or second is None:
            first, second = (self._torque(side, start_s, stop_s) for side in SIDES)
        else:
            window_s = FINE_WINDOW_S
        length = min(first.time_s.size, second.time_s.size)
        time_s = first.time_s[:length]
        angle = {side: _window_angle(self.angles[side], time_s, window_s) for side in SIDES}
        return SynchronousRecording(
            time_s,
            first.torque_nm[:length],
            second.torque_nm[:length],
            first.parts.at(slice(length)),
            second.parts.at(slice(length)),
            first.inertia_nm[:length],
            second.inertia_nm[:length],
            angle["input"],
            angle["output"],
        )

    def _fine_torque(self, side: Side, start_s: float, stop_s: float) -> _SideTorque | None:
        """Return `_torque` from fine windows; None if some weren't counted."""
        if not self._fine:
            return None
        channel = self._context.acquisition.channel(torque_channel(side))
        record = channel.fine_window(start_s, stop_s)
        if record is None or len(record) < int((stop_s - start_s) / FINE_WINDOW_S) - 2:
            return None
        record.raise_on_fault(channel.name)
        active = self._context.acquisition.compensation(side)
        torque = None if active is None else active.fine_window(start_s, stop_s)
        if active is not None and torque is None:
            return None
        return self._columns(side, record, torque)

    def _torque(self, side: Side, start_s: float, stop_s: float) -> _SideTorque:
        """Return a side's torque in the usual windows; refuse an interval with gaps."""
        channel = torque_channel(side)
        record = self._context.acquisition.window(channel, start_s, stop_s)
        expected = max(int((stop_s - start_s) / self._window_s) - 2, 1)
        if len(record) < expected:
            raise SignalFault(
                Message(
                    "{channel}: {count} windows from {start:.2f} to {stop:.2f} s",
                    channel,
                    len(record),
                    start_s,
                    stop_s,
                ),
                Message("at least {limit}", expected),
                "record shorter intervals: acquisition keeps the last two minutes",
            )
        active = self._context.acquisition.compensation(side)
        torque = None if active is None else active.window(start_s, stop_s)
        if active is not None and torque is None:
            active.refuse(side, start_s, stop_s)
        return self._columns(side, record, torque)

    def _columns(
        self, side: Side, record: Record, compensated: tuple[FloatArray, Torque] | None
    ) -> _SideTorque:
        """Return a side's torque, compensated if possible, at the times at which it acted."""
        delay_s = self._context.description.module(side).transducer.group_delay_s
        if compensated is None:
            unknown = TorqueParts(*[np.full(len(record), np.nan)] * len(fields(TorqueParts)))
            inertia_nm = np.zeros(len(record))
            return _SideTorque(record.time_s - delay_s, record["reading_nm"], unknown, inertia_nm)
        time_s, torque = compensated
        if not torque.has_number.all():
            active = self._context.acquisition.compensation(side)
            assert active is not None
            active.refuse(side, float(time_s[0]), np.nextafter(time_s[-1], np.inf))
        return _SideTorque(
            time_s - delay_s,
            torque.value_nm,
            TorqueParts.of(torque),
            np.sum([torque.added(name) for name in SWITCHES["inertia"]], axis=0),
        )

    async def read(self) -> dict[str, Reading]:
        """Return start and end of the last interval."""
        values = {
            "start_s": self._start_s,
            "stop_s": self._stop_s,
            "samples": sum(
                record.time_s.size for record in (self.taken, self.fast) if record is not None
            ),
        }
        self._start_s = self._stop_s
        return {
            f"{self.name}-{field}": Reading(value=value, timestamp=self._stamp_s)
            for field, value in values.items()
        }

    async def describe(self) -> dict[str, DataKey]:
        """Describe the fields."""
        kinds = {"start_s": float, "stop_s": float, "samples": int}
        return {
            f"{self.name}-{field}": data_key(f"bench://recorder/{field}", field, kind)
            for field, kind in kinds.items()
        }


def _window_angle(samples: Record, time_s: FloatArray, window_s: float) -> FloatArray:
    """Mean angle over windows: a moving mean, interpolated between its samples."""
    angle, at = samples["angle_rad"], samples.time_s
    if at.size < 2:
        raise SignalFault("no angle in the recorded interval", "samples in every window")
    step = (at[-1] - at[0]) / (at.size - 1)
    width = int(np.clip(round(window_s / step), 1, at.size))
    total = np.concatenate(([0.0], np.cumsum(angle - angle[0])))
    mean = (total[width:] - total[:-width]) / width + angle[0]
    centre = at[: mean.size] + 0.5 * (width - 1) * step
    return _interpolated(time_s, centre, mean)


def _interpolated(time_s: FloatArray, at: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate linearly, and extrapolate beyond both ends (by half a window at most)."""
    inside = np.interp(time_s, at, values)
    if at.size < 2:
        return inside
    early, late = time_s < at[0], time_s > at[-1]
    first = (values[1] - values[0]) / (at[1] - at[0])
    last = (values[-1] - values[-2]) / (at[-1] - at[-2])
    inside[early] = values[0] + first * (time_s[early] - at[0])
    inside[late] = values[-1] + last * (time_s[late] - at[-1])
    return inside


def _check_jumps(side: Side, samples: Record) -> None:
    """Refuse an angle that jumps by more than a shaft can turn within one sample."""
    if len(samples) < 3:
        return
    change = np.diff(samples["angle_rad"])
    jump = np.abs(np.diff(change))
    worst = int(np.argmax(jump))
    limit = _LARGEST_JUMP_RAD[side]
    if jump[worst] > limit:
        degrees = jump[worst] * DEG_PER_RAD
        raise SignalFault(
            Message(
                "the {side} encoder slips: {degrees:.4g}° within one sample at {time:.3f} s",
                side,
                degrees,
                samples.time_s[worst + 1],
            ),
            Message("at most {limit:.3g}° beyond the present speed", limit * DEG_PER_RAD),
            "check the encoder's coupling, its cable and the counts per revolution",
        )
