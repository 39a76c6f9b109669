"""Status of live values by age, fault and alarm; the machine's state."""

from dataclasses import replace
from datetime import UTC, date, datetime, timedelta

import pytest

from torquebench.panel.service.live.hub import LatestValue
from torquebench.panel.service.live.snapshot import BenchSnapshot, CompensationState, SideSnapshot
from torquebench_opcua import live_values, machine_state

NOW = datetime(2026, 11, 23, 12, 0, tzinfo=UTC)
FRESH = LatestValue(12.5, 0.02)


def bench(torque: LatestValue = FRESH, *, valid: bool | None = True) -> BenchSnapshot:
    state = None
    if valid is not None:
        state = CompensationState(1, 1, "hybrid", NOW, date(2027, 1, 1), valid)
    side = SideSnapshot(
        side="output",
        range_nm=2000.0,
        limit_nm=2000.0,
        limit_rpm=100.0,
        transducer_serial="T-7",
        compensation=state,
        compensation_problem="",
        torque=torque,
        expanded_uncertainty=FRESH,
        raw=torque,
        reference=FRESH,
        speed=FRESH,
        angle=FRESH,
        temperature=FRESH,
    )
    return BenchSnapshot(
        bench_name="Bench 4",
        simulated=True,
        connection="live",
        connection_problem="",
        bench_time_s=10.0,
        age_s=0.02,
        sequence=1,
        mounted="reducer",
        sides={"output": side},
        efficiency=LatestValue(None, float("inf")),
        alarms=0,
        stopped=False,
        job_id=None,
        paused=False,
        commanded_by=None,
    )


@pytest.mark.parametrize(
    ("shown", "raw", "torque"),
    [
        (bench(), "Good", "Good"),
        (bench(valid=False), "Good", "UncertainSensorNotAccurate"),
        (bench(valid=None), "Good", "UncertainSensorNotAccurate"),
        (bench(LatestValue(1.0, 1.5)), "UncertainLastUsableValue", "UncertainLastUsableValue"),
        (bench(LatestValue(1.0, 0.1, "no pulses")), "BadSensorFailure", "BadSensorFailure"),
        (bench(LatestValue(None, 9.0, "no pulses")), "BadSensorFailure", "BadSensorFailure"),
        (bench(LatestValue(None, 9.0)), "BadNoData", "BadNoData"),
        (replace(bench(), stopped=True), "UncertainSubNormal", "UncertainSubNormal"),
        (replace(bench(), connection="lost"), "BadNoCommunication", "BadNoCommunication"),
    ],
)
def test_a_value_says_how_good_it_is(shown: BenchSnapshot, raw: str, torque: str) -> None:
    found = live_values(shown, NOW)
    assert found["output", "RawTorque"].status == raw
    assert found["output", "Torque"].status == torque


def test_the_source_time_is_that_of_the_measurement() -> None:
    found = live_values(bench(LatestValue(1.0, 0.5)), NOW)
    assert found["output", "Torque"].source_time == NOW - timedelta(seconds=0.5)
    assert found["", "Efficiency"].source_time is None


def test_the_state_follows_connection_alarm_and_job() -> None:
    shown = bench()
    assert machine_state(shown) == "NotExecuting"
    assert machine_state(replace(shown, job_id="j")) == "Executing"
    assert machine_state(replace(shown, job_id="j", paused=True)) == "Executing"
    assert machine_state(replace(shown, job_id="j", stopped=True)) == "OutOfService"
    assert machine_state(replace(shown, stopped=True, connection="lost")) == "NotAvailable"
