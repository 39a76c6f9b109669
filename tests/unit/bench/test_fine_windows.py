"""Windows shorter than the bench's own, evaluated with the chain in use."""

import numpy as np
import pytest

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.blocks import Block
from torquebench.bench.channels import FAST_WINDOW_S, FINE_WINDOW_S, open_channel
from torquebench.bench.description import default_bench
from torquebench.bench.drivers.simulated.driver import open_simulated
from torquebench.bench.evaluating import BlockEvaluator
from torquebench.chain import MeasuringChain, Ripple
from torquebench.compensation import features, make_model

AMPLITUDE_NM, ORDER, LARGEST_RPM = 0.1, 20.0, 1200.0


def rippling(range_nm: float) -> ActiveChain:
    """A chain whose ripple a reading of unknown angle and speed has in its uncertainty."""
    reading = np.linspace(-range_nm, range_nm, 21)
    model = make_model("polynomial", range_nm=range_nm).fit(features(reading, 0), reading)
    amplitude = ((AMPLITUDE_NM, 0.0, 0.0, 0.0, 0.0),)
    none = ((0.0, 0.0, 0.0, 0.0, 0.0),)
    speeds_rpm, no_u = (0.0, LARGEST_RPM), (0.0, 0.0)
    ripple = Ripple("empty runs", LARGEST_RPM, 0.01, (ORDER,), amplitude, none, speeds_rpm, no_u)
    return ActiveChain(MeasuringChain(model, (ripple,)), "1", "polynomial")


@pytest.mark.parametrize("window_s", [FINE_WINDOW_S, FAST_WINDOW_S])
def test_their_length_counts_in_their_uncertainty(window_s: float) -> None:
    bench = default_bench()
    drivers = open_simulated(bench)
    channel = open_channel("input_torque", bench, drivers, "nothing")
    evaluator, active = BlockEvaluator(bench, drivers), rippling(bench.input.range_nm)
    drivers.counter.select(frozenset({"input_torque"}))
    channel.count_finely(window_s)
    for _ in range(3):
        measured = drivers.counter.read_block(0.05)
        unknown = Block(measured.start_s, measured.stop_s, measured.edges)
        block = evaluator.evaluate(unknown, [channel])
        evaluator.compensate([block], {"input_torque": channel}, {"input": active})
    fine = active.fine_window(0.0, 1.0)
    assert fine is not None
    _, torque = fine
    left = np.sinc(ORDER * LARGEST_RPM / 60.0 * window_s)
    expected = abs(left) * AMPLITUDE_NM / np.sqrt(2.0)
    np.testing.assert_allclose(torque.component("ripple by angle"), expected)
