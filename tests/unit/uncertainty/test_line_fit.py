"""Straight-line fits with covariance."""

import GTC
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.uncertainty import fit_line


@given(st.integers(0, 10_000), st.floats(-5, 5))
def test_agrees_with_gtc_line_fit(seed, reference):
    generator = np.random.default_rng(seed)
    x = generator.uniform(0, 10, 8)
    y = 1.0 + 0.3 * x + 0.05 * generator.standard_normal(8)
    line = fit_line(x, y, reference)
    theirs = GTC.type_a.line_fit((x - reference).tolist(), y.tolist())
    intercept, slope = theirs.a_b
    assert line.intercept == pytest.approx(GTC.value(intercept), rel=1e-7, abs=1e-9)
    assert line.slope == pytest.approx(GTC.value(slope), rel=1e-7, abs=1e-9)
    assert line.intercept_uncertainty == pytest.approx(GTC.uncertainty(intercept), rel=1e-6)
    assert line.slope_uncertainty == pytest.approx(GTC.uncertainty(slope), rel=1e-6)
    assert line.correlation == pytest.approx(GTC.get_correlation(intercept, slope), abs=1e-6)
    predicted = line.at(7.0)
    assert predicted.standard_uncertainty == pytest.approx(
        GTC.uncertainty(intercept + slope * (7.0 - reference)), rel=1e-6
    )


def test_large_offset_costs_no_digits():
    x = 1e9 + np.arange(5.0)
    line = fit_line(x, 2.0 * np.arange(5.0), reference=1e9)
    assert line.slope == pytest.approx(2.0, rel=1e-12)
    assert line.intercept == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        ([1, 2], [1, 2], "at least 3"),
        ([1, 2, 3], [1, 2], "equal length"),
        ([1, 1, 1], [1, 2, 3], "two different x"),
        ([1, 2, np.nan], [1, 2, 3], "not finite"),
    ],
)
def test_bad_input_is_named(x, y, message):
    with pytest.raises(InputError, match=message):
        fit_line(x, y)
