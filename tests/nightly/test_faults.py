"""The campaign: one fault at a random moment on a new bench, which has to leave nothing wrong.

One of them alone: `pytest tests/nightly -m nightly -k "real_time and 12"`.
"""

import os
from pathlib import Path

import numpy as np
import pytest
from tests import postgresql_server
from tests.support.faults.judging import Outcome, ended_badly, record_of, slipped, unsafe_end
from tests.support.faults.network import LONG, numbered_real, numbered_wire, opened, wire_faults
from tests.support.faults.phases import PHASE_FAULTS, PHASE_KINDS, numbered_phase
from tests.support.faults.procedures import PROCEDURES, Procedure
from tests.support.faults.records import ACTS, attacked
from tests.support.faults.served import Served, powered
from tests.support.faults.simulated import FULL, drawn, numbered
from tests.system.interrupted_phases import LATE_S, PHASES, one_phase

from torquebench.procedures.reducers.turning import TransmissionRecording
from torquebench.station import Station

pytestmark = [pytest.mark.nightly, pytest.mark.timeout(1800)]
SEED = 1
WIRES = [fault.name for fault in wire_faults()]


def survived(outcome: Outcome) -> None:
    assert outcome.problems == (), outcome


@pytest.mark.parametrize("index", range(FULL), ids=[
    f"{number} {kind.name}" for number, (kind, _) in enumerate(drawn(FULL, SEED))
])  # fmt: skip
def test_on_the_simulated_bench(index: int) -> None:
    survived(numbered(index, SEED))


@pytest.mark.parametrize("index", range(PHASE_FAULTS), ids=[
    f"{number} {PHASE_KINDS[number % len(PHASE_KINDS)].name}" for number in range(PHASE_FAULTS)
])  # fmt: skip
def test_at_a_phase_of_a_calibration(index: int) -> None:
    survived(numbered_phase(index, SEED))


@pytest.mark.parametrize("index", range(len(WIRES)), ids=WIRES)
def test_over_sockets(index: int) -> None:
    survived(numbered_wire(index, SEED))


@pytest.mark.alone
@pytest.mark.parametrize("index", range(len(WIRES)), ids=WIRES)
def test_over_sockets_in_real_time(index: int) -> None:
    survived(numbered_real(index, SEED))


@pytest.mark.parametrize("real", [False, pytest.param(True, marks=pytest.mark.alone)])
@pytest.mark.parametrize("act", ACTS)
def test_on_records_and_interfaces_while_a_bench_calibrates(act: str, real: bool) -> None:
    survived(attacked(act, SEED, real=real))


if postgresql_server.binaries() is not None or os.environ.get("CI"):

    @pytest.mark.parametrize("phase", PHASES)
    def test_a_restart_of_the_database_costs_nothing(phase: str, tmp_path: Path) -> None:
        index = list(PHASES).index(phase)
        late_s = LATE_S * float(np.random.default_rng([SEED, index]).uniform())
        with postgresql_server.restartable() as server:
            outcome = one_phase(
                "database restarts", phase, tmp_path, SEED + index, late_s=late_s, server=server
            )
        assert (outcome.problems, outcome.alarm) == ((), "")


@pytest.mark.alone
@pytest.mark.timeout(3600)
def test_undisturbed_work_in_real_time_raises_no_alarm(tmp_path: Path) -> None:
    """One procedure after the other on one bench, on another one after a problem."""
    left = [each for each in PROCEDURES if each.name not in LONG]
    found: dict[str, list[str]] = {}
    while left:
        with opened(SEED, tmp_path / str(len(left)), "real") as (station, bench):
            while left:
                procedure = left.pop(0)
                if problems := undisturbed(station, bench, procedure):
                    found[procedure.name] = problems
                    break
    assert found == {}


def undisturbed(station: Station, bench: Served, procedure: Procedure) -> list[str]:
    """Run a procedure while nothing is broken, and return what is wrong nevertheless."""
    before = len(station.supervisor.history)
    error: BaseException | None = None
    result: object = None
    try:
        result = procedure.go(station)
    except Exception as raised:
        error = raised
        station.supervisor.wait_safe(20.0)
    alarms = station.supervisor.history[before:]
    problems = [f"false alarm: {alarm.name}: {alarm.found}" for alarm in alarms]
    if error is not None and not alarms:
        problems.append(f"false alarm: {type(error).__name__}: {error}")
    problems += ended_badly(error, alarms, disk=False)
    problems += unsafe_end(station, not powered(bench.status()))
    problems += record_of(station, error)[1]
    if isinstance(result, TransmissionRecording):
        problems += slipped(result)
    return problems
