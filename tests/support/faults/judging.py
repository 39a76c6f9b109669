"""What must hold after a fault: drives off, a name for it, a readable record, no wrong number.

A problem begins with what it is: unsafe, stranded (a run or a point), wrong (a number), false alarm
or other.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from tests.support.faults.procedures import REDUCER

from torquebench.bench.audit.chain import AUDIT_FILE
from torquebench.bench.audit.entries import read_audit
from torquebench.bench.description import BenchDescription
from torquebench.bench.safety import Alarm, AlarmKind
from torquebench.campaign.reducers.quantities import ReducerTestQuantity
from torquebench.campaign.reducers.results import ReducerTestRecord
from torquebench.errors import RecordError, TorquebenchError
from torquebench.procedures.reducers.turning import TransmissionRecording
from torquebench.records import RunFolder
from torquebench.station import Station

__all__ = [
    "Outcome",
    "await_safe",
    "checked",
    "differing",
    "ended_badly",
    "record_of",
    "slipped",
    "status_of",
    "unsafe_end",
]

READING_PERCENT = 2.0
"""How far a reading may be from the truth without compensation, % of range (a drift of the zero
before it was measured included)."""
STANDARD_PERCENT = 0.15
ANGLE_DEG = 0.1
"""How far both angles of a reducer may be apart over a revolution, degrees of the output."""
Status = Literal["stopped", "refused", "harmless", "recovered", "too late"]


@dataclass(frozen=True)
class Outcome:
    """What became of one fault.

    Parameters
    ----------
    kind, procedure : str
    status : {"stopped", "refused", "harmless", "recovered", "too late"}
        By an alarm, by the procedure itself, or nothing was wrong; found at the next start; or it
        never came, since the procedure had ended.
    alarm : str
        Name of the alarm, or of the error.
    safe_s : float
        Bench time from the fault to both drives off, s; NaN where none was on.
    points : int
        Points that were acknowledged and kept.
    problems : tuple of str
        What went wrong; empty when the fault was survived.
    wall_s : float
        As `safe_s`, wall time; NaN where bench time isn't a clock's.
    """

    kind: str
    procedure: str
    status: Status
    alarm: str
    safe_s: float
    points: int
    problems: tuple[str, ...] = ()
    wall_s: float = float("nan")


def status_of(error: BaseException | None, alarms: Sequence[Alarm]) -> tuple[Status, str]:
    """Return how a procedure ended, and the name of why."""
    if error is None:
        return "harmless", alarms[0].name if alarms else ""
    return ("stopped", alarms[0].name) if alarms else ("refused", type(error).__name__)


def await_safe(station: Station, timeout_s: float) -> None:
    """Wait until power and torque were read back as gone, also where that was given up before."""
    deadline = time.monotonic() + timeout_s
    while not station.supervisor.safe and time.monotonic() < deadline:
        station.supervisor.wait_safe(0.1)
        time.sleep(0.02)


def unsafe_end(station: Station, at_rest: bool) -> Iterator[str]:
    """Say where a drive has power and no alarm stays that tells of it."""
    if at_rest:
        return
    with contextlib.suppress(TorquebenchError):
        station.acknowledge_alarm("fault campaign")
    if station.supervisor.alarm is None:
        yield "unsafe: a drive isn't off, and no alarm stays"


def ended_badly(
    error: BaseException | None, alarms: Sequence[Alarm], *, disk: bool
) -> Iterator[str]:
    """Say what is wrong with the way a procedure ended, drives and record apart."""
    if error is not None and not isinstance(error, TorquebenchError):
        yield f"other: unforeseen {type(error).__name__}: {error}"
    if not disk and any(alarm.kind is AlarmKind.JOURNAL for alarm in alarms):
        yield "other: the journal failed too"


def record_of(
    station: Station, error: BaseException | None, *, spoilt: bool = False
) -> tuple[int, list[str]]:
    """Count the points of the newest run, and say what is wrong with its record.

    There is none where a procedure was refused before its run began. With `spoilt` its values are
    what a transducer says that is wrong: they may be recorded, but not used.
    """
    runs = station.registry.runs(limit=1)
    if not runs:
        return 0, [] if error is not None else ["stranded: nothing is recorded"]
    run = runs[0]
    points, problems = checked(
        RunFolder.open(run.folder), station.description, stopped=error is not None, spoilt=spoilt
    )
    if error is not None and run.status != "failed":
        problems.append(f"stranded: the run is {run.status}")
    return points, problems


def checked(
    folder: RunFolder, description: BenchDescription, *, stopped: bool, spoilt: bool = False
) -> tuple[int, list[str]]:
    """Count the points of a record, and say what is wrong with it.

    The last value of a run that was stopped, point or zero, doesn't count: what stopped it may
    have begun while it was taken. A calibration that goes on takes such a point again, and a zero
    that was refused is no zero.
    """
    problems = []
    try:
        folder.verify()
    except RecordError as changed:
        problems.append(f"stranded: record: {changed}")
    if not any(read_audit(folder.path / AUDIT_FILE)):
        problems.append("stranded: no audit log")
    streams = {d["uid"]: str(d["name"]) for _, d in folder.documents("descriptor")}
    events = [(streams[event["descriptor"]], event) for _, event in folder.documents("event")]
    points = [event for stream, event in events if stream == "points"]
    kept = [event for stream, event in events if stream == "points" or stream.startswith("zero_")]
    for event in () if spoilt else kept[:-1] if stopped else kept:
        for side in ("input", "output"):
            found = {
                key.removeprefix(f"{side}-steady-"): value
                for key, value in event["data"].items()
                if key.startswith(f"{side}-steady-")
            }
            range_nm = description.module(side).range_nm
            problems += _wrong_values(side, found, range_nm)
    return len(points), problems


def _wrong_values(side: str, found: dict[str, Any], range_nm: float) -> Iterator[str]:
    """Say which values of a point are too far from the truth."""
    true = found.get("true_torque_nm")
    if true is None:
        return
    for field, allowed in (("reading_nm", READING_PERCENT), ("standard_nm", STANDARD_PERCENT)):
        value = found.get(field)
        if value is not None and not abs(value - true) <= allowed / 100.0 * range_nm:
            yield f"wrong: {side} {field} {value:.6g} N·m, true {true:.6g} N·m"


def slipped(recording: TransmissionRecording) -> Iterator[str]:
    """Say in which direction the angles are further apart than the twin's reducer has them."""
    for each in recording.directions:
        apart = np.ptp(each.output_angle_rad - each.input_angle_rad / REDUCER.ratio)
        if apart > np.radians(ANGLE_DEG):
            yield f"wrong: direction {each.direction}: angles {np.degrees(apart):.2f}° apart"


def differing(found: ReducerTestRecord, undisturbed: ReducerTestRecord) -> Iterator[str]:
    """Say which results differ by more than both their expanded uncertainties.

    Of a spectrum the largest orders are listed: one that the other result doesn't list is there at
    most as large as the least that it does.
    """
    one, other = _quantities(found), _quantities(undisturbed)
    for name in {**one, **other}:
        each, before = one.get(name), other.get(name)
        if each is None or before is None:
            shown, rest = (each, other) if before is None else (before, one)
            assert shown is not None
            listed = [rest[key] for key in rest if _spectrum(key) == _spectrum(name)]
            least = min(listed, key=lambda quantity: quantity.value, default=None)
            where = "undisturbed" if before is None else "disturbed"
            if not _spectrum(name) or least is None:
                yield f"wrong: {shown.key} isn't in the {where} result"
            elif shown.value - least.value > _both(shown, least):
                yield (
                    f"wrong: {_stated(shown)} isn't among the largest of the {where} result, "
                    f"down to {_stated(least)}"
                )
        elif not abs(each.value - before.value) <= _both(each, before):
            yield f"wrong: {_stated(each)}, undisturbed {_stated(before)}"


def _quantities(record: ReducerTestRecord) -> dict[tuple[str, str], ReducerTestQuantity]:
    return {
        (outcome.name, each.key): each for outcome in record.outcomes for each in outcome.quantities
    }


def _spectrum(name: tuple[str, str]) -> tuple[str, str] | None:
    """Return the spectrum that an order belongs to; None for any other quantity."""
    test, key = name
    return (test, key.split("_", 2)[2]) if key.startswith("order_") else None


def _both(one: ReducerTestQuantity, other: ReducerTestQuantity) -> float:
    return one.expanded_uncertainty + other.expanded_uncertainty


def _stated(quantity: ReducerTestQuantity) -> str:
    return (
        f"{quantity.key} {quantity.value:.5g} ± {quantity.expanded_uncertainty:.2g} {quantity.unit}"
    )
