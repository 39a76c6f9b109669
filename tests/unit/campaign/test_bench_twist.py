"""The bench's own twist in torque-angle loops: bent over the torque, and at the locked input."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from torquebench.bench.description import default_bench
from torquebench.bench.devices import SynchronousRecording
from torquebench.campaign.reducers.kinds.hysteresis import WORK as HYSTERESIS
from torquebench.campaign.reducers.twist import twist_compliances
from torquebench.campaign.reducers.uncertainty import Bench
from torquebench.chain import TorqueParts
from torquebench.procedures.reducers.loop import BenchTwistRecording, Loop, LoopRecording
from torquebench.reducers import load_reducer

REDUCER = load_reducer("standard")
RATED = REDUCER.rated_torque_nm
REDUCER_COMPLIANCE = 7.3e-7
INPUT_COMPLIANCE = 3.3e-5
ARCMIN = np.pi / 10800.0


def output_twist(torque):
    """Bearings and splines take a constant part of the torque as soon as there is some."""
    return 1.11e-6 * (torque - 4.0 * np.tanh(torque / 100.0))


def legs(*corners, samples=2000):
    parts = [np.linspace(a, b, samples) for a, b in pairwise(corners)]
    return np.concatenate(parts)


def recording(output_nm, output_rad, input_nm, input_rad):
    unknown = np.full(output_nm.size, np.nan)
    time = 0.01 * np.arange(output_nm.size)
    parts = TorqueParts(*[unknown] * 8)
    inertia = np.zeros(output_nm.size)
    return SynchronousRecording(
        time, input_nm, output_nm, parts, parts, inertia, inertia, input_rad, output_rad
    )


def twisted(generator, share=0.0):
    """Return cycles against the calibrator; the angle lags behind the torque by a share."""
    found = {}
    for side, largest in (("output", RATED), ("input", RATED / REDUCER.ratio)):
        torque = legs(0.0, largest, -largest, 0.0)
        true = torque - share * largest * np.sign(np.gradient(torque))
        angle = output_twist(true) if side == "output" else INPUT_COMPLIANCE * true
        angle = angle + 5e-7 * generator.standard_normal(torque.size)
        nothing = np.zeros(torque.size)
        columns = (torque, angle, nothing, nothing)
        if side == "input":
            columns = (nothing, nothing, torque, angle)
        found[side] = recording(*columns)
    return BenchTwistRecording(found, "C1")


def measured(generator, sides):
    """Evaluate a loop of a straight reducer whose bench's twist is known at some sides."""
    torque = legs(-RATED, RATED, -RATED, samples=4000)
    # What holds the locked input acts against what comes through the reducer.
    holding = -torque / REDUCER.signed_ratio
    flange = -4.0e-5 * holding
    seen = flange + INPUT_COMPLIANCE * holding
    lag = 2.0e-5 * np.sign(np.gradient(torque))
    output = flange / REDUCER.signed_ratio + REDUCER_COMPLIANCE * torque - lag
    output += output_twist(torque) + 5e-7 * generator.standard_normal(torque.size)
    loop = Loop(0.0, 1, recording(torque, output, holding, seen))
    found = twist_compliances(twisted(generator))
    bench = Bench(default_bench(), {side: found[side] for side in sides}, {})
    loops = LoopRecording((loop,), RATED, {"input": False, "output": False}, 23.0)
    return HYSTERESIS.evaluate(bench, REDUCER, loops)


def test_a_bent_twist_and_the_inputs_wind_up_are_taken_off():
    generator = np.random.default_rng(1)
    both = measured(generator, ("output", "input"))
    output = measured(generator, ("output",))
    truth = ARCMIN / REDUCER_COMPLIANCE
    assert both.result.stiffness.value == pytest.approx(truth, rel=5e-4)
    assert both.result.lost_motion.value == pytest.approx(
        0.06 * RATED * REDUCER_COMPLIANCE / ARCMIN, abs=2e-3
    )
    # What is left in without the input: its compliance over the ratio's square.
    share = INPUT_COMPLIANCE / REDUCER.ratio**2 / REDUCER_COMPLIANCE
    assert output.result.stiffness.value == pytest.approx(truth * (1.0 - share), rel=5e-4)
    assert share > 0.005
    said = " ".join(both.remarks)
    assert "twist at the output" in said
    assert "twist at the input" in said


def test_twist_follows_its_bend_and_knows_how_far_its_legs_differ():
    generator = np.random.default_rng(2)
    twist = twist_compliances(twisted(generator))["output"]
    torque = np.linspace(-RATED, RATED, 101)
    bent = twist.at(torque) - output_twist(torque)
    assert np.ptp(bent) < 5e-7
    # A straight line alone is off by ten times as much.
    assert np.ptp(replace(twist, level_nm=(), bend_rad=()).at(torque) - output_twist(torque)) > 3e-6
    assert twist.at(2.0 * RATED) - twist.at(1.5 * RATED) == pytest.approx(
        0.5 * RATED * twist.rad_per_nm
    )
    lagging = twist_compliances(twisted(generator, share=0.002))["output"]
    assert twist.standard_uncertainty_rad_per_nm < 2e-10
    assert lagging.standard_uncertainty_rad_per_nm > twist.standard_uncertainty_rad_per_nm
