"""Values of the service as values of the address space; pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Literal

from torquebench.panel.service.live.alarms import AlarmView
from torquebench.panel.service.live.hub import Connection, LatestValue
from torquebench.panel.service.live.snapshot import BenchSnapshot, BenchState
from torquebench.units import unit_of_name

__all__ = [
    "UNITS",
    "LiveValue",
    "MachineState",
    "live_values",
    "machine_state",
    "severity",
]

MachineState = Literal["NotAvailable", "OutOfService", "NotExecuting", "Executing"]
"""States of a machinery item by OPC 40001-1."""

_COMMON_CODES = {"N·m": "NU", "rpm": "RPM", "°": "DD", "°C": "CEL", "%": "P1"}
_SIDE_SIGNALS = {
    "Torque": "torque_nm",
    "Uncertainty": "expanded_uncertainty_nm",
    "RawTorque": "raw_nm",
    "ReferenceTorque": "reference_nm",
    "Speed": "speed_rpm",
    "Angle": "angle_deg",
    "Temperature": "temperature_c",
}
"""Live values of a side: fields of its snapshot, with their units."""
_COMPENSATED = ("Torque", "Uncertainty")
UNITS = {
    name: (unit_of_name(signal), _COMMON_CODES[unit_of_name(signal)])
    for name, signal in {**_SIDE_SIGNALS, "Efficiency": "efficiency_percent"}.items()
}
"""Live values with their unit, and its common code of UNECE Recommendation 20."""
_STATES: Mapping[BenchState, MachineState] = {
    "stopped": "OutOfService",
    "idle": "NotExecuting",
    "running": "Executing",
    "paused": "Executing",
}


@dataclass(frozen=True)
class LiveValue:
    """One live value.

    Attributes
    ----------
    value : float or None
    status : str
        Name of an OPC UA status code.
    source_time : datetime.datetime or None
        When the value was measured, UTC.
    """

    value: float | None
    status: str
    source_time: datetime | None


def live_values(
    bench: BenchSnapshot, now: datetime | None = None
) -> dict[tuple[str, str], LiveValue]:
    """Return all live values by side ("" for the bench) and name.

    A value that is missing or has a fault is bad, an old one uncertain. While a critical alarm is
    latched everything is uncertain, and so is a torque without a valid compensation.
    """
    moment = now or datetime.now(UTC)
    found: dict[tuple[str, str], LiveValue] = {}
    for side, shown in bench.sides.items():
        compensated = shown.compensation is not None and shown.compensation.valid
        for name, signal in _SIDE_SIGNALS.items():
            value: LatestValue = getattr(shown, signal.rpartition("_")[0])
            doubtful = name in _COMPENSATED and not compensated
            found[side, name] = _live(value, bench, moment, doubtful=doubtful)
    found["", "Efficiency"] = _live(bench.efficiency, bench, moment, doubtful=False)
    return found


def _live(value: LatestValue, bench: BenchSnapshot, now: datetime, *, doubtful: bool) -> LiveValue:
    if value.value is None:
        status = "BadSensorFailure" if value.fault else _nothing(bench.connection)
        return LiveValue(None, status, None)
    measured = now - timedelta(seconds=value.age_s)
    if bench.connection == "lost":
        status = "BadNoCommunication"
    elif value.fault:
        status = "BadSensorFailure"
    elif value.stale:
        status = "UncertainLastUsableValue"
    elif bench.stopped:
        status = "UncertainSubNormal"
    elif doubtful:
        status = "UncertainSensorNotAccurate"
    else:
        status = "Good"
    return LiveValue(value.value, status, measured)


def _nothing(connection: Connection) -> str:
    return "BadNoCommunication" if connection == "lost" else "BadNoData"


def machine_state(bench: BenchSnapshot) -> MachineState:
    """Return the bench's state by OPC 40001-1: out of service while a critical alarm is latched."""
    return "NotAvailable" if bench.connection == "lost" else _STATES[bench.state]


def severity(alarm: AlarmView) -> int:
    """Return an alarm's severity, 1 to 1000: that of critical ones is high."""
    return 900 if alarm.level == "critical" else 400
