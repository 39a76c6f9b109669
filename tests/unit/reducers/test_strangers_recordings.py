"""Recordings with one kind of fault each against a known truth that the evaluation never sees."""

import numpy as np
import pytest
from benchmarks import evaluations
from benchmarks.evaluations import measured
from tests.support.draws import nightly

INPUTS = 60

KINDS = [
    (evaluations.hysteresis, "coarse encoder"),
    (evaluations.hysteresis, "drift"),
    (evaluations.hysteresis, "one bad angle"),
    (evaluations.hysteresis, "one loop, drift"),
    (evaluations.hysteresis, "levels of torque"),
    (evaluations.hysteresis, "one loop"),
    (evaluations.hysteresis, "single cycle"),
    (evaluations.breakaway, "drop of 25 %"),
    (evaluations.breakaway, "staircase of 8"),
    (evaluations.breakaway, "one bad torque"),
    (evaluations.no_load, "one bad point"),
    (evaluations.no_load, "log, offset"),
    (evaluations.no_load, "ramp"),
    (evaluations.efficiency, "one bad point"),
    (evaluations.efficiency, "coarse torque"),
    (evaluations.efficiency, "log"),
    (evaluations.transmission_error, "strong order 1, one turn"),
    (evaluations.transmission_error, "wrapped, one bad sample"),
    (evaluations.swings, "coarse encoder"),
    (evaluations.swings, "strong error"),
    (evaluations.swings, "short strokes"),
    (evaluations.swings, "one bad sample"),
]


BY_DAY = KINDS[:1]


@pytest.mark.parametrize(
    ("test", "kind"), [*BY_DAY, *(nightly(*each) for each in KINDS if each not in BY_DAY)]
)
def test_intervals_contain_the_truth_whatever_the_fault(test, kind):
    lines, refused = measured(test, kind, INPUTS)
    assert refused == []
    for line in lines:
        assert np.all(line.expanded > 0.0), line.quantity
        assert not line.improbable(INPUTS), (line.quantity, line.coverage)
    if test is evaluations.breakaway and "staircase" not in kind:
        assert abs(np.mean(lines[0].errors)) < 0.01


def test_points_without_repeats_have_no_u():
    (line,), refused = measured(evaluations.efficiency, "no repeats", INPUTS)
    assert refused == []
    assert np.all(np.isinf(line.expanded))
    assert np.isnan(line.coverage)
