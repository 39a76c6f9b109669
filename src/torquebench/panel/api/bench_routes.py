"""Routes of the live bench: readings, command lease, stop, alarms."""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass, fields
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query
from numpy.typing import NDArray
from pydantic import StringConstraints

from torquebench.bench.roles import Side
from torquebench.chain import EffectState
from torquebench.panel.api.access import Caller, Service, Watched
from torquebench.panel.api.models import (
    AcknowledgeBody,
    LeaseBody,
    LiveRows,
    MarkerBody,
    SignalValue,
    StopBody,
    SwitchBody,
)
from torquebench.panel.service import (
    SIGNALS,
    AlarmView,
    BenchService,
    LeaseState,
    LiveTrend,
    Marker,
    StopReport,
)
from torquebench.panel.service.live.snapshot import BenchSummary, SideSummary

router = APIRouter(tags=["bench"])

ALL_ALARMS = AcknowledgeBody()

SignalName = Annotated[
    str, StringConstraints(pattern="^(" + "|".join(signal.name for signal in SIGNALS) + ")$")
]
SignalNames = Annotated[
    list[SignalName] | None,
    Query(description="Names of signals; all by default.", max_length=32),
]


@dataclass(frozen=True, kw_only=True)
class BenchView(BenchSummary):
    """The present state of the bench, with sides and newest readings by their names."""

    sides: dict[Side, SideSummary]
    signals: dict[str, SignalValue]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _signals(service: BenchService) -> dict[str, SignalValue]:
    latest = service.live.latest()
    return {
        signal.name: SignalValue(
            title=signal.title,
            unit=signal.unit,
            value=latest[signal.name].value,
            age_s=_finite(latest[signal.name].age_s),
            stale=latest[signal.name].stale,
            fault=latest[signal.name].fault,
        )
        for signal in SIGNALS
    }


@router.get("/bench")
def bench(service: Watched) -> BenchView:
    """Return the bench's present state: connection, both sides, every signal's newest value."""
    snapshot = service.snapshot()
    shared = {field.name: getattr(snapshot, field.name) for field in fields(BenchSummary)}
    sides = dict[Side, SideSummary](snapshot.sides)
    return BenchView(**shared, sides=sides, signals=_signals(service))


def _lists(columns: Any) -> dict[str, list[float | None]]:
    return {name: finite_list(values) for name, values in columns.items()}


def finite_list(values: NDArray[np.float64]) -> list[float | None]:
    """Return numbers for JSON, with null for missing ones."""
    numbers: list[float | None] = values.tolist()
    if not np.isfinite(values).all():
        return [value if value is not None and math.isfinite(value) else None for value in numbers]
    return numbers


def live_document(trend: LiveTrend) -> dict[str, Any]:
    """Return the content of `LiveRows` as a dict for fast sending, with null for NaN."""
    return {
        "sequence": trend.sequence,
        "missed": trend.missed,
        "time_s": trend.time_s.tolist(),
        "values": _lists(trend.values),
        "low": _lists(trend.low),
        "high": _lists(trend.high),
    }


@router.get("/live")
def live(
    service: Watched,
    since: Annotated[int, Query(ge=0, le=2**53)] = 0,
    signals: SignalNames = None,
) -> LiveRows:
    """Return the rows of live signals after a sequence number."""
    return LiveRows(**live_document(service.live.since(since, signals)))


@router.get("/trend")
def trend(
    service: Watched,
    seconds: Annotated[float, Query(gt=0, le=3600, allow_inf_nan=False)] = 60.0,
    points: Annotated[int, Query(ge=1, le=5000)] = 600,
    signals: SignalNames = None,
) -> LiveRows:
    """Return the last seconds of live signals, reduced without losing extremes."""
    return LiveRows(**live_document(service.live.trend(seconds, signals, points)))


@router.get("/markers")
def markers(service: Watched) -> list[Marker]:
    """Return the notes on the live signals since the bench was opened."""
    return service.markers.all()


@router.post("/markers", status_code=201)
def add_marker(service: Service, caller: Caller, body: MarkerBody) -> Marker:
    """Add a note to the live signals; runs that are being recorded keep it."""
    return service.mark(caller, body.note, body.bench_time_s)


# -- command --------------------------------------------------------------------------------


@router.get("/command")
def who_commands(service: Watched) -> LeaseState:
    """Return which session commands the bench."""
    return service.lease.state()


@router.post("/command")
def take_command(service: Service, caller: Caller, body: LeaseBody) -> LeaseState:
    """Take the command lease."""
    service.lease.take(caller, force=body.force)
    return service.lease.state()


@router.delete("/command", status_code=204)
def give_command_back(service: Service, caller: Caller) -> None:
    """Give the command lease back; no effect for a session without it."""
    service.lease.give_back(caller)


# -- stop and alarms ------------------------------------------------------------------------


@router.post("/stop")
async def stop(service: Service, caller: Caller, body: StopBody) -> StopReport:
    """Bring the bench to its safe state at once; needs no command lease.

    This isn't an emergency stop in the sense of machine safety, which needs a hardware button.
    """
    return await asyncio.wrap_future(service.stop_aside(caller, body.reason))


@router.post("/presence", status_code=204)
def confirm_presence(service: Service, caller: Caller) -> None:
    """Confirm the operator's presence at the bench, if its description requires it."""
    service.confirm_presence(caller)


@router.get("/alarms")
def alarms(
    service: Watched,
    active: Annotated[bool, Query(description="Only active ones.")] = False,
) -> list[AlarmView]:
    """Return alarms and warnings since the bench was opened, the newest first."""
    return service.alarms(active=active)


@router.post("/alarms/acknowledge")
def acknowledge(
    service: Service, caller: Caller, body: AcknowledgeBody = ALL_ALARMS
) -> AlarmView | None:
    """Acknowledge the latched alarm after its cause is removed; null if there was none.

    If identifiers are given, alarms raised later stay active.
    """
    return service.acknowledge(caller, body.alarm_ids)


# -- compensation and the bench itself ------------------------------------------------------


@router.get("/sides/{side}/effects")
def effects(service: Watched, side: Side) -> list[EffectState]:
    """Return the state of every effect of a side's measuring chain at the newest window."""
    return list(service.effects(side))


@router.post("/sides/{side}/switches", status_code=204)
def switch_off(service: Service, caller: Caller, side: Side, body: SwitchBody) -> None:
    """Switch off corrections of a side until the bench is closed; U then contains their effects."""
    service.switch_off(caller, side, body.off, body.reason)
    service.wait_for_live()


@router.post("/bench/reopen", status_code=204)
def reopen(service: Service, caller: Caller) -> None:
    """Close the bench and open it again with the present settings."""
    service.reopen(caller)
