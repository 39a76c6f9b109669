"""Loops of a hysteresis with memory whose torque ripples: what a ripple hides comes out again."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torquebench.reducers import LoopSettings, evaluate_hysteresis
from torquebench.reducers.loops.branches import Recording
from torquebench.reducers.loops.ripple import find_ripple, outermost, without_ripple

RATED = 400.0
STIFFNESS = 4e5
STOPS = ((4e-6, 1e6), (4e-5, 8e4))  # half width rad, stiffness N·m/rad


def torque_of(angle):
    """Torque of a spring with stops, which remember, along a path of angles."""
    torque, values = STIFFNESS * angle, np.zeros(len(STOPS))
    change = np.diff(angle, prepend=angle[0])
    inner = np.empty_like(angle)
    for row, step in enumerate(change):
        inner[row] = 0.0
        for k, (width, stiffness) in enumerate(STOPS):
            values[k] = min(width, max(-width, values[k] + step))
            inner[row] += stiffness * values[k]
    return torque + inner


def loops(ripple_rad, *, period=12.3, samples=4000, noise=0.0, seed=1):
    """Preload, then two loops; the angle ripples while it is driven."""
    reach = (RATED + 1.0) / STIFFNESS
    half = np.linspace(-reach, reach, samples)
    angle = np.concatenate([np.linspace(0, -reach, samples // 2), *([half, half[::-1]] * 2)])
    angle = angle + ripple_rad * np.sin(2 * np.pi * np.arange(angle.size) / period)
    torque = torque_of(angle)[samples // 2 :]
    angle = angle[samples // 2 :]
    generator = np.random.default_rng(seed)
    return torque + noise * generator.standard_normal(torque.size), angle


def found(torque, angle):
    result = evaluate_hysteresis(torque, angle, LoopSettings(RATED, stiffness_interval=(0.5, 0.9)))
    return result, {each.key: each.estimate.value for each in result.quantities()}


@pytest.mark.parametrize(("ripple", "period"), [(2e-6, 12.3), (6e-6, 8.1), (3e-6, 25.0)])
def test_loops_under_a_ripple_give_what_steady_ones_do(ripple, period):
    _, steady = found(*loops(0.0))
    plain = loops(ripple, period=period)
    result, values = found(*plain)
    for key in ("backlash", "hysteresis_loss", "stiffness"):
        assert values[key] == pytest.approx(steady[key], rel=0.03), key
    (finding,) = [each for each in result.findings if each.name == "torque ripple"]
    said = float(finding.message.split(" with ")[1].split()[0])
    assert said == pytest.approx(period, rel=0.02)
    lines = {line.name for line in result.energy.lines}
    assert "torque ripple" in lines


def test_without_its_outermost_samples_the_loop_is_narrower():
    torque, angle = loops(3e-6)
    _, steady = found(*loops(0.0))
    width = 11
    mean = [np.convolve(each, np.full(width, 1 / width), mode="valid") for each in (torque, angle)]
    _, averaged = found(*mean)
    assert averaged["backlash"] < 0.9 * steady["backlash"]


@settings(max_examples=10, deadline=None)
@given(amplitude=st.floats(1e-6, 8e-6), seed=st.integers(0, 1000))
def test_outermost_samples_lie_on_the_steady_branch(amplitude, seed):
    """Whatever the ripple: return-point memory."""
    torque, angle = loops(amplitude, period=8.0 + seed % 17, samples=2000)
    ripple = find_ripple(torque, angle)
    assert ripple is not None
    kept, at, rows = outermost(torque, angle, type(ripple)(1.0, ripple.amplitude_nm))
    rising = (rows > 100) & (rows < 1900)
    steady = torque_of(np.concatenate([[0.0, -1.1e-3], np.sort(at[rising])]))[2:]
    np.testing.assert_allclose(np.sort(kept[rising]), steady, atol=1e-6 * RATED)


@pytest.mark.parametrize("noise", [0.0, 0.5, 3.0])
def test_noise_and_steps_are_no_ripple(noise):
    torque, angle = loops(0.0, noise=noise)
    nothing = np.zeros(torque.size)
    record = Recording(torque, angle, nothing, nothing)
    same, ripple = without_ripple(record)
    assert ripple is None
    assert same is record
    level = np.round(torque / 20.0) * 20.0
    assert find_ripple(level + noise * 0.1, angle) is None


def test_a_ripple_that_too_few_samples_show_is_said_and_counted():
    torque, angle = loops(3e-6, period=4.3)
    result, _ = found(torque, angle)
    (finding,) = [each for each in result.findings if each.name == "torque ripple"]
    assert "sample faster" in finding.remedy
    resolved, _ = found(*loops(3e-6))
    share = [
        next(line for line in each.energy.lines if line.name == "torque ripple").contribution
        for each in (result, resolved)
    ]
    assert share[0] > 2.0 * share[1]
