"""Counter over windows that are synchronous with an angle, as a stream."""

from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals.counters import StreamOptions, WindowStream
from torquebench.signals.edges import EdgeBlock
from torquebench.signals.faults import PulseTrainFault, SignalFaultKind
from torquebench.signals.samples import FrequencySamples
from torquebench.signals.windows import CounterMethod
from torquebench.units import TURN

__all__ = ["AngleCounter", "AngleSamples"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AngleSamples:
    """Frequency per window of angle.

    Parameters
    ----------
    angle_rad : float64 array, shape (n,)
        Centres of the windows in rad since the first mark, growing with every mark.
    speed_rad_s : float64 array, shape (n,)
        Mean speed over each window, from its length in time; without sign, as marks have none.
    frequency : FrequencySamples
        The windows' frequency, with their times.
    """

    angle_rad: NDArray[np.float64]
    speed_rad_s: NDArray[np.float64]
    frequency: FrequencySamples


class AngleCounter:
    """Counter whose windows begin and end at marks of an encoder on the same timebase.

    Each window spans this number of marks, so it averages over the same part of a rotation at any
    speed: effects periodic in that angle (spline, bearing, tooth) cancel exactly.

    Parameters
    ----------
    method : {"gated", "reciprocal", "regression", "triangular"}
        The counter.
    marks_per_window : int
        Marks (encoder periods) in a window.
    marks_per_revolution : int
        Marks in a revolution.
    timebase_hz : float
        Timebase of both channels in Hz.
    **options
        As for `WindowStream`: edge_jitter_s, both_edges, check_train, stuck_windows.

    Examples
    --------
    >>> counter = AngleCounter("regression", 90, 360, timebase_hz=100e6)
    >>> torque = EdgeBlock(np.arange(0, 2_000_000, 1600), 0, 2_000_000, 100e6)
    >>> marks = EdgeBlock(np.arange(5, 2_000_000, 5000), 0, 2_000_000, 100e6)
    >>> samples = counter.push(torque, marks)
    >>> samples.angle_rad / np.pi
    array([0.25, 0.75, 1.25, 1.75])
    >>> samples.frequency.frequency_hz
    array([62500., 62500., 62500., 62500.])
    """

    def __init__(
        self,
        method: CounterMethod,
        marks_per_window: int,
        marks_per_revolution: int,
        timebase_hz: float,
        **options: Unpack[StreamOptions],
    ) -> None:
        for name, value in (("window", marks_per_window), ("revolution", marks_per_revolution)):
            if value < 1:
                raise InputError(Message("{value} marks per {name}", value, name), "1 or more")
        self.marks_per_window = marks_per_window
        self.window_rad = TURN * marks_per_window / marks_per_revolution
        self._stream = WindowStream(method, timebase_hz, **options)
        self._marks = 0
        self._windows = 0
        self._border: int | None = None

    def push(self, block: EdgeBlock, marks: EdgeBlock) -> AngleSamples:
        """Take the next blocks of both channels; return the windows that they complete.

        Parameters
        ----------
        block : EdgeBlock
            Edges of the frequency to be counted.
        marks : EdgeBlock
            Edges of the encoder over the same interval.

        Raises
        ------
        InputError
            When the two don't cover the same interval of one timebase.
        PulseTrainFault
            When blocks are missing before these: without all marks there is no angle.
        """
        interval = (block.start_tick, block.stop_tick, block.timebase_hz)
        if (marks.start_tick, marks.stop_tick, marks.timebase_hz) != interval:
            raise InputError("blocks of different intervals", "both channels over the same one")
        last = self._stream.stop_tick
        if last is not None and block.start_tick > last:
            raise PulseTrainFault(
                SignalFaultKind.LOST_DATA,
                Message("no block from tick {last} to {start_tick}", last, block.start_tick),
                "a stream without gaps, since the angle is counted from its marks",
            )
        self._stream.accept(block)
        first = -self._marks % self.marks_per_window
        self._marks += len(marks)
        borders = marks.ticks[first :: self.marks_per_window]
        if self._border is not None:
            borders = np.concatenate(([self._border], borders))
        if borders.size:
            self._border = int(borders[-1])
        starts, stops = borders[:-1], borders[1:]
        next_start = block.stop_tick if self._border is None else self._border
        frequency = self._stream.count(block, starts, stops, next_start)
        number = self._windows + np.arange(starts.size)
        self._windows += starts.size
        return AngleSamples(
            angle_rad=np.asarray((number + 0.5) * self.window_rad),
            speed_rad_s=np.asarray(self.window_rad * block.timebase_hz / (stops - starts)),
            frequency=frequency,
        )
