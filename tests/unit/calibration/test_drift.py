from datetime import UTC, date, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from torquebench.calibration.drift import (
    DriftPrediction,
    find_trend,
    individuals_chart,
    predict_drift,
    propose_due_date,
)
from torquebench.errors import InputError

START = datetime(2020, 1, 1, tzinfo=UTC)
# Montgomery, Introduction to Statistical Quality Control, example 6.5 (loan processing cost):
# x̄ = 300.5, MR̄ = 7.79, limits 279.78 and 321.22, upper limit of the moving range 25.45.
COSTS = [310, 288, 297, 298, 307, 303, 294, 297, 308, 306]
COSTS += [294, 299, 297, 299, 314, 295, 293, 306, 301, 304]


def years(count, step=1.0):
    return [START + timedelta(days=365.25 * step * number) for number in range(count)]


def test_the_chart_agrees_with_the_textbook():
    chart = individuals_chart(COSTS)
    assert chart.centre == pytest.approx(300.5)
    assert chart.moving_range_mean == pytest.approx(7.79, abs=0.005)
    assert chart.lower == pytest.approx(279.78, abs=0.01)
    assert chart.upper == pytest.approx(321.22, abs=0.01)
    assert chart.moving_range_upper == pytest.approx(25.45, abs=0.01)
    assert chart.in_control


def test_the_factors_are_those_of_moving_ranges_of_two():
    d2 = 2.0 / np.sqrt(np.pi)  # mean range of two standard normal values
    d3 = np.sqrt(2.0 - 4.0 / np.pi)  # and its standard deviation
    chart = individuals_chart([0.0, 1.0, 0.0])
    assert chart.upper - chart.centre == pytest.approx(3.0 / d2, rel=5e-4)
    assert chart.moving_range_upper == pytest.approx(1.0 + 3.0 * d3 / d2, rel=5e-4)


def test_a_value_outside_a_jump_and_a_run_are_told_apart():
    assert individuals_chart([*COSTS, 340.0], base=20).outside == (20,)
    assert individuals_chart([*COSTS, 330.0], base=20).jumps == (20,)
    shifted = individuals_chart([*COSTS, *[304.0, 305.0] * 4], base=20)
    assert shifted.outside == ()
    assert shifted.runs[-1] == 27
    assert not shifted.in_control


@given(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=30), st.floats(-1e3, 1e3))
def test_a_chart_moves_with_its_values(values, offset):
    chart, moved = individuals_chart(values), individuals_chart(np.add(values, offset))
    assert moved.centre == pytest.approx(chart.centre + offset, abs=1e-6)
    assert moved.upper - moved.lower == pytest.approx(chart.upper - chart.lower, abs=1e-6)


@pytest.mark.parametrize(("values", "base"), [([1.0, 2.0], None), ([1.0] * 5, 2), ([1.0] * 5, 6)])
def test_too_few_values_give_no_chart(values, base):
    with pytest.raises(InputError, match="control chart"):
        individuals_chart(values, base)


def test_values_that_are_no_numbers_are_refused():
    with pytest.raises(InputError, match="finite"):
        individuals_chart([1.0, np.nan, 2.0])


def test_the_trend_test_is_mann_kendalls():
    values = [0.01, 0.03, 0.02, 0.05, 0.04, 0.08]
    trend = find_trend(years(6), values)
    # S = 15 pairs - 2 × 2 inversions = 11; τ = 11/15. Exact two-sided p from all 720 orders.
    assert trend.tau == pytest.approx(11 / 15)
    assert trend.p_value == pytest.approx(2 * (1 + 5 + 14) / 720)
    assert trend.significant == (trend.p_value < 0.05)
    assert trend.per_year == pytest.approx(stats.linregress(np.arange(6), values).slope)


def test_a_trend_is_rarely_seen_in_noise_and_always_in_drift():
    rng = np.random.default_rng(7)
    noise = [find_trend(years(10), rng.normal(size=10)).significant for _ in range(400)]
    assert 0.01 < np.mean(noise) < 0.09
    drift = rng.normal(size=(50, 10)) + 1.0 * np.arange(10)
    assert all(find_trend(years(10), values).significant for values in drift)


def test_equal_values_and_short_histories_have_no_trend():
    assert not find_trend(years(5), [0.1] * 5).significant
    assert find_trend(years(3), [0.1, 0.2, 0.3]) is None
    assert find_trend([START] * 5, [0.1, 0.2, 0.3, 0.1, 0.2]) is None


def test_the_prediction_interval_is_that_of_a_further_value():
    x, y = np.arange(6.0), np.array([0.0, 0.012, 0.018, 0.033, 0.038, 0.052])
    found = predict_drift(years(6), y, 0.1)
    line = stats.linregress(x, y)
    rest = y - line.intercept - line.slope * x
    s = np.sqrt(np.sum(rest**2) / 4)

    def edge(t, sign):
        reach = stats.t.ppf(0.975, 4) * s
        reach *= np.sqrt(1 + 1 / 6 + (t - x.mean()) ** 2 / np.sum((x - x.mean()) ** 2))
        return line.intercept + line.slope * t + sign * reach

    def year_of(moment):
        return (moment - START).total_seconds() / 86400 / 365.25

    assert line.intercept + line.slope * year_of(found.expected) == pytest.approx(0.1, abs=1e-4)
    assert edge(year_of(found.earliest), 1) == pytest.approx(0.1, abs=1e-4)
    assert edge(year_of(found.latest), -1) == pytest.approx(0.1, abs=1e-4)
    assert found.earliest < found.expected < found.latest
    assert found.per_year == pytest.approx(line.slope)


def test_the_interval_holds_the_next_value_as_often_as_it_says():
    rng = np.random.default_rng(3)
    inside = 0
    for _ in range(400):
        y = 0.01 * np.arange(9) + 0.004 * rng.normal(size=9)
        found = predict_drift(years(8), y[:8], 0.08, horizon_years=1.0)
        line = stats.linregress(np.arange(8), y[:8])
        crossed = found.earliest is not None and found.earliest <= years(9)[8]
        inside += not (abs(y[8]) >= 0.08 and not crossed)
        assert np.isfinite(line.slope)
    assert inside / 400 > 0.95


def test_what_does_not_drift_never_leaves_its_tolerance():
    found = predict_drift(years(6), [0.001, -0.001, 0.0005, -0.0005, 0.001, -0.001], 0.1)
    assert found.expected is None
    assert found.horizon - years(6)[-1] == timedelta(days=3652.5)


def test_predictions_need_a_history_and_a_tolerance():
    with pytest.raises(InputError, match="a prediction from 2 moments"):
        predict_drift(years(2), [0.0, 0.1], 0.1)
    with pytest.raises(InputError, match="tolerance"):
        predict_drift(years(4), [0.0, 0.1, 0.2, 0.3], 0.0)


def test_the_due_date_comes_before_the_tolerance_is_left():
    last = datetime(2025, 1, 31, tzinfo=UTC)

    def prediction(earliest):
        return DriftPrediction(earliest, None, None, 0.01, 0.95, last + timedelta(days=3650))

    soon = last + timedelta(days=90)
    assert propose_due_date(last, prediction(soon)) == soon.date()
    assert propose_due_date(last, prediction(None)) == date(2026, 1, 31)
    assert propose_due_date(last, prediction(last - timedelta(days=5))) == last.date()
    assert propose_due_date(last, None, longest_days=730) == date(2027, 1, 31)
