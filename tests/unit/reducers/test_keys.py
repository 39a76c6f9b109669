"""Whatever the points of a recording are: no two values of a result have one key."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import recordings

from torquebench.errors import InputError
from torquebench.reducers import (
    LoopSettings,
    evaluate_breakaway,
    evaluate_efficiency,
    evaluate_friction,
    evaluate_hysteresis,
    evaluate_no_load,
    evaluate_swings,
    evaluate_transmission_error,
)

sizes = st.one_of(
    st.floats(0.5, 5000.0),
    st.sampled_from([1.0, 1.0004, 1.0000001, 999.5, 1000.0, 1000.4, 1e-3, 1.5e-3, 4999.9999]),
)
SPEEDS = st.tuples(sizes, st.sampled_from([1.0, -1.0])).map(lambda pair: pair[0] * pair[1])


def assert_distinct(result):
    keys = [each.key for each in result.quantities()]
    assert len(set(keys)) == len(keys), keys


def evaluated(evaluate, *columns, **more):
    """Evaluate what may be refused; whatever isn't has keys of its own."""
    try:
        result = evaluate(*columns, **more)
    except InputError:
        return None
    assert_distinct(result)
    return result


@given(st.lists(st.tuples(SPEEDS, sizes), min_size=1, max_size=12), st.booleans())
@settings(deadline=None)
def test_running_torques(points, demanded):
    speed, torque = np.array(points).T
    torque = np.copysign(torque, speed)
    nominal = speed if demanded else None
    found = evaluated(
        evaluate_no_load, speed, torque, nominal_rpm=nominal, zeroed=True, keep_outliers=True
    )
    if found is not None and demanded:
        assert len(found.points) == len(set(speed.tolist()))
    evaluated(evaluate_friction, speed, torque)


@given(st.lists(st.tuples(SPEEDS, sizes, st.floats(0.3, 0.99)), min_size=1, max_size=12))
@settings(deadline=None)
def test_efficiencies(points):
    speed, load, share = np.array(points).T
    load = np.copysign(load, speed)
    drive = load / 10.0 / share
    found = evaluated(
        evaluate_efficiency,
        drive,
        load,
        speed,
        10.0,
        nominal_torque_nm=load,
        nominal_speed_rpm=speed,
        keep_outliers=True,
    )
    if found is not None:
        whole = set(zip(load.tolist(), speed.tolist(), strict=True))
        assert len(found.points) == len(whole)
    evaluated(evaluate_efficiency, drive, load, speed, 10.0)


@pytest.mark.parametrize("seed", range(3))
def test_all_other_tests(seed):
    rng = np.random.default_rng(seed)
    loop = recordings.loop("lens", rng)
    record = recordings.loop_record(loop, rng)
    regions = LoopSettings(loop.rated, region_torques_nm=(0.1 * loop.rated, 0.4 * loop.rated))
    assert_distinct(evaluate_hysteresis(record.torque, record.angle / 3437.75, regions))
    ramp = recordings.ramp_record(rng, runs=6, both=True)
    found = evaluate_breakaway(
        ramp.time, ramp.angle / 3437.75, ramp.torque, run=ramp.run, position=ramp.run % 2
    )
    assert_distinct(found)
    # Orders nearer than any decimals of a ratio: 1, the ratio's multiples and those beside them.
    turns = recordings.angle_record(rng, ratio=10.0 + 1e-4 * seed)
    given_rad, taken_rad = np.radians(turns.driving), np.radians(turns.driven)
    assert_distinct(evaluate_transmission_error(given_rad, taken_rad, turns.ratio))
    swing = recordings.swing_record(rng)
    strokes = np.radians(swing.driving), np.radians(swing.driven)
    assert_distinct(evaluate_swings(*strokes, swing.ratio))
