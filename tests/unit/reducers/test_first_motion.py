"""The start of motion is found before the threshold that tells it from elastic yielding."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from torquebench.reducers import evaluate_breakaway
from torquebench.reducers.breakaway import first_motion


@settings(max_examples=25, deadline=None)
@given(start=st.floats(0.5, 3.0), jerk=st.floats(0.01, 1.0), sign=st.sampled_from((1.0, -1.0)))
def test_an_inertia_under_a_rising_torque_started_before_it_passed_the_threshold(
    start: float, jerk: float, sign: float
) -> None:
    time = np.arange(0.0, 6.0, 0.002)
    angle = sign * jerk * np.maximum(time - start, 0.0) ** 3
    threshold = 1e-3
    late = start + np.cbrt(threshold / jerk)
    found = first_motion(time, angle, threshold_rad=threshold)
    assert found.direction == sign
    assert start - 0.01 <= found.time_s < late
    assert abs(found.time_s - start) <= 2.0 * found.standard_uncertainty_s


@settings(max_examples=25, deadline=None)
@given(creep=st.floats(1e-4, 1e-3), moves=st.floats(4.0, 8.0), noise=st.floats(1e-6, 1e-4))
def test_a_contact_that_creeps_under_the_ramp_does_not_move_yet(
    creep: float, moves: float, noise: float
) -> None:
    """Creep as fast as the torque is large passes any threshold long before it breaks away."""
    time = np.arange(0.0, moves + 1.0, 0.01)
    angle = creep * time**2 + 0.3 * np.maximum(time - moves, 0.0) ** 3
    angle += noise * np.random.default_rng(1).standard_normal(time.size)
    found = first_motion(time, angle, threshold_rad=5e-3)
    assert abs(found.time_s - moves) < 0.3


def test_motion_after_parts_have_settled_and_crept_is_found() -> None:
    """A straight line through settling and creep is as far off as the motion itself gets."""
    time = np.arange(0.0, 12.0, 0.01)
    settling = 0.044 * (1.0 - np.exp(-time / 0.4))
    angle = settling + 0.03 * (time / 9.6) ** 2 + 0.004 * np.maximum(time - 9.6, 0.0) ** 3
    assert 9.6 < first_motion(time, angle, threshold_rad=9e-3).time_s < 10.6


@settings(max_examples=40, deadline=None)
@given(creep=st.floats(1.5e-4, 5e-4), turns=st.floats(0.5, 2.0), brake=st.floats(-0.01, 0.01))
def test_creep_that_begins_the_other_way_does_not_hide_the_motion(
    creep: float, turns: float, brake: float
) -> None:
    """The brake's release strains the contacts; their recovery reverses the first creep."""
    time = np.arange(0.0, 11.0, 0.01)
    since = np.maximum(time - 0.3, 0.0)
    angle = brake * (time > 0.3) - creep * (since**2 - 2.0 * turns * since)
    angle -= 0.01 * np.maximum(time - 9.0, 0.0) ** 3
    found = first_motion(time, angle, threshold_rad=8.7e-3)
    assert found.direction == -1
    assert abs(found.time_s - 9.0) < 0.6


@settings(max_examples=40, deadline=None)
@given(
    creep=st.floats(2e-4, 1e-3),
    moves=st.floats(5.0, 12.0),
    back=st.floats(0.0, 0.5),
    rest=st.floats(0.3, 0.6),
)
def test_a_shaft_that_stops_or_swings_back_after_its_motion_moved(
    creep: float, moves: float, back: float, rest: float
) -> None:
    """The drive is stopped once the shaft turns; what it does then isn't its rest."""
    time = np.arange(0.0, moves + 0.9, 0.01)
    angle = creep * time**2 + 0.1 * np.maximum(time - moves, 0.0) ** 3
    expected = first_motion(time, angle, threshold_rad=8.7e-3)
    assert abs(expected.time_s - moves) < 0.5
    swing = np.linspace(0.0, np.pi / 2.0, int(100 * rest))[1:]
    after = angle[-1] - 0.07 * back * np.sin(swing) ** 2
    found = first_motion(
        np.concatenate((time, time[-1] + 0.01 * np.arange(1, swing.size + 1))),
        np.concatenate((angle, after)),
        threshold_rad=8.7e-3,
    )
    assert found == expected


def test_torque_that_stands_still_once_it_turns_is_read_there() -> None:
    """The inertia takes up what the drive adds: a late date costs little then."""
    time = np.arange(0.0, 9.0, 0.01)
    true = 0.02 * 7.0
    angle = 2e-4 * time**2 + 0.05 * np.maximum(time - 7.0, 0.0) ** 3
    torque = np.where(time < 7.0, 0.02 * time, true + 0.002 * (time - 7.0))
    found = evaluate_breakaway(time, angle, torque, presliding_rad=0.01)
    assert abs(found.runs[0].torque_nm / true - 1.0) < 0.02
