import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.signals.allan import allan_deviation
from torquebench.signals.filters import LiveFilter, zero_phase
from torquebench.signals.orders import (
    AngleRecord,
    fit_ripple,
    order_spectrum,
    resample_in_angle,
)

RATE = 1000.0
TIME = np.arange(4000) / RATE


def amplitude(value, frequency):
    """Amplitude and phase of one frequency in the middle of a record."""
    middle = slice(1000, 3000)
    wave = np.exp(-2j * np.pi * frequency * TIME[middle])
    return 2 * np.mean(value[middle] * wave)


class TestZeroPhase:
    @pytest.mark.parametrize("order", [1, 2, 4])
    @pytest.mark.parametrize("cutoff", [20.0, 200.0])
    def test_minus_3_db_at_the_cut_off_and_no_phase(self, order, cutoff):
        response = amplitude(
            zero_phase(np.cos(2 * np.pi * cutoff * TIME), RATE, cutoff, order), cutoff
        )
        assert abs(response) == pytest.approx(np.sqrt(0.5), rel=2e-3)
        assert abs(np.angle(response)) < 2e-3

    def test_a_constant_stays(self):
        np.testing.assert_allclose(zero_phase(np.full(50, 3.25), RATE, 30.0), 3.25)

    @pytest.mark.parametrize(
        ("value", "cutoff", "order", "message"),
        [
            (np.zeros(100), 500.0, 4, "cut-off"),
            (np.zeros(100), 0.0, 4, "cut-off"),
            (np.zeros(100), 10.0, 0, "order"),
            (np.zeros(5), 10.0, 4, "5 samples"),
            (np.full(100, np.nan), 10.0, 4, "finite"),
        ],
    )
    def test_what_cannot_be_filtered_is_refused(self, value, cutoff, order, message):
        with pytest.raises(InputError, match=message):
            zero_phase(value, RATE, cutoff, order)


class TestLiveFilter:
    @pytest.mark.parametrize("frequency", [2.0, 11.0, 35.0])
    def test_the_delay_is_known_at_every_frequency(self, frequency):
        live = LiveFilter(RATE, 50.0)
        response = amplitude(live.push(np.cos(2 * np.pi * frequency * TIME)), frequency)
        turned = response * np.exp(2j * np.pi * frequency * live.delay_s)
        assert abs(np.angle(turned)) < 1e-6

    def test_it_stops_what_is_fast_and_keeps_what_is_slow(self):
        live = LiveFilter(RATE, 50.0)
        assert abs(amplitude(live.push(np.cos(2 * np.pi * 200.0 * TIME)), 200.0)) < 3e-3
        live.reset()
        assert abs(amplitude(live.push(np.cos(2 * np.pi * 5.0 * TIME)), 5.0)) == pytest.approx(
            1.0, abs=0.01
        )

    @given(cuts=st.lists(st.integers(0, 300), max_size=8))
    def test_however_cut_the_result_is_the_same_to_the_last_bit(self, cuts):
        value = np.random.default_rng(3).normal(5.0, 1.0, 300)
        whole = LiveFilter(RATE, 80.0).push(value)
        live = LiveFilter(RATE, 80.0)
        parts = [live.push(part) for part in np.split(value, sorted(cuts))]
        assert np.concatenate(parts).tobytes() == whole.tobytes()

    @pytest.mark.parametrize("taps", [1, 4])
    def test_taps_are_odd(self, taps):
        with pytest.raises(InputError, match="odd number"):
            LiveFilter(RATE, 50.0, taps)


class TestOrders:
    # A run-up from 60 to 600 rpm with ripple of orders 1 and 7.
    angle = 2 * np.pi * (1.0 * TIME + 0.5 * 2.25 * TIME**2)
    value = 12.0 + 0.5 * np.cos(angle - 0.4) + 0.2 * np.cos(7 * angle + 1.0)

    def test_orders_stand_still_while_the_speed_changes(self):
        record = resample_in_angle(TIME, self.value, TIME, self.angle, 64)
        spectrum = order_spectrum(record)
        assert spectrum.at(1) == pytest.approx(0.5, rel=5e-3)
        assert spectrum.at(7) == pytest.approx(0.2, rel=5e-3)
        others = np.delete(
            spectrum.amplitude, np.flatnonzero(np.isin(spectrum.order.round(), [1, 7]))
        )
        assert others.max() < 2e-3

    def test_an_angle_that_falls_is_read_as_well(self):
        record = resample_in_angle(TIME, self.value, TIME, -self.angle, 64)
        expected = (
            12.0 + 0.5 * np.cos(-record.angle_rad - 0.4) + 0.2 * np.cos(-7 * record.angle_rad + 1.0)
        )
        assert np.all(np.diff(record.angle_rad) > 0)
        np.testing.assert_allclose(record.value[3:-3], expected[3:-3], atol=2e-3)

    def test_channels_with_other_times(self):
        record = resample_in_angle(
            TIME[500:3000], self.value[500:3000], TIME[::3], self.angle[::3], 32
        )
        ends = np.interp(TIME[[500, 2999]], TIME, self.angle)
        assert ends[0] <= record.angle_rad[0] + 1e-9
        assert record.angle_rad[-1] <= ends[1] + 1e-9

    def test_ripple_is_taken_out_at_any_speed(self):
        fit = fit_ripple(self.angle, self.value + 0.3 * self.angle, orders=(1, 7))
        np.testing.assert_allclose(fit.amplitude, [0.5, 0.2], rtol=1e-6)
        np.testing.assert_allclose(fit.phase_rad, [0.4, -1.0], atol=1e-6)
        np.testing.assert_allclose(fit.rest, 12.0 + 0.3 * self.angle, atol=1e-6)

    @pytest.mark.parametrize(
        ("act", "message"),
        [
            (lambda s: fit_ripple(s.angle[:60], s.value[:60]), "tells the orders apart"),
            (lambda s: fit_ripple(s.angle, s.value, orders=()), "orders"),
            (lambda s: fit_ripple(s.angle, s.value, orders=(1, 1)), "different orders"),
            (lambda s: fit_ripple(s.angle, s.value[:-1]), "two equal rows"),
            (lambda s: fit_ripple(s.angle, s.value * np.nan), "finite"),
            (
                lambda s: resample_in_angle(TIME, s.value, TIME, np.sin(s.angle), 64),
                "turns in one direction",
            ),
            (
                lambda s: resample_in_angle(TIME, s.value, TIME + 100.0, s.angle, 64),
                "nothing in common",
            ),
            (lambda s: resample_in_angle(TIME, s.value, TIME, s.angle, 1), "samples per rev"),
            (lambda s: resample_in_angle(TIME[::-1], s.value, TIME, s.angle, 9), "increase"),
            (lambda s: resample_in_angle(TIME, s.value * np.nan, TIME, s.angle, 9), "finite"),
            (lambda s: resample_in_angle(TIME[:2], s.value, TIME, s.angle, 9), "equal rows"),
            (
                lambda _: order_spectrum(
                    AngleRecord(angle_rad=np.zeros(5), value=np.zeros(5), samples_per_revolution=9)
                ),
                "one whole revolution",
            ),
        ],
    )
    def test_what_cannot_be_is_refused(self, act, message):
        with pytest.raises(InputError, match=message):
            act(self)


class TestAllan:
    def test_white_noise_falls_with_the_root_and_drift_rises(self):
        generator = np.random.default_rng(4)
        drift = 2e-5
        value = generator.normal(0, 1.0, 50_000) + drift * np.arange(50_000)
        allan = allan_deviation(value, 0.01)
        factor = allan.averaging_s / 0.01
        # White noise σ/√m and a linear drift d·m/√2 (NIST SP 1065, table 2)
        expected = np.sqrt(1 / factor + (drift * factor) ** 2 / 2)
        trusted = allan.independent > 40
        np.testing.assert_allclose(allan.deviation[trusted], expected[trusted], rtol=0.15)
        best = 0.01 * (1 / drift**2) ** (1 / 3)
        assert best / 2 < allan.averaging_s[np.argmin(allan.deviation)] < 2 * best

    def test_it_equals_the_definition(self):
        value = np.random.default_rng(5).normal(size=64)
        allan = allan_deviation(value, 1.0)
        for tau, deviation in zip(allan.averaging_s, allan.deviation, strict=True):
            m = int(tau)
            pairs = [
                value[i + m : i + 2 * m].mean() - value[i : i + m].mean()
                for i in range(64 - 2 * m + 1)
            ]
            assert deviation == pytest.approx(np.sqrt(0.5 * np.mean(np.square(pairs))))

    @pytest.mark.parametrize(
        ("value", "interval", "message"),
        [
            (np.zeros(7), 1.0, "samples"),
            (np.full(20, np.nan), 1.0, "finite"),
            (np.zeros(20), 0.0, "interval"),
        ],
    )
    def test_what_cannot_be_is_refused(self, value, interval, message):
        with pytest.raises(InputError, match=message):
            allan_deviation(value, interval)
