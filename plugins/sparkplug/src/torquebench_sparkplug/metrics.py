"""Metrics of the edge node and its devices, and how they are read from the bench."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime

from torquebench import __version__
from torquebench.bench import SIDES
from torquebench.errors import TorquebenchError
from torquebench.panel.beside import ServedBench
from torquebench.panel.service import (
    AlarmView,
    BenchSnapshot,
    JobView,
    LatestValue,
    SideSnapshot,
)
from torquebench.units import MS_PER_S, unit_of_name
from torquebench_sparkplug.payload import DataType, Quality, Value
from torquebench_sparkplug.settings import Deadband

__all__ = [
    "BDSEQ",
    "DEVICES",
    "METRICS",
    "NODE",
    "REBIRTH",
    "MetricSpec",
    "Reading",
    "Readings",
    "milliseconds",
    "read_bench",
]

NODE = ""
"""Placeholder for the edge node itself among its devices."""
DEVICES: tuple[str, ...] = SIDES
BDSEQ = "bdSeq"
REBIRTH = "Node Control/Rebirth"


@dataclass(frozen=True)
class MetricSpec:
    """One metric as its birth states it.

    Parameters
    ----------
    name : str
        Levels are separated by "/"; no name is also a folder of others.
    datatype : DataType
    text : str
        Description.
    unit : str
        Sent as the property `engUnit`.
    deadband : str
        The key of `Deadband` that holds for it; empty where every change is sent.
    writable : bool
    """

    name: str
    datatype: DataType
    text: str
    unit: str = ""
    deadband: str = ""
    writable: bool = False

    def differs(self, before: Value, now: Value, deadband: Deadband, range_nm: float) -> bool:
        """Whether a value differs from an earlier value by more than the deadband."""
        if not self.deadband or not isinstance(before, float) or not isinstance(now, float):
            return before != now
        step = float(getattr(deadband, self.deadband))
        if self.deadband == "torque_percent":
            step *= range_nm / 100.0
        return abs(now - before) > step


_STRING, _NUMBER, _FLAG = DataType.STRING, DataType.DOUBLE, DataType.BOOLEAN
_COUNT, _TIME = DataType.INT64, DataType.DATE_TIME
_UNIT = {
    "torque": unit_of_name("output_torque_nm"),
    "speed": unit_of_name("output_speed_rpm"),
    "angle": unit_of_name("output_angle_deg"),
    "temperature": unit_of_name("output_temperature_c"),
    "efficiency": unit_of_name("efficiency_percent"),
}

_NODE_METRICS = (
    MetricSpec(BDSEQ, _COUNT, "number of the connection, the same in birth and death"),
    MetricSpec(REBIRTH, _FLAG, "write true to get all births again", writable=True),
    MetricSpec("Bench/Name", _STRING, "name in the bench description"),
    MetricSpec("Bench/Simulated", _FLAG, "whether every value is simulated"),
    MetricSpec("Bench/Software", _STRING, "torquebench and its version"),
    MetricSpec("Bench/State", _STRING, "`idle`, `running`, `paused`, `stopped`, `no samples`"),
    MetricSpec("Bench/Mounted", _STRING, "what is between the flanges"),
    MetricSpec(
        "Bench/Efficiency",
        _NUMBER,
        "power out over power in, of compensated torques; null without a model on both sides "
        "or if not meaningful",
        _UNIT["efficiency"],
        "efficiency_percent",
    ),
    MetricSpec("Alarm/Active", _FLAG, "whether an alarm or a warning is active"),
    MetricSpec(
        "Alarm/Stopped", _FLAG, "whether a critical alarm holds the bench in its safe state"
    ),
    MetricSpec("Alarm/Count", _COUNT, "number of active alarms and warnings"),
    MetricSpec("Alarm/Level", _STRING, "of the worst one: `critical`, `warning`, or null"),
    MetricSpec("Alarm/Text", _STRING, "of the worst one: kind, source, cause, limit, what to do"),
    MetricSpec("Alarm/Raised", _TIME, "of the worst one"),
    MetricSpec("Alarm/All", DataType.TEXT, "all active ones, the worst first, one per line"),
    MetricSpec("Run/In progress", _FLAG, "whether a job is under way"),
    MetricSpec("Run/Title", _STRING, "of the job"),
    MetricSpec("Run/Stage", _STRING, "stage of the job"),
    MetricSpec("Run/Steps done", _COUNT, "steps of the stage done"),
    MetricSpec("Run/Steps total", _COUNT, "steps of the stage; null if unknown"),
    MetricSpec("Run/Last title", _STRING, "of the last job that ended since the panel was started"),
    MetricSpec("Run/Last state", _STRING, "`done`, `failed` or `aborted`"),
    MetricSpec(
        "Run/Last verdict",
        _STRING,
        "`pass`, `conditionalPass`, `conditionalFail`, `fail`; null without limit",
    ),
    MetricSpec("Run/Last result", _STRING, "what came out, or why it ended"),
    MetricSpec("Run/Last run", _STRING, "identifier of the run in the records"),
    MetricSpec("Run/Last finished", _TIME, "when it ended"),
    MetricSpec("Buffer/Waiting", _COUNT, "records that wait to be sent as history"),
    MetricSpec("Buffer/Lost", _COUNT, "records dropped because the buffer was full"),
    MetricSpec("Commands/Refused", _COUNT, "commands refused since the panel was started"),
)
_DEVICE_METRICS = (
    MetricSpec(
        "Torque/Value",
        _NUMBER,
        "compensated where a compensation is in use, else raw",
        _UNIT["torque"],
        "torque_percent",
    ),
    MetricSpec(
        "Torque/Expanded uncertainty",
        _NUMBER,
        "U of the value, k = 2; null without compensation",
        _UNIT["torque"],
        "torque_percent",
    ),
    MetricSpec("Torque/Raw", _NUMBER, "without compensation", _UNIT["torque"], "torque_percent"),
    MetricSpec(
        "Torque/Reference",
        _NUMBER,
        "of the standard, if one is mounted",
        _UNIT["torque"],
        "torque_percent",
    ),
    MetricSpec("Torque/Fault", _STRING, "why there is no torque; null if there is one"),
    MetricSpec("Torque/Range", _NUMBER, "of the module", _UNIT["torque"]),
    MetricSpec("Torque/Limit", _NUMBER, "of the bench", _UNIT["torque"]),
    MetricSpec("Speed/Value", _NUMBER, "of the shaft", _UNIT["speed"], "speed_rpm"),
    MetricSpec("Speed/Limit", _NUMBER, "of the bench", _UNIT["speed"]),
    MetricSpec("Angle/Value", _NUMBER, "of the shaft", _UNIT["angle"], "angle_deg"),
    MetricSpec(
        "Temperature/Value", _NUMBER, "of the transducer", _UNIT["temperature"], "temperature_k"
    ),
    MetricSpec("Transducer/Serial", _STRING, "serial number"),
    MetricSpec("Compensation/In use", _FLAG, "whether a model compensates the torque"),
    MetricSpec("Compensation/Model", _COUNT, "number of the model; null without one"),
    MetricSpec("Compensation/Kind", _STRING, "kind of the model"),
    MetricSpec("Compensation/Made", _TIME, "when it was fitted"),
    MetricSpec("Compensation/Problem", _STRING, "why there is none"),
    MetricSpec("Calibration/Number", _COUNT, "of the calibration in use"),
    MetricSpec("Calibration/Due", _TIME, "last day on which it is valid; null without limit"),
    MetricSpec(
        "Calibration/Valid", _FLAG, "whether that day hasn't passed; null without calibration"
    ),
)
METRICS: Mapping[str, tuple[MetricSpec, ...]] = {
    NODE: _NODE_METRICS,
    **dict.fromkeys(DEVICES, _DEVICE_METRICS),
}


@dataclass(frozen=True)
class Reading:
    """Present value of a metric.

    Parameters
    ----------
    value : bool, int, float, str or None
    timestamp : int
        When it was measured, ms since 1970, UTC.
    quality : Quality
    """

    value: Value
    timestamp: int
    quality: Quality = Quality.GOOD


@dataclass(frozen=True)
class Readings:
    """Published state of the bench.

    Parameters
    ----------
    values : mapping of device to mapping of name to Reading
        The edge node's own are under `NODE`.
    alive : bool
        Whether the devices can be read: the acquisition runs.
    """

    values: Mapping[str, Mapping[str, Reading]]
    alive: bool


def milliseconds(moment: datetime | date) -> int:
    """Return a time as Sparkplug states it; a day ends at its midnight, UTC.

    Examples
    --------
    >>> milliseconds(date(1970, 1, 1))
    86399999
    """
    if isinstance(moment, datetime):
        return round(moment.timestamp() * MS_PER_S)
    start = datetime(moment.year, moment.month, moment.day, tzinfo=UTC)
    return milliseconds(start) + 86_399_999


def read_bench(bench: ServedBench) -> Readings | None:
    """Read all metrics except the publisher's own counters; None while the bench is reopened."""
    try:
        snapshot = bench.snapshot()
        alarms = bench.alarms(active=True)
        current = bench.jobs.current
        last = next((job for job in bench.jobs.recent() if not job.open), None)
    except (TorquebenchError, OSError):  # reading the simulator fails while the bench is reopened
        return None
    now = round(time.time() * MS_PER_S)
    node = {
        **_states(snapshot),
        **_alarms(alarms, stopped=snapshot.stopped),
        **_run(current, last),
    }
    values = {NODE: {name: Reading(value, now) for name, value in node.items()}}
    values[NODE]["Bench/Efficiency"] = _live(snapshot.efficiency, now, keep=False)
    for side in SIDES:
        values[side] = dict(_side(snapshot.sides[side], now))
    return Readings(values, snapshot.connection != "lost")


def _states(snapshot: BenchSnapshot) -> dict[str, Value]:
    return {
        "Bench/Name": snapshot.bench_name,
        "Bench/Simulated": snapshot.simulated,
        "Bench/Software": f"torquebench {__version__}",
        "Bench/State": snapshot.state if snapshot.connection == "live" else "no samples",
        "Bench/Mounted": snapshot.mounted,
    }


def _alarms(alarms: list[AlarmView], *, stopped: bool) -> dict[str, Value]:
    worst = alarms[0] if alarms else None
    lines = [f"{each.raised:%Y-%m-%d %H:%M:%SZ} {each.level}: {_words(each)}" for each in alarms]
    return {
        "Alarm/Active": bool(alarms),
        "Alarm/Stopped": stopped,
        "Alarm/Count": len(alarms),
        "Alarm/Level": None if worst is None else worst.level,
        "Alarm/Text": None if worst is None else _words(worst),
        "Alarm/Raised": None if worst is None else milliseconds(worst.raised),
        "Alarm/All": "\n".join(lines),
    }


def _words(alarm: AlarmView) -> str:
    return f"{alarm.kind} ({alarm.source}): {alarm.message}"


def _run(current: JobView | None, last: JobView | None) -> dict[str, Value]:
    result = None if last is None else last.result
    said = None if last is None or last.problem is None else last.problem.found
    return {
        "Run/In progress": current is not None,
        "Run/Title": None if current is None else current.title,
        "Run/Stage": None if current is None else current.stage,
        "Run/Steps done": None if current is None else current.done,
        "Run/Steps total": None if current is None else current.total,
        "Run/Last title": None if last is None else last.title,
        "Run/Last state": None if last is None else last.state,
        "Run/Last verdict": None if result is None else result.verdict or None,
        "Run/Last result": result.headline if said is None and result is not None else said,
        "Run/Last run": result.run_ids[0] if result and result.run_ids else None,
        "Run/Last finished": milliseconds(last.finished) if last and last.finished else None,
    }


def _live(value: LatestValue, now: int, fault: str = "", *, keep: bool = True) -> Reading:
    """Return a live value: null with a fault; an old value keeps its time."""
    if fault or value.value is None:
        return Reading(None, now, Quality.BAD if fault else Quality.STALE)
    if value.stale:
        taken = now - round(value.age_s * MS_PER_S)
        return Reading(value.value, taken, Quality.STALE) if keep else Reading(None, now)
    return Reading(value.value, now - round(value.age_s * MS_PER_S))


def _side(side: SideSnapshot, now: int) -> Iterator[tuple[str, Reading]]:
    model = side.compensation
    yield "Torque/Value", _live(side.torque, now, side.raw.fault)
    if model is None:
        yield "Torque/Expanded uncertainty", Reading(None, now)
    else:
        yield "Torque/Expanded uncertainty", _live(side.expanded_uncertainty, now, side.raw.fault)
    yield "Torque/Raw", _live(side.raw, now, side.raw.fault)
    if side.reference.value is None and not side.reference.fault:
        yield "Torque/Reference", Reading(None, now)  # no standard is mounted
    else:
        yield "Torque/Reference", _live(side.reference, now, side.reference.fault)
    yield "Speed/Value", _live(side.speed, now)
    yield "Angle/Value", _live(side.angle, now)
    yield "Temperature/Value", _live(side.temperature, now)
    states: dict[str, Value] = {
        "Torque/Fault": side.raw.fault or None,
        "Torque/Range": float(side.range_nm),
        "Torque/Limit": float(side.limit_nm),
        "Speed/Limit": float(side.limit_rpm),
        "Transducer/Serial": side.transducer_serial,
        "Compensation/In use": model is not None,
        "Compensation/Model": None if model is None else model.model_id,
        "Compensation/Kind": None if model is None else model.kind,
        "Compensation/Made": None if model is None else milliseconds(model.made),
        "Compensation/Problem": side.compensation_problem or None,
        "Calibration/Number": None if model is None else model.calibration_id,
        "Calibration/Due": milliseconds(model.due) if model and model.due else None,
        "Calibration/Valid": None if model is None else model.valid,
    }
    for name, value in states.items():
        yield name, Reading(value, now)
