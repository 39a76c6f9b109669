import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.reducers import (
    FORMS,
    evaluate_friction,
    evaluate_no_load,
    fit_friction,
)
from torquebench.reducers.preparation import Samples
from torquebench.reducers.running.friction import curve_of
from torquebench.reducers.running.points import speed_points

RAD_S_PER_RPM = 2 * np.pi / 60


def stribeck(speed_rpm, coulomb=0.4, viscous=0.002, extra=0.1, speed=80.0, exponent=2):
    omega = np.abs(speed_rpm) * RAD_S_PER_RPM
    decay = np.exp(-((omega / (speed * RAD_S_PER_RPM)) ** exponent))
    return np.sign(speed_rpm) * (coulomb + extra * decay + viscous * omega)


def sweep(repeats=3, noise=0.0, seed=0, both=True):
    rising = np.array([10.0, 25.0, 50.0, 100.0, 200.0, 400.0, 600.0, 800.0, 1000.0, 1200.0])
    path = np.concatenate([rising, rising[-2::-1]])
    branch = np.concatenate([np.ones(10), -np.ones(9)])
    one = np.concatenate([path, -path]) if both else path
    speed = np.tile(one, repeats)
    turn = np.tile(branch, repeats * (2 if both else 1))
    rng = np.random.default_rng(seed)
    return speed, stribeck(speed) + rng.normal(0, noise, speed.size), turn


def friction_curve(speed, torque, branch=None, tolerance_rpm=None):
    points = Samples.of(1, speed_rpm=speed, torque_nm=torque, branch=branch)
    return curve_of(speed_points(points, tolerance_rpm=tolerance_rpm, zeroed=True, steady=True))


def test_curve_has_mean_spread_and_standard_error_of_repeats():
    curve = friction_curve([100, 200, 100, 200], [1.0, 2.0, 1.2, 2.4], [1, 1, -1, -1])
    np.testing.assert_allclose(curve.torque_nm, [1.1, 2.2])
    np.testing.assert_allclose(curve.spread_nm, [0.2 / np.sqrt(2), 0.4 / np.sqrt(2)])
    pooled = np.sqrt((0.02 + 0.08) / 2)
    np.testing.assert_allclose(curve.standard_error_nm, pooled / np.sqrt(2))
    np.testing.assert_allclose(curve.up_minus_down_nm, [-0.2, -0.4])


def test_single_points_have_no_spread():
    curve = friction_curve([100.0, 200.0], [1.0, 2.0])
    assert np.all(np.isnan(curve.spread_nm))
    assert np.all(np.isnan(curve.standard_error_nm))
    assert np.all(np.isnan(curve.up_minus_down_nm))


def test_speeds_within_the_tolerance_are_one_speed():
    assert friction_curve([99.9, 100.1, 200.0], [1.0, 1.0, 2.0]).points.tolist() == [2, 1]
    exact = friction_curve([99.9, 100.1, 200.0], [1.0, 1.0, 2.0], tolerance_rpm=0.1)
    assert exact.points.tolist() == [1, 1, 1]


def test_known_friction_is_found_in_both_directions():
    result = evaluate_friction(*sweep())
    for fit in (result.clockwise, result.counter_clockwise):
        assert fit.form == "coulomb-viscous-stribeck"
        assert fit.coulomb_nm.value == pytest.approx(0.4, rel=1e-6)
        assert fit.viscous_nm_s_per_rad.value == pytest.approx(0.002, rel=1e-6)
        assert fit.stribeck_nm.value == pytest.approx(0.1, rel=1e-6)
        assert fit.stribeck_speed_rpm.value == pytest.approx(80.0, rel=1e-4)
    assert result.worst_relative_uncertainty == pytest.approx(0.0, abs=1e-9)


def test_curve_of_the_fit_has_the_sign_of_the_speed():
    fit = evaluate_friction(*sweep()).clockwise
    speed = np.array([-300.0, 300.0])
    np.testing.assert_allclose(fit.torque(speed), stribeck(speed), rtol=1e-5)


def test_uncertainties_hold_in_repeated_experiments():
    inside, curve_inside, total = 0, 0, 60
    for seed in range(total):
        fit = evaluate_friction(
            *sweep(noise=0.005, seed=seed, both=False), form="coulomb-viscous-stribeck"
        ).clockwise
        u = fit.coulomb_nm.standard_uncertainty
        inside += abs(fit.coulomb_nm.value - 0.4) < 2 * u
        at = fit.standard_uncertainty(300.0)[0]
        curve_inside += abs(fit.torque(300.0) - stribeck(np.array(300.0))) < 2 * at
    assert inside / total > 0.82
    assert curve_inside / total > 0.82


@given(
    coulomb=st.floats(0.01, 10.0),
    viscous=st.floats(0.0001, 0.1),
    seed=st.integers(0, 2**32 - 1),
)
def test_plain_friction_gets_no_stribeck_part(coulomb, viscous, seed):
    speed = np.tile(np.linspace(100.0, 1200.0, 12), 3)
    torque = coulomb + viscous * speed * RAD_S_PER_RPM
    noise = np.random.default_rng(seed).normal(0, 0.001 * coulomb, speed.size)
    fit = evaluate_friction(speed, torque + noise, form="coulomb-viscous").clockwise
    assert fit.form in ("coulomb", "coulomb-viscous")
    assert fit.coulomb_nm.value == pytest.approx(coulomb, rel=0.02)


def test_a_part_below_zero_is_not_there():
    speed = np.linspace(100.0, 1000.0, 10)
    fit = evaluate_friction(speed, 1.0 - 0.0001 * speed, form="coulomb-viscous").clockwise
    assert fit.form == "coulomb"
    assert fit.viscous_nm_s_per_rad.value == 0.0


def test_a_systematic_uncertainty_is_not_averaged_away():
    few = evaluate_friction(*sweep(repeats=3, noise=0.001), systematic_uncertainty_nm=0.02)
    many = evaluate_friction(*sweep(repeats=30, noise=0.001), systematic_uncertainty_nm=0.02)
    smallest = np.min(np.abs(many.curve.torque_nm))
    assert many.worst_relative_uncertainty == pytest.approx(0.04 / smallest, rel=0.01)
    assert few.worst_relative_uncertainty >= 0.04 / np.max(np.abs(few.curve.torque_nm))
    many.require(0.5)
    with pytest.raises(InputError, match=r"at most 1 %"):
        many.require(0.01)


def test_too_few_speeds_give_a_curve_but_no_fit():
    result = evaluate_friction([100.0, 200.0, -100.0], [0.5, 0.6, -0.5])
    assert result.clockwise is None
    assert result.counter_clockwise is None
    assert result.curve.points.tolist() == [1, 1, 1]


@pytest.mark.parametrize(
    ("speed", "torque", "branch", "message"),
    [
        ([], [], None, "0 values of speed_rpm"),
        ([100.0, 200.0], [1.0], None, "torque_nm of shape"),
        ([100.0, np.nan], [1.0, 1.0], None, "speed_rpm is nan in row 2"),
        ([100.0, 200.0], [1.0, np.inf], None, "torque_nm is inf in row 2"),
        ([100.0, 200.0], [1.0, 1.0], [1], "branch of shape"),
        ([0.0, 0.0], [1.0, 1.0], None, "a speed of 0 in all rows"),
        ([100.0, 200.0], [-1.0, -1.0], None, "help the motion"),
    ],
)
def test_what_cannot_be_used_is_named(speed, torque, branch, message):
    with pytest.raises(InputError, match=message):
        evaluate_friction(speed, torque, branch)


def test_unknown_forms_are_named():
    with pytest.raises(InputError, match="form 'quadratic'"):
        evaluate_friction([100.0], [1.0], form="quadratic")
    speed, torque, points = np.arange(1.0, 5.0), np.ones(4), np.ones(4, dtype=np.int64)
    with pytest.raises(InputError, match="4 speeds"):
        fit_friction(speed, torque, points, form=list(FORMS)[-1])


def test_a_temperature_that_changes_is_named():
    speed = np.arange(100.0, 1300.0, 100.0)
    torque = 0.2 + 1e-4 * speed
    steady = evaluate_friction(speed, torque, temperature_c=np.linspace(30.0, 31.5, 12))
    assert steady.findings == ()
    (found,) = evaluate_friction(speed, torque, temperature_c=np.linspace(22.0, 45.0, 12)).findings
    assert found.name == "unsteady temperature"
    assert "22.0 to 45.0 °C" in found.message


def test_a_speed_that_was_not_reached_is_named() -> None:
    demanded = np.tile([100.0, 500.0, 1000.0, 1500.0], 3)
    speed = np.minimum(demanded * 0.999, 1210.0)
    torque = 0.3 + 1e-4 * speed
    (found,) = evaluate_friction(speed, torque, demanded_rpm=demanded).findings
    assert found.name == "drive saturation"
    assert "1500 rpm were requested and 1210 rpm reached (3 of 12 points)" in found.message
    assert not evaluate_friction(speed, torque, demanded_rpm=speed).findings
    with pytest.raises(InputError, match="demanded"):
        evaluate_friction(speed, torque, demanded_rpm=demanded[:5])
    no_load = evaluate_no_load(speed, torque, nominal_rpm=demanded, repeat=np.repeat([1, 2, 3], 4))
    assert "drive saturation" in {each.name for each in no_load.findings}


@pytest.mark.parametrize("speeds", [3, 4, 5])
def test_few_speeds_show_what_their_own_noise_excludes(speeds):
    """Criteria of information can't tell forms apart from few points; repeats can."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        viscous = rng.uniform(0.5, 2.0)
        speed = np.repeat(np.linspace(200.0, 1000.0, speeds), 6)
        torque = 1.0 + viscous * speed / 1000.0 + 0.005 * rng.standard_normal(speed.size)
        fit = evaluate_friction(speed, torque).clockwise
        assert "viscous" in fit.form, seed
        flat = evaluate_friction(speed, torque - viscous * speed / 1000.0).clockwise
        assert flat.form == "coulomb", seed
