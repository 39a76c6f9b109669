import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from benchmarks import faults, network_faults
from benchmarks.fault_bench import KINDS, TRIES
from benchmarks.fault_judging import Outcome, differing
from benchmarks.fault_procedures import PROCEDURES
from benchmarks.fault_report import Kept, section, summary
from benchmarks.network_faults import (
    AT_REST_S,
    ENDPOINTS,
    LONG,
    SAFE_S,
    SLOW,
    WireFault,
    drawn_wires,
    networked,
    one_wire_fault,
    time_to_rest,
    wire_faults,
)
from benchmarks.phase_faults import PHASE_FAULTS, PHASE_KINDS, PHASES

from torquebench.bench.description import BenchDescription
from torquebench.bench.safety import Alarm, AlarmKind
from torquebench.campaign.reducers.quantities import ReducerTestQuantity
from torquebench.errors import BenchError

SAMPLE = (
    "transducer silent",
    "standard frozen",
    "outlier reading",
    "drive doesn't answer",
    "drive pulls too much",
    "drive acknowledges and stays on",
    "watchdog isn't fed",
    "probes lost",
    "disk full for samples",
    "counter lost",
)
QUICK_SEED = 17
"""Draws procedures for them that don't last long."""
PROFILES = ("rapid-in-situ", "staircase", "reversing", "small-torques", "adaptive")


def test_there_are_enough_kinds_and_every_procedure_gets_some() -> None:
    wires, phases = wire_faults(), [numbered.name for numbered in PHASE_KINDS]
    kinds = {kind.name for kind in KINDS} | {fault.kind for fault in wires} | set(phases)
    assert len(kinds) >= 45
    assert faults.FULL + PHASE_FAULTS + 2 * len(wires) >= 500
    assert {name.partition(":")[0] for name in phases} == set(PHASES)
    plan = faults.drawn(faults.FULL, seed=1)
    counts = Counter(procedure.name for _, procedure in plan)
    assert set(counts) == {procedure.name for procedure in PROCEDURES}
    assert min(counts.values()) >= 5
    assert plan[:50] == faults.drawn(50, seed=1), "a fault is repeated by its number"
    names = " ".join(counts)
    assert all(profile in names for profile in PROFILES)


def gone_through(number: int, file: Path) -> list[Outcome]:
    begun = Kept(file).begin("simulated", faults.numbered, number, QUICK_SEED)
    return faults.gone_through(begun, tell=False)


@pytest.mark.nightly
def test_a_sample_of_the_campaign_leaves_nothing_wrong(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    kinds = tuple(kind for kind in KINDS if kind.name in SAMPLE)
    assert len(kinds) == len(SAMPLE)
    monkeypatch.setattr(faults, "KINDS", kinds)
    file = tmp_path / "kept.jsonl"
    outcomes = gone_through(len(kinds), file)
    assert [outcome.problems for outcome in outcomes] == [()] * len(kinds)
    assert sum(outcome.status == "stopped" for outcome in outcomes) >= 5
    again = gone_through(len(kinds), file)  # nothing is run again
    assert [replace(each, safe_s=0.0, wall_s=0.0) for each in again] == [
        replace(each, safe_s=0.0, wall_s=0.0) for each in outcomes
    ]
    assert len(file.read_text().splitlines()) == len(kinds)
    told = section({"simulated bench": outcomes}, "a machine.")
    assert "| together | 10 | 10 | 10 | 0 | 0 | 0 | 0 | 0 |" in told
    assert "faults survived 10 of 10" in "\n".join(summary(outcomes, "here"))


def test_what_was_not_survived_is_said_with_its_number() -> None:
    problem = "unsafe: a drive isn't off"
    outcome = Outcome("probes lost", "zero", "stopped", "x", 0.2, 3, (problem,), seed=4)
    assert "Not survived: probes lost in zero (seed 4, number 0)" in section(
        {"here": [outcome]}, ""
    )
    said = "\n".join(summary([outcome], "here"))
    assert "faults survived 0 of 1" in said
    assert "1 unsafe ends, 0 stranded" in said


def a_record(value: float) -> Any:
    quantity = ReducerTestQuantity("backlash", "Backlash", value, 0.1, "arcmin")
    return SimpleNamespace(outcomes=[SimpleNamespace(name="hysteresis", quantities=[quantity])])


def test_a_result_is_wrong_where_both_uncertainties_do_not_explain_it() -> None:
    assert list(differing(a_record(1.0), a_record(1.19))) == []
    assert "undisturbed backlash 1.21" in next(differing(a_record(1.0), a_record(1.21)))


def a_spectrum(**amplitudes: float) -> Any:
    quantities = [
        ReducerTestQuantity(f"{key}_clockwise", key, value, 0.1, "arcsec")
        for key, value in amplitudes.items()
    ]
    return SimpleNamespace(
        outcomes=[SimpleNamespace(name="transmission-error", quantities=quantities)]
    )


def test_an_order_that_is_not_listed_is_at_most_as_large_as_the_least_that_is() -> None:
    undisturbed = a_spectrum(order_1=5.0, order_2=0.30)
    assert list(differing(a_spectrum(order_1=5.0, order_9=0.35), undisturbed)) == []
    (said,) = differing(a_spectrum(order_1=5.0, order_9=0.60), undisturbed)
    assert "order_9_clockwise 0.6" in said
    assert "down to order_2_clockwise 0.3" in said
    lost = list(differing(a_spectrum(order_2=0.30), undisturbed))
    assert len(lost) == 1
    assert "order_1_clockwise 5" in lost[0]
    assert "isn't among the largest of the disturbed result" in lost[0]


def ended(broken_s: float, safe_s: float, resting_s: float) -> Any:
    return SimpleNamespace(was_on=True, broken_s=broken_s, safe_s=safe_s, resting_s=resting_s)


def test_answers_that_nobody_can_doubt_count_from_their_alarm() -> None:
    alarm = Alarm(AlarmKind.NOT_SAFE, "output", "still on", "off", "press the stop", 25.6)
    ways, error = ended(12.8, 14.0, 25.7), BenchError("still on", "off")
    for kind, alarms, expected in (
        ("drop", (alarm,), 1.2),
        ("freeze", (alarm,), 0.1),
        ("freeze", (), float("nan")),  # the procedure itself refuses what it has read
    ):
        found = time_to_rest(WireFault("output_drive", kind), ways, error, alarms)
        assert found == pytest.approx(expected, nan_ok=True)


def test_every_instrument_on_the_wire_gets_every_kind() -> None:
    drawn = wire_faults()
    assert len({fault.name for fault in drawn}) == len(drawn)
    assert {fault.endpoint for fault in drawn} == set(ENDPOINTS)
    for left_out in (SLOW, LONG):
        assert all(fitting for _, fitting in drawn_wires(len(drawn), 1, left_out))


def procedure(name: str) -> faults.Procedure:
    return next(each for each in PROCEDURES if each.name == name)


@pytest.mark.parametrize(
    ("fault", "name", "alarm"),
    [
        (WireFault("reference", "drop"), "verify output", "instrument failed: acquisition"),
        pytest.param(
            WireFault("input_drive", "delay"),
            "verify input",
            "drive fault: input",
            marks=pytest.mark.nightly,
        ),
        pytest.param(
            WireFault("output_drive", "disconnect"),
            "verify output",
            "drive fault: output",
            marks=pytest.mark.nightly,
        ),
    ],
)
def test_an_instrument_that_does_not_answer_leaves_nothing_wrong(
    tmp_path: Path, fault: WireFault, name: str, alarm: str
) -> None:
    outcome = one_wire_fault(fault, procedure(name), 1, tmp_path, np.random.default_rng(1))
    assert outcome.problems == ()
    assert (outcome.status, outcome.alarm) == ("stopped", alarm)
    assert outcome.safe_s <= SAFE_S["on-demand"]
    assert outcome.wall_s <= AT_REST_S


def test_an_instrument_that_fails_once_is_no_reason_to_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def patient(seed: int, time: Any) -> BenchDescription:  # a busy computer fails nothing itself
        description = networked(seed, time)
        driver = {
            key: section | {"timeout_s": 20.0}
            if not key.endswith("_drive") and key != "simulation"
            else section
            for key, section in description.driver.items()
        }
        changed: dict[str, Any] = {"driver": driver}
        for side in ("input", "output"):
            module = description.module(side)
            drive = module.drive.model_copy(update={"watchdog_s": 10.0})
            changed[side] = module.model_copy(update={"drive": drive})
        return description.model_copy(update=changed)

    monkeypatch.setattr(network_faults, "networked", patient)
    fault = WireFault("input_drive", "drop once")
    draw = np.random.default_rng(1)
    outcome = one_wire_fault(fault, procedure("verify input"), 1, tmp_path, draw)
    assert (outcome.problems, outcome.status) == ((), "harmless")


@pytest.mark.nightly
def test_the_same_holds_in_real_time(tmp_path: Path) -> None:
    fault, draw = WireFault("input_drive", "disconnect"), np.random.default_rng(1)
    for attempt in range(TRIES):  # a busy computer may stop it before its drive is broken
        data = tmp_path / str(attempt)
        outcome = one_wire_fault(fault, procedure("verify input"), 1, data, draw, "real")
        if outcome.status != "too late":
            break
    assert outcome.problems == ()
    assert outcome.status == "stopped"


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["seal: killed"])
def test_a_calibration_that_was_killed_is_found_and_certified(name: str) -> None:
    number = [kind.name for kind in PHASE_KINDS].index(name)
    command = [sys.executable, "-m", "benchmarks.faults", "--only", f"phases:{number}"]
    survived = subprocess.run(command, capture_output=True, text=True, check=False)
    assert survived.returncode == 0, survived.stdout + survived.stderr
    assert f"kind={name!r}" in survived.stdout
    assert "points=16" in survived.stdout
