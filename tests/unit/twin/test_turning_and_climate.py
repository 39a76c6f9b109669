"""What turning, temperature and lubricant change in the twin; at 23 °C and standstill nothing."""

import numpy as np
import pytest
from tests.unit.twin.drawn_bench import NOMINAL, RPM, driven, make

from torquebench.errors import InputError
from torquebench.twin import BenchTwin, Side, TwinParameters
from torquebench.twin.turning import (
    drag,
    draw_turning,
    fresh_lubrication,
    signal_shift,
    thickness,
)

TURNING = NOMINAL.input.turning
GOLDEN_HZ = np.array(
    [
        59939.134350158754,
        71868.86365407835,
        89790.67515334423,
        71874.16939633578,
        59944.439594885414,
        42042.765417592884,
    ]
)


def sweep(side: Side, temperature_c: float | None = None, speed: float = 0.0) -> np.ndarray:
    path = np.concatenate([np.linspace(0.0, 50.0, 6), np.linspace(40.0, -50.0, 8)])
    twin = BenchTwin(NOMINAL)
    found = twin.static_sweep(side, path, temperature_c=temperature_c, speed_rad_s=speed)
    return np.asarray(found.frequency_hz)


def test_at_23_degrees_and_standstill_the_twin_is_what_it_was() -> None:
    """Golden values of version 0.1.0."""
    twin = BenchTwin(TwinParameters.draw("nominal", 3))
    path = np.array([0.0, 20.0, 50.0, 20.0, 0.0, -30.0])
    found = twin.static_sweep("input", path).frequency_hz
    np.testing.assert_array_equal(found, GOLDEN_HZ)
    assert signal_shift(TURNING, 0.7, 23.0, 23.0, 0.0) == 0.0
    assert drag(TURNING, 0.0, 30.0, 1.0) == 0.0
    assert thickness(fresh_lubrication(), 23.0) == 1.0


def test_constants_have_a_stream_of_their_own_and_follow_preset_and_seed() -> None:
    assert TwinParameters.draw(seed=4).input.turning != TwinParameters.draw(seed=5).input.turning
    drawn = TwinParameters.draw(seed=4)
    assert drawn.input.turning != drawn.output.turning
    design = {"range_nm": 50.0, "largest_speed_rad_s": 125.0, "temperature_effect_per_k": 1e-4}
    worn, new = (draw_turning(np.random.default_rng(1), wear=wear, **design) for wear in (1.7, 1.0))
    assert worn.load == pytest.approx(1.7 * new.load)


def test_zero_and_span_curve_over_temperature_within_the_data_sheet() -> None:
    for seed in range(10):
        for side in (TwinParameters.draw(seed=seed).input, TwinParameters.draw(seed=seed).output):
            linear, bent = side.transducer.zero_drift_per_k, side.turning.zero_curvature_per_k2
            limit = 1e-4 if side.transducer.nominal_torque_nm == 50.0 else 0.5e-4
            for change in (-13.0, 27.0):
                drift = linear * change + bent * change**2
                assert abs(drift) <= limit * abs(change)
            assert abs(bent) * 27.0**2 > 0.02 * limit * 27.0
    change = sweep("input", 43.0) + sweep("input", 3.0) - 2.0 * sweep("input", 23.0)
    per_nm = NOMINAL.input.transducer.sensitivity_hz_per_nm[0]
    expected = 2.0 * 400.0 * TURNING.zero_curvature_per_k2 * 50.0 * per_nm
    assert change[0] == pytest.approx(expected, rel=1e-3)


def test_a_temperature_that_changes_shifts_the_zero_by_its_gradient() -> None:
    steady = signal_shift(TURNING, 0.0, 30.0, 30.0, 0.0)
    warming = signal_shift(TURNING, 0.0, 30.0, 28.0, 0.0)
    assert warming - steady == pytest.approx(-2.0 * TURNING.zero_gradient_per_k)
    twin = make()
    twin.set_climate(30.0)
    assert (twin._state.shaft_c == 30.0).all()
    twin.set_climate(10.0)
    twin.advance(20.0)
    behind = twin._state.shaft_c - twin._state.temperature_c[1:3]
    assert np.all((behind > 0.0) & (behind < 1.0))


def test_drag_has_stribecks_dip_a_power_law_and_grows_with_load() -> None:
    speeds = np.linspace(0.5, TURNING.largest_speed_rad_s, 400)
    unloaded = np.array([drag(TURNING, speed, 0.0, 1.0) for speed in speeds])
    lowest = int(np.argmin(unloaded))
    assert 0 < lowest < 200
    assert unloaded[-1] > unloaded[lowest]
    fast = TURNING.largest_speed_rad_s
    power = [drag(TURNING, share * fast, 0.0, 1.0) for share in (0.5, 1.0)]
    assert np.log2(power[1] / power[0]) == pytest.approx(TURNING.power_exponent, rel=1e-6)
    loaded = drag(TURNING, fast, -40.0, 1.0) - unloaded[-1]
    assert loaded == pytest.approx(40.0 * TURNING.load)
    assert drag(TURNING, -fast, 0.0, 1.0) == -unloaded[-1]


def test_lubricant_amount_hours_and_temperature_make_the_drag() -> None:
    grease = fresh_lubrication()
    factors = [thickness(grease, temperature) for temperature in (10.0, 23.0, 38.0, 50.0)]
    assert factors[0] > 1.5
    assert factors == sorted(factors, reverse=True)
    assert thickness(fresh_lubrication("oil"), 23.0) < 0.6
    assert thickness(fresh_lubrication(amount=1.5), 23.0) == pytest.approx(1.2)
    hours = [thickness(fresh_lubrication(hours=hour), 23.0) for hour in (0.0, 5.0, 50.0, 5e3)]
    assert hours[0] == pytest.approx(1.4)
    assert hours[0] > hours[1] > hours[2]
    assert hours[3] > hours[2]  # it ages


def test_an_empty_run_shows_drag_inertia_and_zero_over_speed() -> None:
    twin = driven(make(mounting="nothing", channels=("input_torque",)), "input")

    def reading(rpm: float, wait_s: float = 2.0) -> float:
        twin.command_speed("input", rpm * RPM)
        twin.advance(wait_s)
        edges = twin.advance(1.0).edges["input_torque"]
        hertz = (edges.size - 1) / ((edges[-1] - edges[0]) / 100e6)
        return float(hertz / NOMINAL.input.transducer.sensitivity_hz_per_nm[0])

    zero = reading(0.0)
    there, back = reading(1200.0) - zero, reading(-1200.0, 4.0) - zero
    dragged, shifted = 0.5 * (there - back), 0.5 * (there + back)
    chain, turning = NOMINAL.input.chain, NOMINAL.input.turning
    speed = 1200.0 * RPM
    expected = chain.drag_nm + chain.drag_viscous_nm_s * speed + drag(turning, speed, 0.0, 1.0)
    assert dragged == pytest.approx(expected, rel=0.5)  # the reading has its own span and zero
    by_speed = NOMINAL.input.transducer.zero_by_speed_s + turning.zero_square_s2 * speed
    assert shifted == pytest.approx(50.0 * by_speed * speed, abs=0.4 * abs(dragged) + 0.002)
    twin.lubricate("input", "grease", amount=2.0)
    assert 0.5 * (reading(1200.0, 4.0) - reading(-1200.0, 4.0)) > 1.2 * dragged
    assert twin._state.lubrication[0, 3] > 0.0  # hours of turning


def test_the_hall_swings_and_cools_when_its_gate_is_opened() -> None:
    twin = make()
    twin.set_climate(30.0, swing_k=8.0, period_h=2.0, drop_k=10.0, drop_every_h=0.5, drop_min=6.0)
    hall = [twin.advance(60.0).truth.temperature_c["ambient"] for _ in range(12)]
    assert min(hall[:6]) < 29.0
    assert hall[-1] > min(hall) + 0.3
    with pytest.raises(InputError, match="swing"):
        twin.set_climate(20.0, swing_k=-1.0)


def test_lubricants_that_there_are_not_are_refused() -> None:
    twin = make()
    with pytest.raises(InputError, match="grease, thin-grease, oil"):
        twin.lubricate("input", "butter")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"0\.1 to 3"):
        twin.lubricate("input", amount=9.0)
