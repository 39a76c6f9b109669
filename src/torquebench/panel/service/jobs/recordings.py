"""Recordings on demand: all signals, under a name, from now or from a trigger on.

`jobs.details` has the types of their details.
"""

from __future__ import annotations

import time
from datetime import UTC, datetime
from typing import Annotated, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from torquebench.bench.blocks import Block, Viewer
from torquebench.campaign.measuring import RunAbortedError
from torquebench.message import Message
from torquebench.panel.run_in_process import ProcessEndedError
from torquebench.panel.service.fields import Moment, Number, plain
from torquebench.panel.service.jobs.details import RecordingDetails
from torquebench.panel.service.jobs.runner import JobContext, JobKind, JobRequest
from torquebench.panel.service.jobs.values import JobResult
from torquebench.panel.service.live.hub import torque_windows
from torquebench.procedures.recording import LONGEST_RECORDING_S, record_signals
from torquebench.station import LONGEST_BEFORE_S
from torquebench.units import RPM_PER_RAD_S, unit_of_name

__all__ = ["RECORDING_KINDS", "TRIGGER_SIGNALS", "RecordRequest", "Trigger", "crossing"]

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


class Trigger(JobRequest):
    """A level that a signal has to pass."""

    signal: TriggerSignal
    level: Number
    direction: Literal["rising", "falling"] = "rising"


class RecordRequest(JobRequest):
    """Record all signals; nothing is moved.

    It begins at once, when `trigger` is met, or at the moment `at`, and ends after `duration_s`, or
    when it is finished (`POST /jobs/{job_id}/finish`). The `before_s` before the start are
    recorded, too.
    """

    name: Annotated[str, Field(min_length=1, max_length=80)]
    note: Annotated[str, Field(max_length=500)] = ""
    duration_s: Annotated[Number, Field(gt=0, le=LONGEST_RECORDING_S)] | None = None
    before_s: Annotated[Number, Field(ge=0, le=LONGEST_BEFORE_S)] = 0.0
    trigger: Trigger | None = None
    at: Moment | None = None


def crossing(
    time_s: NDArray[np.float64],
    value: NDArray[np.float64],
    level: float,
    *,
    rising: bool,
    armed: bool,
) -> tuple[float | None, bool]:
    """Return when a level is passed first, and whether the signal is on the near side at the end.

    Parameters
    ----------
    time_s, value : float64[n]
        NaN isn't a value.
    level : float
    rising : bool
    armed : bool
        Whether the signal was on the near side before: a level that is exceeded from the
        beginning isn't passed.

    Examples
    --------
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
    side: Literal["input", "output"] = "input" if name.startswith("input") else "output"
    if name.endswith("_rpm"):
        speed = block.speed_rad_s(side) * RPM_PER_RAD_S
        return np.array([block.stop_s]), np.array([speed])
    windows = torque_windows(block).get(name)
    return (np.empty(0), np.empty(0)) if windows is None else (windows.time_s, windows.value_nm)


def run_record(context: JobContext, request: RecordRequest) -> JobResult:
    """Wait for the trigger, and record until the end."""
    station, job = context.station, context.job
    name, note = plain(request.name, 80), plain(request.note, 500)
    began_s, trigger = _begin(context, request)
    job.start("Recording", None if request.duration_s is None else round(request.duration_s))
    record = station.run(
        record_signals(station.devices, job.finishing, duration_s=request.duration_s),
        kind="recording",
        metadata={
            "operator": context.actor.label,
            "title": name,
            "note": note,
            "trigger": trigger,
            "before_s": request.before_s,
        },
        progress=job,
        before_s=request.before_s + max(0.0, station.clock.now() - began_s),
    )
    if record.exit_status != "success":
        raise RunAbortedError(record)
    seconds = record.result.stop_s - record.result.start_s
    return JobResult(
        headline=Message("Recorded {seconds:.1f} s: {name}", seconds, name),
        simulated=station.description.simulated,
        run_ids=(record.run_id,),
        details=RecordingDetails(seconds, request.before_s, name, note, trigger),
    )


def _begin(context: JobContext, request: RecordRequest) -> tuple[float, str]:
    """Wait for the start of the recording; return its bench time, and the cause."""
    if request.at is not None:
        context.job.start("Waiting for the moment")
        while (left_s := (request.at - datetime.now(UTC)).total_seconds()) > 0.0:
            _still_wanted(context)
            time.sleep(min(POLL_INTERVAL_S, left_s))
        return context.station.clock.now(), Message("at {at:%Y-%m-%d %H:%M:%S} UTC", request.at)
    if request.trigger is None:
        return context.station.clock.now(), "by hand"
    viewer = context.station.acquisition.add_viewer(400)
    try:
        return _await_level(context, request.trigger, viewer)
    finally:
        context.station.acquisition.remove_viewer(viewer)


def _await_level(context: JobContext, trigger: Trigger, viewer: Viewer) -> tuple[float, str]:
    unit = unit_of_name(trigger.signal)
    said = Message(
        "{signal} {direction} through {level:g} {unit}",
        trigger.signal,
        trigger.direction,
        trigger.level,
        unit,
    )
    context.job.start("Waiting for the trigger")
    context.job.reach(0, said)
    armed = False
    while True:
        _still_wanted(context)
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
            return crossed_s, said


def _still_wanted(context: JobContext) -> None:
    context.check()
    if context.job.finishing.is_set():
        raise ProcessEndedError("ended before the recording began")


RECORDING_KINDS: tuple[JobKind, ...] = (
    JobKind(
        "record",
        lambda asked: Message("Recording {plain}", plain(asked.name, 80)),
        RecordRequest,
        run_record,
        moves=False,
        can_pause=False,
        can_finish=True,
    ),
)
