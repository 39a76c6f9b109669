"""Nothing is broken: procedure after procedure in real time over sockets, and no alarm may come."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from benchmarks.fault_judging import (
    Outcome,
    ended_badly,
    line_of,
    record_of,
    slipped,
    status_of,
    unsafe_end,
)
from benchmarks.fault_procedures import PROCEDURES, Procedure
from benchmarks.fault_report import Kept
from benchmarks.network_faults import LONG, opened
from benchmarks.served import Served, powered
from torquebench.procedures.reducers.turning import TransmissionRecording
from torquebench.station import Station

__all__ = ["TITLE", "one_undisturbed", "undisturbed"]

TITLE = "undisturbed in real time over sockets"
NAME = "undisturbed"


@dataclass
class _Bench:
    """A bench that stays open from one procedure to the next, as long as nothing is wrong."""

    seed: int
    open_: ExitStack
    bench: tuple[Station, Served] | None = None

    def get(self) -> tuple[Station, Served]:
        """Return it, opened anew after a problem."""
        if self.bench is None:
            folder = Path(self.open_.enter_context(tempfile.TemporaryDirectory()))
            self.bench = self.open_.enter_context(opened(self.seed, folder, "real"))
        return self.bench

    def close(self) -> None:
        """Close it after a problem."""
        self.bench = None
        self.open_.close()


def undisturbed(minutes: float, seed: int, kept: Kept, *, tell: bool = False) -> Sequence[Outcome]:
    """Go through procedures in turn until they have taken so many minutes.

    Parameters
    ----------
    minutes : float
        Together with what is kept from before, of other seeds too.
    seed : int
    kept : Kept
    tell : bool
        Say each one.
    """
    chosen = [procedure for procedure in PROCEDURES if procedure.name not in LONG]
    outcomes = [each for (part, other, _), each in kept.outcomes.items()
                if part == NAME and other != seed]  # fmt: skip
    passed_s = sum(outcome.lasted_s for outcome in outcomes)
    with ExitStack() as open_:
        bench = _Bench(seed, open_)
        for index in count():
            if passed_s >= 60.0 * minutes:
                return outcomes
            procedure = chosen[index % len(chosen)]

            def run(procedure: Procedure = procedure, index: int = index) -> Outcome:
                outcome = one_undisturbed(*bench.get(), procedure, index, seed)
                if outcome.problems:
                    bench.close()
                return outcome

            outcomes.append(kept.one(NAME, seed, index, run))
            passed_s += outcomes[-1].lasted_s
            if tell:
                print(line_of(outcomes[-1]), flush=True)
    raise AssertionError("unreachable")


def one_undisturbed(
    station: Station, bench: Served, procedure: Procedure, index: int, seed: int
) -> Outcome:
    """Run a procedure while nothing is broken, and say what is wrong nevertheless."""
    before, began = len(station.supervisor.history), time.monotonic()
    error: BaseException | None = None
    result: object = None
    try:
        result = procedure.go(station)
    except Exception as raised:
        error = raised
        station.supervisor.wait_safe(20.0)
    lasted_s = time.monotonic() - began
    alarms = station.supervisor.history[before:]
    problems = [f"false alarm: {alarm.name}: {alarm.found}" for alarm in alarms]
    if error is not None and not alarms:
        problems.append(f"false alarm: {type(error).__name__}: {error}")
    problems += ended_badly(error, alarms, disk=False)
    problems += unsafe_end(station, not powered(bench.status()))
    points, wrong = record_of(station, error)
    if isinstance(result, TransmissionRecording):
        problems += slipped(result)
    status, named = status_of(error, alarms)
    return Outcome(
        NAME,
        procedure.name,
        status,
        named,
        float("nan"),
        points,
        (*problems, *wrong),
        index=index,
        seed=seed,
        lasted_s=lasted_s,
    )
