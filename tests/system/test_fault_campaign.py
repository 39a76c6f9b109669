"""The campaign of `tests/nightly`: what it draws, how it judges, and two of its faults."""

from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.support.faults import network
from tests.support.faults.bench import KINDS
from tests.support.faults.judging import differing
from tests.support.faults.network import (
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
from tests.support.faults.phases import PHASE_FAULTS, PHASE_KINDS, PHASES
from tests.support.faults.procedures import PROCEDURES, Procedure
from tests.support.faults.simulated import FULL, drawn

from torquebench.bench.description import BenchDescription
from torquebench.bench.safety import Alarm, AlarmKind
from torquebench.campaign.reducers.quantities import ReducerTestQuantity
from torquebench.errors import BenchError

PROFILES = ("rapid-in-situ", "staircase", "reversing", "small-torques", "adaptive")


def test_there_are_enough_kinds_and_every_procedure_gets_some() -> None:
    wires, phases = wire_faults(), [numbered.name for numbered in PHASE_KINDS]
    kinds = {kind.name for kind in KINDS} | {fault.kind for fault in wires} | set(phases)
    assert len(kinds) >= 45
    assert FULL + PHASE_FAULTS + 2 * len(wires) >= 500
    assert {name.partition(":")[0] for name in phases} == set(PHASES)
    plan = drawn(FULL, seed=1)
    counts = Counter(procedure.name for _, procedure in plan)
    assert set(counts) == {procedure.name for procedure in PROCEDURES}
    assert min(counts.values()) >= 5
    assert plan[:50] == drawn(50, seed=1), "a fault is repeated by its number"
    names = " ".join(counts)
    assert all(profile in names for profile in PROFILES)


def a_record(value: float) -> Any:
    quantity = ReducerTestQuantity("backlash", "Backlash", value, 0.1, 2.0, "arcmin")
    return SimpleNamespace(outcomes=[SimpleNamespace(name="hysteresis", quantities=[quantity])])


def test_a_result_is_wrong_where_both_uncertainties_do_not_explain_it() -> None:
    assert list(differing(a_record(1.0), a_record(1.19))) == []
    assert "undisturbed backlash 1.21" in next(differing(a_record(1.0), a_record(1.21)))


def a_spectrum(**amplitudes: float) -> Any:
    quantities = [
        ReducerTestQuantity(f"{key}_clockwise", key, value, 0.1, 2.0, "arcsec")
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


def procedure(name: str) -> Procedure:
    return next(each for each in PROCEDURES if each.name == name)


def test_an_instrument_that_does_not_answer_leaves_nothing_wrong(tmp_path: Path) -> None:
    fault, name = WireFault("reference", "drop"), "verify output"
    alarm = "instrument failed: acquisition"
    outcome = one_wire_fault(fault, procedure(name), 1, tmp_path, np.random.default_rng(1))
    assert outcome.problems == ()
    assert (outcome.status, outcome.alarm) == ("stopped", alarm)
    assert outcome.safe_s <= SAFE_S["on-demand"]
    assert outcome.wall_s <= AT_REST_S


@pytest.mark.nightly
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

    monkeypatch.setattr(network, "networked", patient)
    fault = WireFault("input_drive", "drop once")
    draw = np.random.default_rng(1)
    outcome = one_wire_fault(fault, procedure("verify input"), 1, tmp_path, draw)
    assert (outcome.problems, outcome.status) == ((), "harmless")
