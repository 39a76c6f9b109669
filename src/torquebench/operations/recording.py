"""Recordings of all signals on demand, started at once, at a time or by a trigger."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Literal, get_args

from torquebench import campaign
from torquebench.bench.roles import SIDES, reference_channel, torque_channel
from torquebench.columns import column_of
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.operations.operation import Moment, Number, Operation, Request, field, plain_text
from torquebench.operations.place import EndedError, Place
from torquebench.operations.result import Result
from torquebench.progress import Progress
from torquebench.station.journal import WAITING_BLOCKS
from torquebench.station.recording import LONGEST_BEFORE_S, RunRecord
from torquebench.units import DAY, RPM_PER_RAD_S, unit_of_name

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from torquebench.bench.blocks import Block
    from torquebench.station.recording import OpenRun, RunEnd

POLL_INTERVAL_S = 0.2
TriggerSignal = Literal[
    "output_torque_nm",
    "output_raw_nm",
    "output_speed_rpm",
    "input_torque_nm",
    "input_raw_nm",
    "input_speed_rpm",
]
TRIGGER_SIGNALS: tuple[TriggerSignal, ...] = get_args(TriggerSignal)


class Trigger(Request):
    """A level that a signal has to cross."""

    signal: TriggerSignal
    level: Number
    direction: Literal["rising", "falling"] = "rising"


class RecordRequest(Request):
    """Record all signals beside whatever the bench does; nothing is moved.

    It begins at once, at the trigger, or at a set time, and ends after its duration or when a
    person finishes it.
    """

    name: Annotated[str, field("Name of the recording.", min_length=1, max_length=80)]
    note: Annotated[str, field("Note to it.", max_length=500)] = ""
    duration_s: Annotated[
        Number | None, field("Duration; without it, until a person finishes it.", gt=0, le=DAY)
    ] = None
    before_s: Annotated[
        Number, field("Time before the start that is recorded, too.", ge=0, le=LONGEST_BEFORE_S)
    ] = 0.0
    trigger: Annotated[
        Trigger | None, field("Level that a signal has to cross before the recording begins.")
    ] = None
    at: Annotated[Moment | None, field("Time at which the recording begins.")] = None


@dataclass(frozen=True, kw_only=True)
class RecordingResult(Result):
    """A recording; `trigger` describes its start, `missed_s` is time without samples."""

    name: str
    note: str
    seconds_s: float
    before_s: float
    missed_s: float
    trigger: str


def crossing(
    time_s: NDArray[np.float64],
    value: NDArray[np.float64],
    level: float,
    *,
    rising: bool,
    armed: bool,
) -> tuple[float | None, bool]:
    """Return when a signal first crosses a level, and whether the trigger is armed afterwards.

    Parameters
    ----------
    time_s, value : float64[n]
        Times and values; NaN values are ignored.
    level : float
    rising : bool
    armed : bool
        Whether the signal was on the near side of the level before; a level that is exceeded from
        the beginning isn't a crossing.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(4.0)
    >>> crossing(time, np.array([3.0, 1.0, 2.0, 5.0]), 4.0, rising=True, armed=False)
    (3.0, False)
    >>> crossing(time, np.array([9.0, 8.0, 7.0, 6.0]), 4.0, rising=True, armed=False)
    (None, False)
    """
    for moment, number in zip(time_s.tolist(), value.tolist(), strict=True):
        if number != number:
            continue
        beyond = number >= level if rising else number <= level
        if beyond and armed:
            return moment, False
        armed = not beyond
    return None, armed


def _signal(block: Block, name: TriggerSignal) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and values of a signal in a block."""
    import numpy as np

    side: Literal["input", "output"] = "input" if name.startswith("input") else "output"
    if name.endswith("_rpm"):
        speed = block.speed_rad_s(side) * RPM_PER_RAD_S
        return np.array([block.stop_s]), np.array([speed])
    windows = torque_windows(block).get(name)
    return (np.empty(0), np.empty(0)) if windows is None else (windows.time_s, windows.value_nm)


@dataclass(frozen=True)
class SignalWindows:
    """Times and torques of a signal's windows."""

    time_s: NDArray[np.float64]
    value_nm: NDArray[np.float64]


def torque_windows(block: Block) -> dict[str, SignalWindows]:
    """Return the windows of each torque signal in a block."""
    found: dict[str, SignalWindows] = {}
    for side in SIDES:
        channels = {"raw": torque_channel(side), "reference": reference_channel(side)}
        for name, channel in channels.items():
            record = block.records.get(channel)
            if record is not None:
                found[f"{side}_{name}_nm"] = SignalWindows(record.time_s, record["reading_nm"])
        compensated = block.torques.get(side)
        raw = found.get(f"{side}_raw_nm")
        if compensated is not None and raw is not None and len(compensated) == raw.time_s.size:
            found[f"{side}_torque_nm"] = SignalWindows(raw.time_s, compensated.value_nm)
    return found


def run_record(place: Place, request: RecordRequest, progress: Progress) -> RecordingResult:
    """Wait for the start and record the live stream until the end, whatever else the bench does."""
    stream = _Stream(place, request)
    try:
        start_s, trigger = _await_start(stream, request, progress)
        name, note = plain_text(request.name, 80), plain_text(request.note, 500)
        run = place.station.open_run(
            "recording",
            {
                "operator": place.operator,
                "signature": place.signature,
                "title": name,
                "note": note,
                "trigger": trigger,
                "before_s": request.before_s,
            },
        )
        span = _recorded(stream, run, request, start_s, progress)
    finally:
        stream.close()
    seconds = span.stop_s - span.start_s
    headline = Message("Recorded {seconds:.1f} s: {name}", seconds, name)
    if span.missed_s:
        headline = Message(
            "{headline}; {missed:.1f} s are missing, because the disk was too slow",
            headline,
            span.missed_s,
        )
    return RecordingResult(
        headline=headline,
        simulated=place.station.description.simulated,
        run_ids=(run.writer.run_id,),
        name=name,
        note=note,
        seconds_s=seconds,
        before_s=request.before_s,
        missed_s=span.missed_s,
        trigger=trigger,
    )


@dataclass(frozen=True)
class RecordedSpan:
    """Time range of a recording, stored as its results.

    Parameters
    ----------
    start_s, stop_s : float
        Bench time, s; data recorded before the start aren't included.
    missed_s : float
        Time whose samples are missing, s.
    """

    start_s: float
    stop_s: float
    missed_s: float


class _Stream:
    """The live stream of a recording: its blocks one by one, and those before its start."""

    def __init__(self, place: Place, request: RecordRequest) -> None:
        station = place.station
        self.place, self.clock, self._acquisition = place, station.clock, station.acquisition
        self._before_s, self.block_s = request.before_s, station.description.counter.block_s
        self.past: deque[Block] = deque()
        self._viewer = self._acquisition.add_viewer(
            WAITING_BLOCKS, before_s=request.before_s, complete=True
        )

    def next(self) -> Block | None:
        """Return the next block; None if none came for a moment."""
        block = self._viewer.get(POLL_INTERVAL_S)
        if block is None and not self._acquisition.running:
            raise BenchError("acquisition has ended", "a running acquisition", "open it again")
        if block is None and self.clock.fast:  # nobody else may need the bench to go on
            self.clock.require(self.clock.now() + POLL_INTERVAL_S)
        return block

    def wait(self) -> Block | None:
        """Return the next block before the start, and keep it as long as it may be recorded."""
        self.place.check()
        if self.place.finishing.is_set():
            raise EndedError("ended before the recording began")
        block = self.next()
        if block is not None:
            self.past.append(block)
            while self.past[0].stop_s < block.stop_s - self._before_s - self.block_s:
                self.past.popleft()
        return block

    def close(self) -> None:
        """Take no more blocks."""
        self._acquisition.remove_viewer(self._viewer)


def _await_start(stream: _Stream, request: RecordRequest, progress: Progress) -> tuple[float, str]:
    """Wait for the start of the recording; return its bench time, and the cause."""
    now_s = stream.clock.now()
    if request.at is not None:
        progress.start("Waiting for the moment")
        while request.at > datetime.now(UTC):
            stream.wait()
        return stream.clock.now(), Message("at {at:%Y-%m-%d %H:%M:%S} UTC", request.at)
    if request.trigger is None:
        return now_s, "by hand"
    trigger = request.trigger
    words = Message(
        "{signal} {direction} through {level:g} {unit}",
        column_of(trigger.signal).title,
        trigger.direction,
        trigger.level,
        unit_of_name(trigger.signal),
    )
    progress.start("Waiting for the trigger")
    progress.reach(0, words)
    armed, crossed_s = False, None
    while crossed_s is None or crossed_s < now_s:
        block = stream.wait()
        if block is not None:
            crossed_s, armed = crossing(
                *_signal(block, trigger.signal),
                trigger.level,
                rising=trigger.direction == "rising",
                armed=armed,
            )
    return crossed_s, words


def _recorded(
    stream: _Stream, run: OpenRun, request: RecordRequest, start_s: float, progress: Progress
) -> RecordedSpan:
    """Write the blocks from before the start until the end, and seal the run."""
    place = stream.place
    progress.start("Recording", None if request.duration_s is None else round(request.duration_s))
    status: RunEnd = "failed"
    reason: str = ""
    try:
        try:
            span = _written(stream, run, request, start_s, progress)
            run.writer.write_results(span)
            status, reason = ("aborted" if place.cancelled() else "completed"), place.cancelled()
        except BaseException as error:
            reason = Message.of(error)
            raise
        finally:
            run.seal(status, reason)
    finally:
        run.release()
    if status == "aborted":
        folder = run.writer.path
        raise campaign.RunAbortedError(
            RunRecord(run.writer.run_id, "recording", folder, "abort", reason=reason)
        )
    return span


def _written(
    stream: _Stream, run: OpenRun, request: RecordRequest, start_s: float, progress: Progress
) -> RecordedSpan:
    """Write the blocks of a recording until it ends."""
    place, journal = stream.place, run.journal()
    begin_s, stop_s = start_s - request.before_s, start_s + (request.duration_s or DAY)
    if stream.clock.fast and request.duration_s is not None:
        stream.clock.require(stop_s)
    missed_s, reached_s, told = 0.0, begin_s, -1
    while reached_s < stop_s - 1e-9:
        if place.finishing.is_set() or place.cancelled():
            stop_s = min(stop_s, stream.clock.now())
        block = stream.past.popleft() if stream.past else stream.next()
        if block is None or block.stop_s <= begin_s + 1e-9 or block.start_s >= stop_s - 1e-9:
            continue
        low_s, high_s = max(block.start_s, begin_s), min(block.stop_s, stop_s)
        if block.stop_s - block.start_s > high_s - low_s + stream.block_s:  # joined in fast time
            block = block.part(low_s, high_s)
        journal.write(block)
        if reached_s > begin_s:
            missed_s += max(0.0, block.start_s - reached_s)
        reached_s = block.stop_s
        gone_s = int(max(0.0, reached_s - start_s))
        if gone_s != told:
            told = gone_s
            progress.reach(gone_s, Message("{gone_s} s recorded", gone_s))
    return RecordedSpan(start_s, min(stop_s, reached_s), round(missed_s, 3))


RECORD = Operation(
    "record",
    RecordRequest,
    run_record,
    lambda request: Message("Recording {plain}", plain_text(request.name, 80)),
    where="bench",
    beside=True,
    can_finish=True,
)
