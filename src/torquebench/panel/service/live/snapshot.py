"""The present state of the bench as values for display."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from typing import Literal

from torquebench.bench.roles import SIDES, Side
from torquebench.panel.service.live.hub import Connection, LatestValue, LiveHub
from torquebench.records import Registry
from torquebench.station import Station

BenchState = Literal["stopped", "idle", "running", "paused"]


@dataclass(frozen=True)
class CompensationState:
    """The model that compensates a side.

    Parameters
    ----------
    model_id, calibration_id : int
    kind : str
        Kind of the model.
    made : datetime.datetime
        When it was fitted, UTC.
    due : datetime.date or None
        Last day on which its calibration is valid.
    valid : bool
        Whether that day hasn't passed.
    """

    model_id: int
    calibration_id: int
    kind: str
    made: datetime
    due: date | None
    valid: bool


@dataclass(frozen=True, kw_only=True)
class SideSummary:
    """One side: its limits and its compensation.

    Parameters
    ----------
    side : str
    range_nm, limit_nm, limit_rpm : float
    transducer_serial : str
    compensation : CompensationState or None
        None if the side isn't compensated.
    compensation_problem : str
        Reason for a missing compensation.
    """

    side: Side
    range_nm: float
    limit_nm: float
    limit_rpm: float
    transducer_serial: str
    compensation: CompensationState | None
    compensation_problem: str


@dataclass(frozen=True, kw_only=True)
class SideSnapshot(SideSummary):
    """One side with its readings.

    Parameters
    ----------
    torque : LatestValue
        Compensated torque if there is a compensation, else the raw reading, N·m.
    expanded_uncertainty : LatestValue
        Expanded uncertainty (k = 2), N·m; without a value if the side isn't compensated.
    raw, reference, speed, angle, temperature : LatestValue
        Values in N·m, N·m, rpm, ° and °C.
    """

    torque: LatestValue
    expanded_uncertainty: LatestValue
    raw: LatestValue
    reference: LatestValue
    speed: LatestValue
    angle: LatestValue
    temperature: LatestValue


@dataclass(frozen=True, kw_only=True)
class BenchSummary:
    """The present state of the bench, without its sides.

    Parameters
    ----------
    bench_name : str
    simulated : bool
        Whether the bench is simulated; every value must then be labelled.
    connection : {"live", "stale", "lost"}
    connection_problem : str
        Why the connection isn't live.
    bench_time_s, age_s : float
        Bench time of the newest block, and its age, s.
    sequence : int
        Sequence number of the live hub's newest row.
    mounted : str
        What is mounted between the flanges.
    alarms : int
        Number of active alarms.
    stopped : bool
        Whether a critical alarm is latched, which prevents movements until it is acknowledged.
    job_id : str or None
        The running job.
    commanded_by : str or None
        Who holds the command lease.
    """

    bench_name: str
    simulated: bool
    connection: Connection
    connection_problem: str
    bench_time_s: float
    age_s: float
    sequence: int
    mounted: str
    alarms: int
    stopped: bool
    job_id: str | None
    commanded_by: str | None


@dataclass(frozen=True, kw_only=True)
class BenchSnapshot(BenchSummary):
    """The present state of the bench.

    Parameters
    ----------
    sides : mapping of side to SideSnapshot
    efficiency : LatestValue
        Efficiency in %; without a value if it is undefined.
    paused : bool
        Whether the running job is paused.
    """

    sides: Mapping[Side, SideSnapshot]
    efficiency: LatestValue
    paused: bool

    @property
    def state(self) -> BenchState:
        """Activity of the bench; `connection` states whether samples arrive."""
        if self.stopped:
            return "stopped"
        if self.job_id is None:
            return "idle"
        return "paused" if self.paused else "running"


def compensation_state(registry: Registry, model_id: int, today: date) -> CompensationState:
    """Return the registry's data of an active model."""
    model = registry.model(model_id)
    calibration = registry.calibration(model.calibration_id)
    valid = calibration.due is None or today <= calibration.due
    return CompensationState(
        model.model_id,
        calibration.calibration_id,
        model.kind,
        model.created,
        calibration.due,
        valid,
    )


def side_snapshots(
    station: Station,
    live: LiveHub,
    states: Mapping[Side, tuple[CompensationState | None, str]],
) -> dict[Side, SideSnapshot]:
    """Return the readings of both sides."""
    values = live.latest()
    sides: dict[Side, SideSnapshot] = {}
    for side in SIDES:
        module = station.description.module(side)
        state, problem = states[side]
        # the calibration may have expired meanwhile
        if state is not None and state.due is not None:
            state = replace(state, valid=datetime.now(UTC).date() <= state.due)
        raw = values[f"{side}_raw_nm"]
        sides[side] = SideSnapshot(
            side=side,
            range_nm=module.range_nm,
            limit_nm=module.limits.torque_nm,
            limit_rpm=module.limits.speed_rpm,
            transducer_serial=module.transducer.serial,
            compensation=state,
            compensation_problem=problem,
            torque=raw if state is None else values[f"{side}_torque_nm"],
            expanded_uncertainty=values[f"{side}_expanded_uncertainty_nm"],
            raw=raw,
            reference=values[f"{side}_reference_nm"],
            speed=values[f"{side}_speed_rpm"],
            angle=values[f"{side}_angle_deg"],
            temperature=values[f"{side}_temperature_c"],
        )
    return sides
