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
_SIGNALS = {
    "Torque": "output_torque_nm",
    "Uncertainty": "output_uncertainty_nm",
    "RawTorque": "output_raw_nm",
    "ReferenceTorque": "output_reference_nm",
    "Speed": "output_speed_rpm",
    "Angle": "output_angle_deg",
    "Temperature": "output_temperature_c",
    "Efficiency": "efficiency_percent",
}
UNITS = {
    name: (unit_of_name(signal), _COMMON_CODES[unit_of_name(signal)])
    for name, signal in _SIGNALS.items()
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
        for name, value, doubt in (
            ("Torque", shown.torque, not compensated),
            ("Uncertainty", shown.uncertainty, not compensated),
            ("RawTorque", shown.raw, False),
            ("ReferenceTorque", shown.reference, False),
            ("Speed", shown.speed, False),
            ("Angle", shown.angle, False),
            ("Temperature", shown.temperature, False),
        ):
            found[side, name] = _live(value, bench, moment, doubtful=doubt)
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
