"""Live values of the bench as values of the address space; pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Literal

from torquebench.panel.service import AlarmView, BenchSnapshot, BenchState, Connection, LatestValue
from torquebench.units import unit_of_name

__all__ = [
    "EFFICIENCY",
    "SIGNALS",
    "LiveValue",
    "MachineState",
    "Signal",
    "common_code",
    "live_values",
    "machine_state",
    "severity",
]

MachineState = Literal["NotAvailable", "OutOfService", "NotExecuting", "Executing"]
"""States of a machinery item by OPC 40001-1."""
_STATES: Mapping[BenchState, MachineState] = {
    "stopped": "OutOfService",
    "idle": "NotExecuting",
    "running": "Executing",
    "paused": "Executing",
}
_COMMON_CODES = {
    "N·m": "NU",
    "rpm": "RPM",
    "°": "DD",
    "°C": "CEL",
    "K": "KEL",
    "%": "P1",
    "arcmin": "D61",
    "arcsec": "D62",
    "s": "SEC",
    "W": "WTT",
}


def common_code(unit: str) -> int:
    """Return a unit's common code of UNECE Recommendation 20 as a number; -1 if there is none.

    OPC 10000-8, 5.6.3.3: the characters of the code are the number's bytes.

    Examples
    --------
    >>> common_code("N·m"), common_code("N·m/arcmin")
    (20053, -1)
    """
    code = _COMMON_CODES.get(unit, "")
    return int.from_bytes(code.encode(), "big") if code else -1


@dataclass(frozen=True)
class Signal:
    """A live value: its browse name, its field in the snapshot and its description.

    `largest` is the name of the side's field with the largest value, if there is one.
    """

    name: str
    field: str
    description: str
    largest: str = ""
    smallest_is_zero: bool = False
    compensated: bool = False

    @property
    def unit(self) -> str:
        """Return the unit, which ends the field's name."""
        return unit_of_name(self.field)

    @property
    def part(self) -> str:
        """Return the field's name without the unit."""
        return self.field.rpartition("_")[0]


SIGNALS = (
    Signal("Torque", "torque_nm", "torque, compensated while a compensation is in use", "range_nm",
           compensated=True),
    Signal("Uncertainty", "expanded_uncertainty_nm", "expanded uncertainty of the torque, k = 2",
           "range_nm", smallest_is_zero=True, compensated=True),
    Signal("RawTorque", "raw_nm", "torque without compensation", "range_nm"),
    Signal("ReferenceTorque", "reference_nm", "torque of the mounted standard", "range_nm"),
    Signal("Speed", "speed_rpm", "speed of the shaft", "limit_rpm"),
    Signal("Angle", "angle_deg", "angle of the shaft, over all revolutions"),
    Signal("Temperature", "temperature_c", "temperature of the transducer"),
)  # fmt: skip
"""Live values of each side."""
EFFICIENCY = Signal("Efficiency", "efficiency_percent", "power out over power in")


@dataclass(frozen=True)
class LiveValue:
    """A value, the name of its OPC UA status code, and when it was measured (UTC)."""

    value: float | None
    status: str
    source_time: datetime | None


def live_values(
    bench: BenchSnapshot, now: datetime | None = None
) -> dict[tuple[str, str], LiveValue]:
    """Return all live values by side ("" for the bench) and name.

    A missing or faulty value is bad, an old value uncertain. While a critical alarm is latched, all
    values are uncertain; so is a torque without a valid compensation.
    """
    moment = now or datetime.now(UTC)
    values: dict[tuple[str, str], LiveValue] = {}
    for name, side in bench.sides.items():
        valid = side.compensation is not None and side.compensation.valid
        for signal in SIGNALS:
            doubtful = signal.compensated and not valid
            value = getattr(side, signal.part)
            values[name, signal.name] = _live(value, bench, moment, doubtful=doubtful)
    values["", EFFICIENCY.name] = _live(bench.efficiency, bench, moment, doubtful=False)
    return values


def _live(value: LatestValue, bench: BenchSnapshot, now: datetime, *, doubtful: bool) -> LiveValue:
    if value.value is None:
        status = "BadSensorFailure" if value.fault else _without_value(bench.connection)
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


def _without_value(connection: Connection) -> str:
    return "BadNoCommunication" if connection == "lost" else "BadNoData"


def machine_state(bench: BenchSnapshot) -> MachineState:
    """Return the bench's state by OPC 40001-1: out of service while a critical alarm is latched."""
    return "NotAvailable" if bench.connection == "lost" else _STATES[bench.state]


def severity(alarm: AlarmView) -> int:
    """Return an alarm's severity from 1 to 1000, which is high for critical alarms."""
    return 900 if alarm.level == "critical" else 400
