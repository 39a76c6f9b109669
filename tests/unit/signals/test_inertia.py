import numpy as np
import pytest

from torquebench.errors import InputError
from torquebench.signals.inertia import inertia_torque, motion_of_angle, without_inertia


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
