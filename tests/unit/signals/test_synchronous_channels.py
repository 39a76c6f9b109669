import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.signals import SignalFaultKind, TorqueSamples, synchronous
from torquebench.signals.channels import advanced
from torquebench.signals.inertia import inertia_torque, motion_of_angle, without_inertia

STEP = 1e-3


def samples(torque, *, first=0, fault=None, uncertainty=0.01):
    time = (np.arange(len(torque)) + first + 0.5) * STEP
    codes = np.zeros(time.size, dtype=np.uint8) if fault is None else np.array(fault, np.uint8)
    return TorqueSamples(
        time_s=time,
        fault=codes,
        torque_nm=np.where(codes != 0, np.nan, torque),
        standard_uncertainty_nm=np.where(codes != 0, np.nan, uncertainty),
    )


def torque_at(time):
    return 20.0 * np.sin(2 * np.pi * 15.0 * time) + 3.0


class TestDelays:
    @pytest.mark.parametrize("delay", [0.0, 150e-6, 220e-6, 1e-3, 2.7e-3])
    def test_a_delayed_channel_comes_into_line(self, delay):
        time = (np.arange(100) + 0.5) * STEP
        both = synchronous(
            {"a": samples(torque_at(time)), "b": samples(torque_at(time - delay))}, {"b": delay}
        )
        # The cubic's own error: 3/128·h⁴·(2π·15)⁴·20 = 4e-5 N·m
        np.testing.assert_allclose(both.torque_nm["b"], both.torque_nm["a"], atol=1e-4)
        np.testing.assert_allclose(both.torque_nm["a"], torque_at(both.time_s), atol=1e-4)
        assert both.valid.all()

    def test_common_times_of_channels_that_start_differently(self):
        both = synchronous({"a": samples(np.arange(10.0)), "b": samples(np.arange(9.0), first=4)})
        assert both.torque_nm["a"].tolist() == [4.0, 5.0, 6.0, 7.0, 8.0, 9.0]
        assert both.torque_nm["b"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
        np.testing.assert_allclose(both.time_s, (np.arange(4, 10) + 0.5) * STEP)

    def test_a_fault_reaches_every_row_that_needs_the_window(self):
        faults = [0, 0, 0, 0, 0, int(SignalFaultKind.NO_PULSES), 0, 0, 0, 0, 0]
        both = synchronous(
            {"a": samples(np.arange(11.0)), "b": samples(np.arange(11.0), fault=faults)},
            {"b": 0.4e-3},
        )
        bad = both.time_s[~both.valid] / STEP - 0.5
        np.testing.assert_allclose(bad, [3, 4, 5, 6])
        assert np.isnan(both.torque_nm["b"][~both.valid]).all()
        assert np.isfinite(both.torque_nm["a"]).all()

    def test_uncertainty_goes_through_the_interpolation(self):
        both = synchronous({"a": samples(np.zeros(10))}, {"a": 0.5e-3})
        # Lagrange's weights in the middle: (−1, 9, 9, −1)/16
        np.testing.assert_allclose(
            both.standard_uncertainty_nm["a"], 0.01 * np.sqrt(2 * 81 + 2) / 16
        )

    @given(shift=st.floats(-6.0, 6.0))
    def test_cubics_are_shifted_exactly(self, shift):
        number = np.arange(20.0)
        values, lead = advanced((number - 7.0) ** 3, shift)
        at = np.arange(lead, lead + values.size) + shift
        np.testing.assert_allclose(values, (at - 7.0) ** 3, atol=1e-6)

    @pytest.mark.parametrize(
        ("channels", "delays", "message"),
        [
            ({}, {}, "no channels"),
            ({"a": samples(np.zeros(5))}, {"b": 1e-3}, "delay of 'b'"),
            ({"a": samples(np.zeros(1))}, {}, "1 samples"),
            ({"a": samples(np.zeros(5)), "b": samples(np.zeros(5), first=9)}, {}, "common times"),
            ({"a": samples(np.zeros(5)), "b": samples(np.zeros(5), first=0.3)}, {}, "beside"),
        ],
    )
    def test_channels_that_do_not_fit_are_refused(self, channels, delays, message):
        with pytest.raises(InputError, match=message):
            synchronous(channels, delays)

    def test_uneven_and_different_grids_are_refused(self):
        good = samples(np.zeros(5))
        uneven = TorqueSamples(
            time_s=np.array([0.0, 1.0, 3.0, 4.0, 5.0]) * STEP,
            fault=good.fault,
            torque_nm=good.torque_nm,
            standard_uncertainty_nm=good.standard_uncertainty_nm,
        )
        with pytest.raises(InputError, match="uneven"):
            synchronous({"a": uneven})
        slow = TorqueSamples(
            time_s=good.time_s * 2,
            fault=good.fault,
            torque_nm=good.torque_nm,
            standard_uncertainty_nm=good.standard_uncertainty_nm,
        )
        with pytest.raises(InputError, match="every"):
            synchronous({"a": good, "b": slow})


class TestInertia:
    def test_a_ramp_needs_its_inertia_torque(self):
        time = np.arange(500) * 1e-3
        motion = motion_of_angle(0.5 * 125.0 * time**2, 1e-3)
        torque, uncertainty = inertia_torque(motion, 0.004, 0.0001)
        np.testing.assert_allclose(torque, 0.5, rtol=1e-6)
        np.testing.assert_allclose(uncertainty, 0.0125, rtol=1e-6)

    def test_the_stated_uncertainty_of_the_acceleration_is_its_scatter(self):
        generator = np.random.default_rng(1)
        noise = 2e-5
        motion = motion_of_angle(
            generator.normal(0, noise, 20_000), 1e-3, window=41, angle_uncertainty_rad=noise
        )
        inner = slice(50, -50)
        assert motion.acceleration_rad_s2[inner].std() == pytest.approx(
            motion.acceleration_uncertainty_rad_s2, rel=0.1
        )
        assert motion.speed_rad_s[inner].std() == pytest.approx(
            motion.speed_uncertainty_rad_s, rel=0.1
        )

    def test_the_corrected_torque_agrees_with_monte_carlo(self):
        generator = np.random.default_rng(2)
        time = np.arange(200) * 1e-3
        angle = 0.5 * 300.0 * time**2
        noise = 1e-5
        motion = motion_of_angle(angle, 1e-3, angle_uncertainty_rad=noise)
        measured = 7.0 + 0.01 * 300.0
        _, stated = without_inertia(np.full(200, measured), np.full(200, 0.02), motion, 0.01, 2e-4)
        draws = []
        for _ in range(400):
            drawn = motion_of_angle(angle + generator.normal(0, noise, 200), 1e-3)
            torque, _ = without_inertia(
                np.full(200, measured + generator.normal(0, 0.02)),
                np.zeros(200),
                drawn,
                0.01 + generator.normal(0, 2e-4),
            )
            draws.append(torque[100])
        assert np.mean(draws) == pytest.approx(7.0, abs=0.02)
        assert np.std(draws) == pytest.approx(stated[100], rel=0.12)

    @pytest.mark.parametrize(
        ("act", "message"),
        [
            (lambda: motion_of_angle([1.0, np.nan] * 40, 1e-3), "finite row"),
            (lambda: motion_of_angle(np.zeros(100), 0.0), "interval"),
            (lambda: motion_of_angle(np.zeros(100), 1e-3, window=50), "odd window"),
            (lambda: motion_of_angle(np.zeros(10), 1e-3), "odd window"),
            (lambda: inertia_torque(motion_of_angle(np.zeros(60), 1e-3), -1.0), "inertia"),
            (
                lambda: without_inertia(
                    np.zeros(5), np.zeros(5), motion_of_angle(np.zeros(60), 1e-3), 1.0
                ),
                "as many of each",
            ),
        ],
    )
    def test_what_cannot_be_is_refused(self, act, message):
        with pytest.raises(InputError, match=message):
            act()
