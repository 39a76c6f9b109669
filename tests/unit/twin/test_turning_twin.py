"""A twin with a turning shaft or a reducer: friction, torsion, efficiency, drag, commands."""

import numpy as np
import pytest
from tests.unit.twin.drawn_bench import NOMINAL, RANGE, RPM, driven, make

from torquebench.twin import BenchTwin, TwinParameters
from torquebench.twin.mechanism import FLANGE_SPEED, MOTOR_SPEED, SHAFT_TORQUE


def test_no_load_running_torque_is_the_reducers_friction():
    twin = driven(make(mounting="reducer"), "input")
    reducer = NOMINAL.reducer
    for rpm in (300.0, 1200.0, -600.0):
        twin.command_speed("input", rpm * RPM)
        twin.advance(2.0)
        block = twin.advance(1.0)
        speed = np.mean(block.truth.speed_rad_s["input"])
        assert speed == pytest.approx(rpm * RPM, rel=1e-3)
        speed_at_output = abs(speed) / reducer.ratio
        viscous = reducer.viscous_nm_s * abs(speed)
        output = reducer.output_drag_nm + reducer.output_viscous_nm_s * speed_at_output
        expected = reducer.coulomb_nm + viscous + output / reducer.ratio
        torque = np.mean(block.truth.torque_nm["input"]) * np.sign(rpm)
        assert torque == pytest.approx(expected, rel=0.03)
        assert np.mean(block.truth.torque_nm["output"]) == pytest.approx(0.0, abs=0.5)
        turns = np.mean(block.truth.speed_rad_s["output"]) * reducer.ratio
        assert turns == pytest.approx(speed, rel=2e-3)


def test_input_locked_and_output_loaded_is_the_torsion_loop():
    twin = driven(make(mounting="reducer"), "output")
    twin.set_mode("input", "locked")
    rated = 0.9 * RANGE["output"]

    def hold(share):
        twin.command_torque("output", share * rated)
        twin.advance(0.4)
        block = twin.advance(0.1)
        truth = block.truth
        return (
            np.mean(truth.torque_nm["output"]),
            np.mean(truth.angle_rad["output"]),
            np.mean(truth.torque_nm["input"]),
        )

    for share in (1.0, -1.0):
        hold(share)
    rising = np.array([hold(share) for share in np.linspace(-1, 1, 9)])
    falling = np.array([hold(share) for share in np.linspace(1, -1, 9)])
    stiffness = (rising[-1, 0] - rising[-3, 0]) / (rising[-1, 1] - rising[-3, 1])
    assert stiffness == pytest.approx(NOMINAL.reducer.stiffness_nm_rad[2], rel=0.1)
    width = falling[4, 1] - rising[4, 1]
    assert 0.0 < width < np.pi / 180 / 60
    # the locked input holds the reaction, less what friction holds
    reaction = -rising[:, 2] * NOMINAL.reducer.ratio
    assert np.all(np.abs(reaction - rising[:, 0]) < 0.15 * rated + 40.0)


def test_efficiency_rises_with_load_and_stays_below_one():
    twin = driven(make(mounting="reducer"))
    ratio = NOMINAL.reducer.ratio
    twin.command_speed("input", 300.0 * RPM)
    twin.advance(2.0)
    efficiencies = []
    for share in (0.1, 0.5, 1.0):
        twin.command_torque("output", -share * 2000.0)
        twin.advance(1.5)
        torque = twin.advance(1.0).truth.torque_nm
        efficiencies.append(-np.mean(torque["output"]) / (ratio * np.mean(torque["input"])))
    assert efficiencies == sorted(efficiencies)
    assert efficiencies[0] > 0.5
    assert 0.8 < efficiencies[-1] < 0.95


def test_a_shaft_that_turns_alone_drags_by_its_bearings_as_with_something_mounted() -> None:
    twin = BenchTwin(NOMINAL, 1, active_channels=())
    driven(twin, "input")
    chain = NOMINAL.input.chain
    for speed in (60.0, -60.0):
        twin.command_speed("input", speed)
        twin.advance(2.0)
        twin.advance(2.0)
        shaft = twin._state.shafts[0]
        assert shaft[MOTOR_SPEED] == pytest.approx(speed, rel=0.01)
    samples = []
    for _ in range(400):
        twin.advance(0.005)
        samples.append(twin._state.shafts[0, SHAFT_TORQUE])
    drag = chain.drag_nm + chain.drag_viscous_nm_s * 60.0
    step = chain.constant_nm[1] / (chain.reversal_width * chain.range_nm)
    assert np.mean(samples) == pytest.approx(-drag / (1.0 + step), abs=0.3 * drag)
    twin.set_mode("input", "free")
    twin.advance(10.0)
    assert abs(twin._state.shafts[0, FLANGE_SPEED]) < 0.1


def test_commands_during_a_block_are_those_between_shorter_blocks():
    """One block with a schedule gives the edges and counts of as many short ones."""

    def loaded():
        twin = BenchTwin(TwinParameters.draw("nominal", 6), seed=3)
        twin.mount("reducer")
        twin.set_clamped(True)
        twin.set_mode("input", "locked")
        twin.set_mode("output", "driven")
        twin.enable("output", True)
        return twin

    twin, levels = loaded(), list(np.linspace(1.0, 20.0, 20))
    short = []
    for level in levels:
        twin.command_torque("output", float(level))
        short.append(twin.advance(0.01))
    twin, left, asked = loaded(), list(levels), []

    def drive(remaining_s):
        asked.append(remaining_s)
        twin.command_torque("output", float(left.pop(0)))
        return 0.01

    long = twin.advance(0.2, drive)
    assert asked == pytest.approx(np.arange(20, 0, -1) * 0.01)
    for name, edges in long.edges.items():
        np.testing.assert_array_equal(edges, np.concatenate([each.edges[name] for each in short]))
    for side, samples in long.angles.items():
        counts = np.concatenate([each.angles[side].counts for each in short])
        np.testing.assert_array_equal(samples.counts, counts)
