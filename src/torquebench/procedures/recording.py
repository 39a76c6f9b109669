"""Record all signals for some time, without moving anything."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import bluesky.preprocessors as bpp

from torquebench.bench.devices import BenchDevices
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.procedures.messages import progress, sleep
from torquebench.procedures.setup import Plan
from torquebench.units import DAY

__all__ = ["LONGEST_RECORDING_S", "RecordedSpan", "record_signals"]

POLL_INTERVAL_S = 0.1
LONGEST_RECORDING_S = DAY


@dataclass(frozen=True)
class RecordedSpan:
    """Time range of a recording.

    Parameters
    ----------
    start_s, stop_s : float
        Bench time, s; data recorded before the start aren't included.
    """

    start_s: float
    stop_s: float


def record_signals(
    devices: BenchDevices, ended: threading.Event, *, duration_s: float | None = None
) -> Plan[RecordedSpan]:
    """Wait until the recording is ended, while the run's folder stores every sample.

    Parameters
    ----------
    devices : BenchDevices
    ended : threading.Event
        Set to end the recording.
    duration_s : float, optional
        Duration after which the recording ends; by default it ends with `ended`, or after a day.

    Raises
    ------
    InputError
        The duration isn't positive, or is longer than a day.
    """
    longest_s = LONGEST_RECORDING_S if duration_s is None else duration_s
    if not 0.0 < longest_s <= LONGEST_RECORDING_S:
        raise InputError(
            Message("a recording of {longest_s:g} s", longest_s),
            Message("at most {timeout_s:g} s", LONGEST_RECORDING_S),
        )
    clock = devices.context.clock

    def waiting() -> Plan[None]:
        start_s = clock.now()
        while (left_s := start_s + longest_s - clock.now()) > 0.0 and not ended.is_set():
            gone_s = int(clock.now() - start_s)
            text = Message("{gone_s} s recorded", gone_s)
            yield from progress(gone_s, 0 if duration_s is None else round(longest_s), text)
            if clock.fast and duration_s is None:  # otherwise a whole day would pass at once
                ended.wait(POLL_INTERVAL_S)
            yield from sleep(min(POLL_INTERVAL_S, left_s))
        spans.append(RecordedSpan(start_s, clock.now()))

    spans: list[RecordedSpan] = []
    yield from bpp.run_wrapper(waiting())
    return spans[0]
