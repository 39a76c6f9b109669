"""Closed forms of torsion against Timoshenko's table and against the series summed directly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.mechanics import (
    equal_area_twist_ratio,
    hollow_circle_gain,
    polar_moment,
    rectangle_torsion_constant,
    rectangle_torsion_factor,
)

# Timoshenko's table: a/b, β_s, twist by that of a circle of the same area; rounded as printed.
TABLE = [
    (1.0, 0.1406, 1.132),
    (1.5, 0.1958, 1.220),
    (2.0, 0.2287, 1.392),
    (3.0, 0.2633, 1.813),
    (5.0, 0.2913, 2.732),
    (10.0, 0.3123, 5.096),
    (20.0, 0.3228, 9.860),
]


@pytest.mark.parametrize(("ratio", "factor", "twist"), TABLE)
def test_closed_form_reproduces_the_table(ratio, factor, twist):
    assert float(rectangle_torsion_factor(ratio)) == pytest.approx(factor, abs=0.51e-4)
    assert float(equal_area_twist_ratio(ratio)) == pytest.approx(twist, abs=0.51e-3)


def test_the_sum_is_exact():
    n = np.arange(1, 20001, 2, dtype=np.float64)
    for ratio in (1.0, 1.3, 7.0):
        series = np.sum(np.tanh(n * np.pi * ratio / 2) / n**5)
        direct = (1 - 192 / (np.pi**5 * ratio) * series) / 3
        assert float(rectangle_torsion_factor(ratio)) == pytest.approx(direct, rel=1e-13)
    assert float(rectangle_torsion_factor(1e9)) == pytest.approx(1 / 3, rel=1e-8)


@given(ratio=st.floats(1.0, 100.0))
def test_twist_of_equal_area_is_the_ratio_of_both_constants(ratio):
    side = np.sqrt(ratio)
    rectangular = rectangle_torsion_constant(side, 1.0 / side)
    circular = polar_moment(2.0 / np.sqrt(np.pi))
    assert float(circular / rectangular) == pytest.approx(float(equal_area_twist_ratio(ratio)))
    assert float(equal_area_twist_ratio(ratio)) > 1.0


@given(ratio=st.floats(0.0, 0.99))
def test_the_gain_of_a_hollow_circle_is_the_ratio_of_both_moments(ratio):
    gain = polar_moment(1.0, ratio) / polar_moment(np.sqrt(1.0 - ratio**2))
    assert float(gain) == pytest.approx(float(hollow_circle_gain(ratio)), rel=1e-9)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: rectangle_torsion_factor(0.5), "a/b >= 1"),
        (lambda: rectangle_torsion_constant(1.0, -1.0), "above 0"),
        (lambda: hollow_circle_gain(1.0), "0 <= d/D < 1"),
        (lambda: polar_moment(1.0, 1.0), "inner diameter < outer diameter"),
    ],
)
def test_impossible_sections_are_refused(build, message):
    with pytest.raises(InputError, match=message):
        build()
