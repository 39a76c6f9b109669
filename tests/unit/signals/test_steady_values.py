import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage
from scipy.signal import lfilter

from torquebench.errors import InputError
from torquebench.signals import steady_value
from torquebench.signals.steady import (
    autocorrelation,
    correlation_length,
    estimate_period,
    isolated,
    median,
    outliers,
    running_median,
    settling_index,
)


def coloured(generator, count, coefficient):
    """First-order autoregressive noise with a standard deviation of 1."""
    white = generator.normal(size=count + 200) * np.sqrt(1 - coefficient**2)
    return lfilter([1.0], [1.0, -coefficient], white)[200:]


def step(
    generator,
    *,
    count=50,
    interval=0.01,
    settling=0.03,
    noise=0.05,
    coefficient=0.0,
    ripple=0.0,
    period=0.08,
    drift=0.0,
):
    """One step to 200 N·m as a rapid calibration takes it."""
    time = np.arange(count) * interval
    value = 200.0 - 40.0 * np.exp(-time / settling) + drift * (time - time[-1])
    for order, part in ((1, 1.0), (2, 0.3)):
        phase = generator.uniform(0, 2 * np.pi)
        value += part * ripple * np.sin(2 * np.pi * order * time / period + phase)
    return time, value + noise * coloured(generator, count, coefficient)


class TestHonesty:
    """The stated error against the actual one, over many steps."""

    @pytest.mark.parametrize(
        ("case", "count", "known", "least", "most"),
        [
            ({}, 50, False, 0.92, 1.0),
            ({"settling": 1e-4}, 30, False, 0.92, 1.0),
            ({"settling": 1e-4, "coefficient": 0.5}, 200, False, 0.88, 1.0),
            ({"ripple": 1.0}, 50, True, 0.92, 1.0),
            ({"ripple": 1.0, "period": 0.13}, 60, True, 0.92, 1.0),
            (
                {"ripple": 1.0, "interval": 0.001, "period": 0.013, "settling": 0.01},
                400,
                False,
                0.88,
                1.0,
            ),
        ],
    )
    def test_twice_the_standard_error_covers(self, case, count, known, least, most):
        generator = np.random.default_rng(7)
        inside, error, stated = [], [], []
        for _ in range(150):
            time, value = step(generator, count=count, **case)
            period = case.get("period", 0.08) if known else None
            steady = steady_value(time, value, period_s=period)
            if steady.settled:
                error.append(steady.value - 200.0)
                stated.append(steady.standard_error)
                inside.append(abs(error[-1]) < 2 * stated[-1])
        assert len(inside) > 120
        assert least <= np.mean(inside) <= most
        # and not by being wide
        assert np.median(stated) < 1.6 * np.std(error)

    def test_correlated_noise_is_worth_fewer_samples(self):
        generator = np.random.default_rng(3)
        for coefficient in (0.0, 0.5, 0.8):
            length = [correlation_length(coloured(generator, 400, coefficient)) for _ in range(40)]
            assert np.median(length) == pytest.approx(
                (1 + coefficient) / (1 - coefficient), rel=0.2
            )

    def test_autocorrelation_of_nothing(self):
        assert autocorrelation(np.zeros(8), 3).tolist() == [1.0, 0.0, 0.0, 0.0]


class TestSettling:
    def test_the_transient_is_left_out(self):
        time, value = step(np.random.default_rng(1), noise=0.02)
        steady = steady_value(time, value)
        assert steady.settled
        assert steady.start_s > 0.1
        assert steady.value == pytest.approx(200.0, abs=0.02)

    def test_a_settled_record_is_used_almost_whole(self):
        generator = np.random.default_rng(2)
        used = [steady_value(*step(generator, settling=1e-4)).samples for _ in range(30)]
        assert np.median(used) >= 40

    def test_a_step_that_goes_on_creeping_is_marked(self):
        generator = np.random.default_rng(3)
        settled = [steady_value(*step(generator, settling=0.3)).settled for _ in range(20)]
        assert not any(settled)

    def test_drift_is_marked_with_its_size(self):
        steady = steady_value(*step(np.random.default_rng(4), settling=1e-4, drift=2.0))
        assert not steady.settled
        assert steady.drift_per_s == pytest.approx(2.0, abs=4 * steady.drift_standard_error_per_s)
        assert abs(steady.drift_per_s) > steady.drift_standard_error_per_s

    def test_a_drift_within_the_tolerance_does_not_matter(self):
        time, value = step(np.random.default_rng(4), settling=1e-4, drift=2.0)
        assert steady_value(time, value, tolerance=1.5).settled

    def test_most_settled_steps_count(self):
        generator = np.random.default_rng(5)
        settled = [steady_value(*step(generator)).settled for _ in range(100)]
        assert np.mean(settled) > 0.85

    def test_the_rule_finds_the_end_of_a_transient(self):
        generator = np.random.default_rng(6)
        value = np.concatenate((np.linspace(0, 10, 20), np.full(80, 10.0)))
        assert settling_index(value + generator.normal(0, 0.1, 100)) == pytest.approx(20, abs=3)


class TestRipple:
    def test_a_known_period_leaves_no_leakage(self):
        # 5.3 periods in the record: the plain mean would be off by a tenth of the amplitude
        time = np.arange(100) * 0.01
        value = 50.0 + 3.0 * np.sin(2 * np.pi * time / 0.187 + 0.4)
        steady = steady_value(time, value, period_s=0.187)
        assert steady.value == pytest.approx(50.0, abs=1e-9)
        assert steady.ripple == pytest.approx(3.0, abs=1e-6)
        assert steady.period_s == 0.187
        periods = (steady.stop_s - steady.start_s + 0.01) / 0.187
        assert periods == pytest.approx(round(periods), abs=0.06)

    def test_an_unknown_period_is_found(self):
        generator = np.random.default_rng(8)
        time, value = step(generator, count=300, settling=1e-4, ripple=0.5, period=0.07)
        steady = steady_value(time, value)
        assert steady.period_s == pytest.approx(0.07, rel=0.01)
        assert steady.value == pytest.approx(200.0, abs=0.02)

    def test_a_window_shorter_than_a_known_period_never_counts(self):
        time, value = step(np.random.default_rng(9), settling=1e-4, ripple=1.0, period=2.0)
        assert not steady_value(time, value, period_s=2.0).settled

    @pytest.mark.parametrize("coefficient", [0.0, 0.6])
    def test_noise_is_rarely_taken_for_a_ripple(self, coefficient):
        generator = np.random.default_rng(10)
        time = np.arange(100) * 0.01
        found = [
            estimate_period(time, coloured(generator, 100, coefficient)) is not None
            for _ in range(200)
        ]
        assert np.mean(found) < 0.04

    def test_too_short_a_record_shows_no_period(self):
        assert estimate_period(np.arange(8.0), np.ones(8)) is None


class TestOutliers:
    @given(
        place=st.integers(0, 49),
        size=st.sampled_from([-8_388_608.0, 1e4, -500.0, 20.0]),
        seed=st.integers(0, 1000),
    )
    def test_a_single_one_anywhere_does_no_harm(self, place, size, seed):
        noise = 0.05
        time, value = step(np.random.default_rng(seed), settling=1e-4, noise=noise)
        value[place] += size
        steady = steady_value(time, value)
        assert abs(steady.value - 200.0) < noise
        assert steady.standard_error < noise

    def test_it_is_counted(self):
        time, value = step(np.random.default_rng(1), settling=1e-4)
        value[[20, 35]] = -8_388_608.0
        assert steady_value(time, value).rejected == 2

    def test_clean_noise_has_none(self):
        generator = np.random.default_rng(2)
        assert np.mean(outliers(generator.normal(size=20_000))) < 1e-4

    def test_a_step_and_a_ripple_are_no_outliers(self):
        time = np.arange(200) * 0.01
        assert not outliers(np.where(time > 1.0, 10.0, 0.0)).any()
        assert not outliers(np.sin(2 * np.pi * time / 0.11)).any()

    def test_coarse_resolution_is_no_outlier(self):
        generator = np.random.default_rng(3)
        assert not outliers(np.round(generator.normal(0, 0.2, 500))).any()

    def test_too_many_are_no_single_values(self):
        time, value = step(np.random.default_rng(4), settling=1e-4)
        value[::5] += 50.0
        assert not steady_value(time, value).settled

    def test_few_samples_have_none(self):
        assert not outliers([1.0, 100.0, 1.0]).any()


class TestEdges:
    def test_a_constant_record_is_settled_with_no_error(self):
        steady = steady_value(np.arange(20) * 0.1, np.full(20, 7.25))
        assert (steady.value, steady.settled) == (pytest.approx(7.25, rel=1e-14), True)
        assert steady.standard_error < 1e-12

    def test_a_straight_line_is_not(self):
        assert not steady_value(np.arange(50.0), np.arange(50.0)).settled

    @given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e3))
    def test_offset_and_scale_go_through(self, offset, scale):
        time, value = step(np.random.default_rng(11))
        plain = steady_value(time, value)
        moved = steady_value(time, offset + scale * (value - 200.0))
        assert moved.value == pytest.approx(
            offset + scale * (plain.value - 200.0), abs=0.02 * scale + 1e-8 * abs(offset)
        )

    @pytest.mark.parametrize(
        ("time", "value", "options", "message"),
        [
            (np.arange(5.0), np.ones(5), {}, "5 samples"),
            (np.arange(10.0), np.ones(9), {}, "two equal rows"),
            (np.zeros(10), np.ones(10), {}, "increasing"),
            (np.arange(10.0), np.full(10, np.nan), {}, "sample 0 is nan"),
            (np.arange(10.0), np.ones(10), {"period_s": 0.0}, "period"),
            (np.arange(10.0), np.ones(10), {"settling_limit": 1.0}, "settling_limit"),
        ],
    )
    def test_what_cannot_be_a_step_is_refused(self, time, value, options, message):
        with pytest.raises(InputError, match=message):
            steady_value(time, value, **options)


@given(st.integers(2, 60), st.integers(0, 3), st.integers(0, 2**32 - 1), st.data())
def test_running_median_and_runs_are_those_of_scipy(
    count: int, digits: int, seed: int, data: st.DataObject
) -> None:
    size = data.draw(st.integers(1, min(count, 18)))
    values = np.random.default_rng(seed).normal(size=count).round(digits)
    expected = ndimage.median_filter(values, size=size, mode="mirror")
    np.testing.assert_array_equal(running_median(values, size), expected)
    far = values > 0.0
    runs, _ = ndimage.label(far)
    np.testing.assert_array_equal(isolated(far), far & (np.bincount(runs)[runs] <= 2))
    assert median(values) == np.median(values)


@given(st.integers(4, 60), st.integers(0, 2**32 - 1))
def test_the_settled_part_is_where_whites_statistic_is_least(count: int, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=count).cumsum()
    rest = [values[first:] for first in range(count // 2 + 1)]
    statistic = [part.var() / part.size for part in rest]
    assert statistic[settling_index(values)] <= min(statistic) * (1.0 + 1e-9)
