from pathlib import Path

import numpy as np
import pytest
from benchmarks import faults
from benchmarks.fault_bench import KINDS
from benchmarks.network_faults import WireFault, one_wire_fault, wire_faults

SAMPLE = (
    "transducer silent",
    "standard frozen",
    "wild reading",
    "drive doesn't answer",
    "drive pulls too much",
    "watchdog isn't fed",
    "disk full for samples",
    "counter lost",
)


def test_there_are_enough_kinds_and_every_procedure_gets_some() -> None:
    assert len({kind.name for kind in KINDS}) >= 15
    assert faults.FULL >= 200
    draw = np.random.default_rng(1)
    drawn = {faults.fitting_procedure(kind, draw).name for kind in KINDS for _ in range(40)}
    assert drawn == {procedure.name for procedure in faults.PROCEDURES}


def test_a_sample_of_the_campaign_leaves_nothing_wrong(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kinds = tuple(kind for kind in KINDS if kind.name in SAMPLE)
    assert len(kinds) == len(SAMPLE)
    monkeypatch.setattr(faults, "KINDS", kinds)
    outcomes = faults.campaign(len(kinds), seed=5)
    assert [outcome.problems for outcome in outcomes] == [()] * len(kinds)
    assert sum(outcome.status == "stopped" for outcome in outcomes) >= 5


def test_every_instrument_on_the_wire_gets_every_kind() -> None:
    drawn = wire_faults()
    assert len({fault.name for fault in drawn}) == len(drawn) == faults.FULL_WIRE
    assert len({fault.endpoint for fault in drawn[: faults.QUICK_WIRE]}) == faults.QUICK_WIRE
    for fault in drawn:
        assert any(fault.fits(each.name, each.side) for each in faults.PROCEDURES)


def test_a_standard_that_no_longer_answers_leaves_nothing_wrong(tmp_path: Path) -> None:
    verify = next(each for each in faults.PROCEDURES if each.name == "verify output")
    fault = WireFault("reference", "drop")
    outcome = one_wire_fault(fault, verify, 1, tmp_path, np.random.default_rng(1))
    assert outcome.problems == ()
    assert (outcome.status, outcome.alarm) == ("stopped", "instrument failed: acquisition")
