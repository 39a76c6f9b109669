import numpy as np
import pytest
from benchmarks import faults
from benchmarks.fault_bench import KINDS

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
