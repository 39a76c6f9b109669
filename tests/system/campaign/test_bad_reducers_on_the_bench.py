"""Slipping encoders, wrong ratios and bad loops at the simulated bench: named, not averaged."""

from dataclasses import replace

import numpy as np
import pytest

from torquebench.bench.description import default_bench
from torquebench.campaign.reducers.kinds.hysteresis import WORK as HYSTERESIS
from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.campaign.reducers.tests import run_reducer_test
from torquebench.campaign.reducers.uncertainty import Bench
from torquebench.errors import BenchError, InputError, SignalFault
from torquebench.procedures.reducers.loop import HysteresisSettings
from torquebench.procedures.reducers.turning import TransmissionSettings
from torquebench.reducers import load_reducer
from torquebench.station import Station

REDUCER = load_reducer("rv-40e")
SHORT = replace(ReducerTestSettings.short(), bench_twist=None).with_plans(
    {
        "hysteresis": HysteresisSettings(loops=1, positions_deg=(0.0,), loop_s=10.0),
        "transmission-error": TransmissionSettings(output_rpm=6.0, counter_clockwise=False),
    }
)


def bench(ratio=REDUCER.ratio):
    described = default_bench()
    settings = described.bench.model_copy(update={"reducer_ratio": ratio})
    driver = {**described.driver, "reducer": "rv-40e"}
    return described.model_copy(update={"driver": driver, "bench": settings})


def slip(station, side, counts, after_s):
    twin = station.drivers.counter.twin
    twin.inject_fault(side, "encoder_slip", start_s=twin.time_s + after_s, amount=counts)


@pytest.mark.parametrize(
    ("counts", "error", "words"),
    [(60, InputError, "jumps by 21"), (2000, SignalFault, "output encoder slips")],
)
def test_an_encoder_that_slips_in_a_revolution_is_named(tmp_path, counts, error, words):
    with Station.open(bench(), tmp_path) as station:
        slip(station, "output", counts, 13.0)
        with pytest.raises(error, match=words):
            run_reducer_test(station, "transmission-error", REDUCER, SHORT)


def test_an_encoder_that_slips_in_a_loop_leaves_it_open(tmp_path):
    with Station.open(bench(), tmp_path) as station:
        slip(station, "output", 250, 16.0)
        with pytest.raises(InputError, match="doesn't close"):
            run_reducer_test(station, "hysteresis", REDUCER, SHORT)


@pytest.mark.parametrize(
    ("ratio", "error", "words"),
    [(121.01, InputError, "the ratio is wrong.*121"), (100.0, BenchError, "ratio")],
)
def test_another_ratio_than_described_is_named(tmp_path, ratio, error, words):
    other = REDUCER.model_copy(update={"ratio": ratio})
    with (
        Station.open(bench(ratio), tmp_path) as station,
        pytest.raises(error, match=words),
    ):
        run_reducer_test(station, "transmission-error", other, SHORT)


def test_too_few_samples_for_the_highest_order_are_named(tmp_path):
    fine = REDUCER.model_copy(update={"highest_error_order": 2000.0})
    with (
        Station.open(bench(), tmp_path) as station,
        pytest.raises(InputError, match="samples per period of the order 2000"),
    ):
        run_reducer_test(station, "transmission-error", fine, SHORT)


def test_less_than_a_revolution_is_no_setting():
    with pytest.raises(InputError, match="at least one revolution"):
        TransmissionSettings(revolutions=0.9)


def test_a_preload_that_hides_backlash_is_named_beside_the_loops(tmp_path):
    """The same loops under a constant torque of 60 N·m, which no play shows through."""
    with Station.open(bench(), tmp_path) as station:
        (outcome,) = run_reducer_test(station, "hysteresis", REDUCER, SHORT).outcomes
        loops = outcome.recording
        known = Bench(station.description, {}, {})
    moved = tuple(
        replace(
            loop,
            recording=replace(
                loop.recording, output_torque_nm=np.asarray(loop.recording.output_torque_nm) + 60.0
            ),
        )
        for loop in loops.loops
    )
    lower = REDUCER.model_copy(update={"rated_torque_nm": 330.0})
    result = HYSTERESIS.evaluate(known, lower, replace(loops, loops=moved)).result
    hidden = [each for each in result.findings if each.name == "backlash hidden by preload"]
    assert hidden, [each.name for each in result.findings]
    assert hidden[0].severe
