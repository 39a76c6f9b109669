"""The running bench's torque-angle loop against the quasi-static one of the same reducer."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.draws import nightly
from tests.support.reducer_truth import true_loop, true_loop_values

from torquebench.reducers import LoopSettings, evaluate_hysteresis
from torquebench.twin import BenchTwin, TwinParameters

SHARE, INTERVAL = 0.03, (0.5, 0.9)


def running_loop(parameters, loop_s=12.0):
    """Torque at the reducer and its twist, each millisecond, over one loop after a preload."""
    twin = BenchTwin(parameters, seed=1, active_channels=())
    twin.mount("reducer")
    twin.set_clamped(True)
    twin.set_mode("input", "locked")
    twin.set_mode("output", "driven")
    twin.enable("output", True)
    rated, ratio = parameters.reducer.rated_torque_nm, parameters.reducer.ratio
    torque, twist, present = [], [], 0.0
    for target in (rated, -rated, rated, -rated):
        steps = round(abs(target - present) / rated * loop_s / 4.0 / 0.01)
        for level in np.linspace(present, target, steps + 1)[1:]:
            twin.command_torque("output", float(level))
            truth = twin.advance(0.01).truth
            torque.append(truth.torque_nm["output"])
            twist.append(truth.angle_rad["output"] - truth.angle_rad["input"] / ratio)
        present = target
    half = len(torque) * 3 // 7
    return np.concatenate(torque[half:]), np.concatenate(twist[half:])


@pytest.mark.parametrize("rippling", [True, nightly(False)])
@pytest.mark.parametrize("name", ["rv-40e", "standard"])
def test_running_loop_is_the_true_one_where_the_angle_is_outermost(name, rippling):
    parameters = TwinParameters.draw("nominal", 5, reducer=name)
    if not rippling:
        drive = parameters.output.drive._replace(ripple_nm=0.0)
        parameters = replace(parameters, output=replace(parameters.output, drive=drive))
    rated = parameters.reducer.rated_torque_nm
    known = true_loop_values(
        parameters.reducer, rated, lost_motion_share=SHARE, stiffness_interval=INTERVAL
    )
    result = evaluate_hysteresis(
        *running_loop(parameters), LoopSettings(rated, stiffness_interval=INTERVAL)
    )
    for each in result.quantities():
        if each.key in ("backlash", "hysteresis_loss"):
            assert each.estimate.value == pytest.approx(known[each.key], rel=0.02), each.key
    names = {each.name for each in result.findings}
    assert "torque ripple" in names or not rippling


def test_ripple_narrows_the_mean_loop_of_the_same_reducer():
    """Vibration takes the stops back: why means over a ripple aren't the quasi-static loop."""
    parameters = TwinParameters.draw("nominal", 5, reducer="rv-40e")
    torque, twist = running_loop(parameters)
    width = round(2000.0 / parameters.output.drive.ripple_hz)
    mean = [np.convolve(each, np.full(width, 1.0 / width), "valid") for each in (torque, twist)]
    rated = parameters.reducer.rated_torque_nm
    steady = true_loop(parameters.reducer, rated)
    settings = LoopSettings(rated, stiffness_interval=INTERVAL)
    loss = [evaluate_hysteresis(*each, settings).energy.value for each in (mean, steady)]
    assert 0.6 < loss[0] / loss[1] < 0.95


@pytest.mark.parametrize("name", ["standard", "rv-40e", "harmonic-20"])
def test_true_values_follow_the_definitions(name):
    reducer = TwinParameters.draw("nominal", 4, reducer=name).reducer
    rated = reducer.rated_torque_nm
    known = true_loop_values(reducer, rated, lost_motion_share=SHARE, stiffness_interval=INTERVAL)
    torque, angle = true_loop(reducer, rated)
    closed = np.append(torque, torque[0]), np.append(angle, angle[0])
    assert known["hysteresis_loss"] == pytest.approx(np.trapezoid(*closed), rel=1e-3)
    arcmin = np.pi / 180.0 / 60.0
    assert known["backlash"] > reducer.backlash_rad / arcmin
    spring = reducer.stiffness_nm_rad[2] * arcmin
    assert known["stiffness"] == pytest.approx(spring, rel=0.15)
