"""The reducer under test: friction, spring, loss, transmission error; and the moving shafts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.twin import TwinParameters, mechanism
from torquebench.twin.reducer import (
    BRISTLE,
    GEAR_OFFSET,
    LOSS_J,
    REDUCER_STATES,
    friction_level,
    reducer_friction,
    reducer_torque,
    spring_torque,
    temperature_factors,
    transmission_error,
)

ARCMIN = np.pi / 180 / 60
NAMES = ["standard", "rv-40e", "harmonic-20"]
REDUCERS = {name: TwinParameters.draw("nominal", 4, reducer=name).reducer for name in NAMES}
STANDARD = REDUCERS["standard"]

names = st.sampled_from(NAMES)


@given(name=names, twist=st.floats(-5e-3, 5e-3))
def test_spring_is_odd_and_rises(name, twist):
    reducer = REDUCERS[name]
    torque = spring_torque(reducer, twist)
    assert spring_torque(reducer, -twist) == -torque
    assert spring_torque(reducer, twist + 1e-4) >= torque
    assert abs(spring_torque(reducer, twist + 1e-9) - torque) < 1e-2  # no jumps


def test_backlash_carries_nothing():
    gap = STANDARD.backlash_rad
    assert gap > 0.0
    assert spring_torque(STANDARD, 0.499 * gap) == 0.0
    assert spring_torque(STANDARD, 0.51 * gap) > 0.0
    assert REDUCERS["harmonic-20"].backlash_rad == 0.0


@pytest.mark.parametrize(
    ("name", "low", "high"), [("standard", 380, 440), ("rv-40e", 104, 117), ("harmonic-20", 6, 9)]
)
def test_stiffness_of_the_class(name, low, high):
    reducer = REDUCERS[name]
    assert low < reducer.stiffness_nm_rad[2] * ARCMIN < high
    assert reducer.stiffness_nm_rad[0] < reducer.stiffness_nm_rad[2]


def loop(reducer, state, amplitude, points=400):
    twist = amplitude * np.sin(np.linspace(0.0, 2 * np.pi, points))
    return twist, np.array([reducer_torque(reducer, state, x, 0.0) for x in twist])


@pytest.mark.parametrize("name", NAMES)
def test_torsion_loop_closes_and_loses_energy(name):
    reducer, state = REDUCERS[name], np.zeros(REDUCER_STATES)
    amplitude = reducer.rated_torque_nm / reducer.stiffness_nm_rad[1]
    loop(reducer, state, amplitude)
    twist, torque = loop(reducer, state, amplitude)
    _, again = loop(reducer, state, amplitude)
    np.testing.assert_allclose(torque, again, atol=1e-9 * reducer.rated_torque_nm)
    loss = np.trapezoid(torque, twist)
    assert loss > 0.0
    half_width = sum(np.array(reducer.stop_width_rad) * np.array(reducer.stop_stiffness_nm_rad))
    assert 0.005 < half_width / reducer.rated_torque_nm < 0.06
    assert loss < 4.0 * half_width * amplitude * 1.05


@pytest.mark.parametrize("name", NAMES)
def test_lost_motion_is_that_of_a_precision_reducer(name):
    reducer, state = REDUCERS[name], np.zeros(REDUCER_STATES)
    amplitude = reducer.rated_torque_nm / reducer.stiffness_nm_rad[1]
    loop(reducer, state, amplitude)
    twist, torque = loop(reducer, state, amplitude, 4001)
    falling = slice(1000, 3001)
    rising = np.r_[3000:4000, 1:1001]
    at_zero = [
        np.interp(0.0, np.sort(torque[part]), twist[part][np.argsort(torque[part])])
        for part in (falling, rising)
    ]
    assert 0.0 < abs(at_zero[1] - at_zero[0]) / ARCMIN < 1.0


def sliding(reducer, speed, *, load=0.0, temperature=23.0):
    state = np.zeros(REDUCER_STATES)
    factors = temperature_factors(reducer, temperature)
    for _ in range(20_000):
        torque = reducer_friction(reducer, state, speed, load, *factors, 5e-5)
    return torque


def test_friction_follows_coulomb_stribeck_and_viscosity():
    speeds = [0.2, 20.0, 125.0]
    slow, medium, fast = (sliding(STANDARD, speed) for speed in speeds)
    assert slow == pytest.approx(STANDARD.static_nm, rel=0.02)
    assert medium == pytest.approx(STANDARD.coulomb_nm + 20.0 * STANDARD.viscous_nm_s, rel=1e-6)
    assert fast == pytest.approx(STANDARD.coulomb_nm + 125.0 * STANDARD.viscous_nm_s, rel=1e-6)
    assert sliding(STANDARD, -125.0) == pytest.approx(-fast, rel=1e-12)


def test_friction_falls_with_temperature_and_grows_with_load():
    assert sliding(STANDARD, 60.0, temperature=45.0) < 0.9 * sliding(STANDARD, 60.0)
    assert temperature_factors(STANDARD, 23.0) == (1.0, 1.0)
    rated = STANDARD.rated_torque_nm
    extra = sliding(STANDARD, 60.0, load=rated) - sliding(STANDARD, 60.0)
    assert extra == pytest.approx(STANDARD.load_share * rated / STANDARD.ratio, rel=1e-9)


@given(speed=st.floats(-300.0, 300.0), load=st.floats(-2000.0, 2000.0))
def test_friction_always_brakes(speed, load):
    assert friction_level(STANDARD, speed, load, 1.0) > 0.0
    state = np.zeros(REDUCER_STATES)
    for _ in range(1000):
        torque = reducer_friction(STANDARD, state, speed, load, 1.0, 1.0, 5e-5)
    assert torque * speed >= 0.0
    assert abs(state[BRISTLE]) < 50.0 * STANDARD.bristle_rad


@pytest.mark.parametrize("name", NAMES)
def test_transmission_error_is_its_fourier_series(name):
    reducer = REDUCERS[name]
    angle = np.linspace(0.0, 2 * np.pi, 4096, endpoint=False)
    error = np.array([transmission_error(reducer, a)[0] for a in angle])
    spectrum = 2.0 * np.abs(np.fft.rfft(error)) / angle.size
    for order, amplitude in zip(reducer.error_order, reducer.error_rad, strict=True):
        assert spectrum[int(order)] == pytest.approx(amplitude, rel=1e-9)
    slope = [transmission_error(reducer, a)[1] for a in angle]
    numeric = (np.roll(error, -1) - np.roll(error, 1)) / (angle[2] - angle[0])
    # the finest order's slope is damped by sin(x)/x of the difference over two points
    assert np.max(np.abs(slope - numeric)) < 0.1 * np.max(np.abs(slope))


def test_unknown_reducer_is_refused():
    with pytest.raises(InputError, match="harmonic-20"):
        TwinParameters.draw("nominal", 1, reducer="planetary")


def coupled(shafts, reducer_state, steps, *, motor=(0.0, 0.0), conversion=(1, 0)):
    """Move a coupled bench; returns motor and flange speeds."""
    parameters = TwinParameters.draw("nominal", 4)
    drives = (parameters.input.drive, parameters.output.drive)
    speeds = np.empty((steps, 2))
    for k in range(steps):
        mechanism.move(
            drives, STANDARD, shafts, reducer_state, np.array(conversion),
            mechanism.FLANGE_COUPLED, np.array(motor), np.zeros(2), np.zeros(2), 23.0, 1e-3, 20,
        )  # fmt: skip
        speeds[k] = shafts[:, mechanism.FLANGE_SPEED]
    return speeds


def at_rest():
    state = np.zeros(REDUCER_STATES)
    state[GEAR_OFFSET] = -transmission_error(STANDARD, 0.0)[0]
    return np.zeros((2, mechanism.SHAFT_STATES)), state


def test_nothing_moves_without_a_cause():
    shafts, state = at_rest()
    coupled(shafts, state, 200)
    assert np.max(np.abs(shafts)) < 1e-9


def test_friction_holds_below_break_away_and_lets_go_above():
    for share, turns in ((0.9, False), (1.1, True)):
        shafts, state = at_rest()
        speeds = coupled(shafts, state, 1500, motor=(share * STANDARD.static_nm, 0.0))
        assert bool(abs(speeds[-1, 0]) > 0.5) is turns


@pytest.mark.nightly
def test_energy_of_a_coasting_bench_ends_in_friction():
    parameters = TwinParameters.draw("nominal", 4)
    shafts, state = at_rest()
    start = 60.0
    shafts[0, [mechanism.MOTOR_SPEED, mechanism.FLANGE_SPEED]] = start
    shafts[1, mechanism.FLANGE_SPEED] = start / STANDARD.ratio
    drive, behind = parameters.input.drive, parameters.output.drive
    ahead = drive.motor_inertia_kgm2 + drive.flange_inertia_kgm2 + STANDARD.input_inertia_kgm2
    after = behind.flange_inertia_kgm2 + STANDARD.output_inertia_kgm2
    energy = 0.5 * (ahead * start**2 + after * (start / STANDARD.ratio) ** 2)
    coupled(shafts, state, 6000)
    assert np.max(np.abs(shafts[:, mechanism.FLANGE_SPEED])) < 1e-3
    assert state[LOSS_J] == pytest.approx(energy, rel=0.02)


def test_sides_turn_by_the_ratio():
    shafts, state = at_rest()
    speeds = coupled(shafts, state, 2500, motor=(1.0, 0.0))
    tail = speeds[-500:].mean(axis=0)
    assert tail[0] / tail[1] == pytest.approx(STANDARD.ratio, rel=2e-3)


def test_natural_frequency_of_the_shaft():
    """A held flange and a motor that's let go: the two-inertia system's textbook frequency."""
    parameters = TwinParameters.draw("nominal", 4)
    drives = (parameters.input.drive, parameters.output.drive)
    shafts = np.zeros((2, mechanism.SHAFT_STATES))
    shafts[:, mechanism.MOTOR_ANGLE] = 1e-3
    torque = np.empty((400, 2))
    for k in range(400):
        mechanism.move(
            drives, STANDARD, shafts, np.zeros(REDUCER_STATES), np.array([1, 1]),
            mechanism.FLANGE_HELD, np.zeros(2), np.zeros(2), np.zeros(2), 23.0, 1e-4, 20,
        )  # fmt: skip
        torque[k] = shafts[:, mechanism.SHAFT_TORQUE]
    for side, drive in enumerate(drives):
        crossings = np.flatnonzero(np.diff(np.sign(torque[:, side])))[:5]
        period = 2.0 * 1e-4 * np.mean(np.diff(crossings))
        expected = 2 * np.pi * np.sqrt(drive.motor_inertia_kgm2 / drive.stiffness_nm_rad)
        assert period == pytest.approx(expected, rel=0.06)
        assert abs(torque[-1, side]) < 0.3 * abs(torque[0, side])
