"""Recordings of all signals on demand, started at once, at a time or by a trigger."""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Literal, get_args

from torquebench import campaign
from torquebench.bench.roles import SIDES, reference_channel, torque_channel
from torquebench.message import Message
from torquebench.operations.operation import Moment, Number, Operation, Request, field, plain_text
from torquebench.operations.place import EndedError, Place
from torquebench.operations.result import Result
from torquebench.progress import Progress
from torquebench.station.recording import LONGEST_BEFORE_S
from torquebench.units import DAY, RPM_PER_RAD_S, unit_of_name

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from torquebench.bench.blocks import Block, Viewer

__all__ = ["RECORD", "TRIGGER_SIGNALS", "RecordRequest", "SignalWindows", "Trigger", "crossing"]

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
    """Record all signals; nothing is moved.

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
    """A recording; `trigger` describes its start."""

    name: str
    note: str
    seconds_s: float
    before_s: float
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
    """Wait for the start, and record until the end."""
    from torquebench.procedures.recording import record_signals

    station = place.station
    name, note = plain_text(request.name, 80), plain_text(request.note, 500)
    began_s, trigger = _begin(place, request, progress)
    total = None if request.duration_s is None else round(request.duration_s)
    progress.start("Recording", total)
    record = station.run(
        record_signals(station.devices, place.finishing, duration_s=request.duration_s),
        kind="recording",
        metadata={
            "operator": place.operator,
            "signature": place.signature,
            "title": name,
            "note": note,
            "trigger": trigger,
            "before_s": request.before_s,
        },
        progress=progress,
        before_s=request.before_s + max(0.0, station.clock.now() - began_s),
    )
    if record.exit_status != "success":
        raise campaign.RunAbortedError(record)
    seconds = record.result.stop_s - record.result.start_s
    return RecordingResult(
        headline=Message("Recorded {seconds:.1f} s: {name}", seconds, name),
        simulated=station.description.simulated,
        run_ids=(record.run_id,),
        name=name,
        note=note,
        seconds_s=seconds,
        before_s=request.before_s,
        trigger=trigger,
    )


def _begin(place: Place, request: RecordRequest, progress: Progress) -> tuple[float, str]:
    """Wait for the start of the recording; return its bench time, and the cause."""
    if request.at is not None:
        progress.start("Waiting for the moment")
        while (left_s := (request.at - datetime.now(UTC)).total_seconds()) > 0.0:
            _check_wanted(place)
            time.sleep(min(POLL_INTERVAL_S, left_s))
        return place.station.clock.now(), Message("at {at:%Y-%m-%d %H:%M:%S} UTC", request.at)
    if request.trigger is None:
        return place.station.clock.now(), "by hand"
    viewer = place.station.acquisition.add_viewer(400)
    try:
        return _await_level(place, request.trigger, viewer, progress)
    finally:
        place.station.acquisition.remove_viewer(viewer)


def _await_level(
    place: Place, trigger: Trigger, viewer: Viewer, progress: Progress
) -> tuple[float, str]:
    words = Message(
        "{signal} {direction} through {level:g} {unit}",
        trigger.signal,
        trigger.direction,
        trigger.level,
        unit_of_name(trigger.signal),
    )
    progress.start("Waiting for the trigger")
    progress.reach(0, words)
    armed = False
    while True:
        _check_wanted(place)
        block = viewer.get(timeout_s=POLL_INTERVAL_S)
        if block is None:
            continue
        crossed_s, armed = crossing(
            *_signal(block, trigger.signal),
            trigger.level,
            rising=trigger.direction == "rising",
            armed=armed,
        )
        if crossed_s is not None:
            return crossed_s, words


def _check_wanted(place: Place) -> None:
    place.check()
    if place.finishing.is_set():
        raise EndedError("ended before the recording began")


RECORD = Operation(
    "record",
    RecordRequest,
    run_record,
    lambda request: Message("Recording {plain}", plain_text(request.name, 80)),
    where="bench",
    can_finish=True,
)
