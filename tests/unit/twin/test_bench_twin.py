"""The whole twin: determinism, blocks, modes, loading, raw error, statics and dynamics agree."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.unit.twin.drawn_bench import NOMINAL, RANGE, RPM, driven, make

from torquebench.errors import InputError
from torquebench.twin import CHANNELS, SIDES, BenchTwin, TwinParameters
from torquebench.twin.chain import transducer_torque
from torquebench.twin.drive import Loading
from torquebench.twin.transducer import (
    NOISES,
    fresh_transducer_state,
    transducer_frequency,
    transducer_signal,
)
from torquebench.twin.turning import signal_shift


def counted_hz(ticks, timebase_hz=100e6):
    return (ticks.size - 1) / (ticks[-1] - ticks[0]) * timebase_hz


def script(twin, durations):
    """Run commands at fixed times whatever the blocks in between; returns all that came out."""
    orders = [
        lambda: twin.command_torque("input", 20.0),
        lambda: twin.command_torque("output", -900.0),
        lambda: twin.command_torque("input", -3.0),
        lambda: twin.command_speed("input", 30.0),
    ]
    blocks = []
    for order, cuts in zip(orders, durations, strict=True):
        order()
        blocks.extend(twin.advance(duration) for duration in cuts)
    return {
        **{c: np.concatenate([b.edges[c] for b in blocks]) for c in CHANNELS},
        **{f"{s} counts": np.concatenate([b.angles[s].counts for b in blocks]) for s in SIDES},
        **{f"{s} true": np.concatenate([b.truth.torque_nm[s] for b in blocks]) for s in SIDES},
        "time": np.concatenate([b.truth.time_s for b in blocks]),
    }


def test_same_seed_same_bits_other_seed_other_bits():
    runs = [script(driven(make(seed=seed, channels=CHANNELS)), [[0.03]] * 4) for seed in (7, 7, 8)]
    for name, values in runs[0].items():
        np.testing.assert_array_equal(values, runs[1][name], err_msg=name)
    assert not np.array_equal(runs[0]["input_torque"][:1500], runs[2]["input_torque"][:1500])


@settings(max_examples=15)
@given(
    cuts=st.lists(
        st.lists(st.integers(1, 29_999_999), max_size=3, unique=True), min_size=4, max_size=4
    )
)
def test_blocks_of_any_size_give_the_same_edges(cuts):
    """Commands fall on whole milliseconds; the cuts in between fall on any tick (30 ms each)."""
    whole = script(driven(make(channels=CHANNELS)), [[0.03]] * 4)
    pieces = []
    for ticks in cuts:
        borders = np.array([0, *sorted(t // 10 for t in ticks), 3_000_000])
        pieces.append([float(d) / 100e6 for d in np.diff(borders) if d > 0])
    result = script(driven(make(channels=CHANNELS)), pieces)
    for name, values in whole.items():
        np.testing.assert_array_equal(values, result[name], err_msg=name)


def test_blocks_cover_time_without_gaps():
    twin = driven(make(channels=CHANNELS))
    twin.command_torque("input", 45.0)
    before, edges = 0, {channel: [] for channel in CHANNELS}
    for duration in (0.05, 0.0123, 0.05, 1e-8, 0.1):
        block = twin.advance(duration)
        assert block.start_tick == before
        before = block.stop_tick
        for channel, ticks in block.edges.items():
            assert np.all((ticks >= block.start_tick) & (ticks < block.stop_tick))
            edges[channel].append(ticks)
    assert twin.tick == before
    assert twin.time_s == pytest.approx(0.21230001)
    for ticks in map(np.concatenate, edges.values()):
        assert np.all(np.diff(ticks) > 0)
        assert np.max(np.diff(ticks)) < 2000
    assert np.concatenate(edges["input_torque"])[0] < 2000


def test_idle_channels_cost_no_edges_and_change_nothing():
    full = script(driven(make(channels=CHANNELS)), [[0.02]] * 4)
    twin = driven(make(channels=["output_torque"]))
    twin.command_torque("input", 20.0)
    block = twin.advance(0.02)
    assert set(block.edges) == {"output_torque"}
    ticks = block.edges["output_torque"]
    np.testing.assert_array_equal(ticks, full["output_torque"][: ticks.size])


def test_references_are_silent_unless_mounted():
    twin = BenchTwin(NOMINAL, 1)
    assert twin.advance(0.02).edges["input_reference"].size == 0
    assert twin.advance(0.02).edges["input_torque"].size > 1000
    for what, sounds in (("calibrator", True), ("reducer", False), ("verification_standard", True)):
        twin.mount(what)
        twin.advance(0.01)
        assert (twin.advance(0.02).edges["output_reference"].size > 1000) is sounds


@pytest.mark.parametrize("preset", ["nominal", "worn"])
def test_every_constant_is_redrawn(preset):
    one, two = (TwinParameters.draw(preset, seed) for seed in (1, 2))
    assert one == TwinParameters.draw(preset, 1)
    for part in ("chain", "transducer", "drive", "calibrator", "encoder"):
        assert getattr(one.input, part) != getattr(two.input, part)
        assert getattr(one.input, part) != getattr(one.output, part)
    for part in ("reducer", "thermal", "counter"):
        assert getattr(one, part) != getattr(two, part)
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.seed = 3


def raw_error(parameters, side):
    path = np.concatenate((np.linspace(0, 1, 101), np.linspace(1, 0, 101))) * RANGE[side]
    twin = BenchTwin(parameters, 0, active_channels=())
    sweeps = [twin.static_sweep(side, sign * path) for sign in (1.0, -1.0)]
    return max(np.max(np.abs(s.true_torque_nm - s.reading_nm)) for s in sweeps) / RANGE[side]


@pytest.mark.parametrize("side", SIDES)
def test_raw_error_of_fifty_benches(side):
    raw = np.array([raw_error(TwinParameters.draw("nominal", k), side) for k in range(50)])
    assert raw.min() > 0.3e-2
    assert raw.max() < 1.0e-2
    worn = np.array([raw_error(TwinParameters.draw("worn", k), side) for k in range(20)])
    assert np.median(worn) > 1.2 * np.median(raw)
    repeatability = [
        getattr(TwinParameters.draw("nominal", k), side).transducer.repeatability for k in range(50)
    ]
    assert min(repeatability) >= 1e-4
    assert max(repeatability) <= 2e-4


@pytest.mark.parametrize("side", SIDES)
def test_no_polynomial_is_exact(side):
    twin = BenchTwin(NOMINAL, 0, active_channels=())
    sweep = twin.static_sweep(side, np.linspace(0.02, 1.0, 400) * RANGE[side])
    relative = sweep.reading_nm / RANGE[side]
    error = (sweep.true_torque_nm - sweep.reading_nm) / RANGE[side]
    left = [
        np.max(np.abs(error - np.polyval(np.polyfit(relative, error, degree), relative)))
        for degree in (1, 2, 3, 5)
    ]
    assert left[1] > 1e-4
    assert left[3] > 0.3e-4


def test_static_sweep_is_noise_free_and_leaves_no_trace():
    twin = BenchTwin(NOMINAL, 5)
    path = np.concatenate((np.linspace(0, 50, 26), np.linspace(48, 0, 25)))
    first = twin.static_sweep("input", path)
    twin.advance(0.01)
    second = twin.static_sweep("input", path)
    np.testing.assert_array_equal(first.reading_nm, second.reading_nm)
    np.testing.assert_array_equal(first.branch[:2], [0, 1])
    assert np.all(first.branch[1:26] == 1)
    assert np.all(first.branch[26:] == -1)
    assert first.reading_nm[-1] == pytest.approx(0.0, abs=1e-12)
    rising, falling = first.reading_nm[1:25], first.reading_nm[26:50][::-1]
    assert np.all(falling > rising)
    warm = twin.static_sweep("input", path, temperature_c=33.0)
    assert 1e-4 < np.max(np.abs(warm.reading_nm - first.reading_nm)) / 50.0 < 1e-3


@pytest.mark.parametrize("side", SIDES)
def test_static_and_dynamic_paths_agree_within_noise(side):
    scale, channel = RANGE[side], f"{side}_torque"
    twin = driven(make(channels=[channel, f"{side}_reference"]), side)
    plate = twin.nameplate(channel)

    def hold(share):
        twin.command_torque(side, share * scale)
        twin.advance(0.35)
        block = twin.advance(0.4)
        reference = counted_hz(block.edges[f"{side}_reference"])
        return (
            np.mean(block.truth.torque_nm[side]), counted_hz(block.edges[channel]), reference
        )  # fmt: skip

    for share in (1.0, 0.0):
        zero = hold(share)
    shares = [0.1, 0.25, 0.4, 0.6, 0.8, 1.0, 0.8, 0.6, 0.4, 0.25, 0.1]
    points = np.array([hold(share) for share in shares])
    reading = (points[:, 1] - zero[1]) / plate.sensitivity_hz_per_nm
    reference = (points[:, 2] - zero[2]) / plate.sensitivity_hz_per_nm
    path = np.concatenate((points[:, 0], [0.0]))
    sweep = twin.static_sweep(side, path)
    deviation = (reading - sweep.reading_nm[:-1]) / scale
    sigma = getattr(NOMINAL, side).transducer.repeatability
    assert np.max(np.abs(deviation)) < 4.5 * sigma
    assert np.std(deviation) < 2.0 * sigma
    assert np.max(np.abs(reference - sweep.reference_nm[:-1])) / scale < 6e-5


@pytest.mark.parametrize("side", SIDES)
def test_commanded_torque_is_never_the_true_torque_but_near(side):
    twin = driven(make(), side)
    errors = []
    for share in (0.02, 0.3, 0.7, 1.0, 0.5, -0.5, -1.0):
        twin.command_torque(side, share * RANGE[side])
        twin.advance(0.45)
        block = twin.advance(0.3)
        errors.append(np.mean(block.truth.torque_nm[side]) / RANGE[side] - share)
    assert np.all(np.abs(errors) < 1e-3)
    assert np.all(np.abs(errors) > 1e-7)


def test_loading_error_follows_the_command():
    errors = []
    for seed in range(40):
        drive = TwinParameters.draw("nominal", seed).input.drive
        loading = Loading(drive, np.random.default_rng(seed))
        errors += [loading.error(torque) / 50.0 for torque in np.linspace(-50.0, 50.0, 41)]
    assert np.max(np.abs(errors)) < 1e-3
    assert np.std(errors) > 1e-4
    assert loading.error(20.0) == loading.error(20.0)
    assert abs(loading.error(20.01) - loading.error(20.0)) < 0.2 * 1e-3 * 50.0
    assert loading.error(0.0) == 0.0


def settled(twin, side, duration=0.6):
    twin.advance(duration)
    return float(np.mean(twin.advance(0.2).truth.torque_nm[side]))


def test_only_an_enabled_driven_clamped_side_carries_torque():
    twin = make()
    twin.command_torque("input", 30.0)
    assert settled(twin, "input") == 0.0
    driven(twin, "input")
    assert settled(twin, "input") == 0.0
    twin.command_torque("input", 30.0)
    assert settled(twin, "input") == pytest.approx(30.0, abs=0.05)
    assert settled(twin, "output") == 0.0
    twin.set_mode("input", "free")
    assert settled(twin, "input") == 0.0
    twin.set_mode("input", "driven")
    assert settled(twin, "input") == pytest.approx(30.0, abs=0.05)
    twin.set_clamped(False)
    assert settled(twin, "input") == 0.0


@pytest.mark.parametrize("side", SIDES)
def test_emergency_takes_the_torque_away(side):
    twin = driven(make())
    twin.command_torque(side, 0.9 * RANGE[side])
    assert settled(twin, side) > 0.89 * RANGE[side]
    twin.disable()
    torque = twin.advance(0.3).truth.torque_nm[side]
    assert np.max(np.abs(torque[150:])) < 0.02 * RANGE[side]
    twin.enable(side, True)  # the command is forgotten
    assert abs(settled(twin, side)) < 1e-3 * RANGE[side]


def test_transducer_lags_the_torque_by_its_group_delay():
    """On a ramp the reading is behind by rate times 220 µs."""
    twin = driven(make(channels=["input_reference"]), "input")
    plate, rate = twin.nameplate("input_reference"), 250.0
    twin.advance(0.2)
    twin.command_torque("input", -45.0)
    twin.advance(1.0)
    twin.command_torque("input", 45.0)
    block = twin.advance(0.3)
    ticks = block.edges["input_reference"]
    frequency = 1e8 / np.diff(ticks)
    time_s = 0.5 * (ticks[1:] + ticks[:-1]) / 1e8
    ramp = (time_s > block.truth.time_s[0] + 0.08) & (time_s < block.truth.time_s[0] + 0.28)
    constants = NOMINAL.input.calibrator.constants
    shown = (frequency - constants.zero_hz) / plate.sensitivity_hz_per_nm
    true = np.interp(time_s, block.truth.time_s, block.truth.torque_nm["input"])
    behind = np.mean((true - shown)[ramp]) / rate
    assert behind == pytest.approx(220e-6, abs=60e-6)  # the certificate's error is in it


def test_inertia_torque_shows_while_the_calibrators_shaft_is_accelerated():
    twin = driven(make(), "input")
    twin.command_speed("input", 100.0)
    block = twin.advance(0.3)
    acceleration = np.diff(block.truth.speed_rad_s["input"][100:250]).mean() / 1e-3
    drive = NOMINAL.input.drive
    expected = -(drive.motor_inertia_kgm2 + drive.flange_inertia_kgm2) * acceleration
    assert acceleration > 100.0
    assert np.mean(block.truth.torque_nm["input"][100:250]) == pytest.approx(expected, rel=0.1)


def test_encoders_count_the_angle():
    twin = driven(make(mounting="reducer"), "input")
    twin.command_speed("input", 200.0 * RPM)
    block = twin.advance(1.0)
    for side, limit in (("input", 30.0), ("output", 5.0)):
        samples = block.angles[side]
        np.testing.assert_array_equal(samples.time_s, block.truth.time_s)
        angle = samples.counts / samples.counts_per_revolution * 2 * np.pi
        arcsec = np.degrees(angle - block.truth.angle_rad[side]) * 3600.0
        assert np.max(np.abs(arcsec)) < limit
    assert np.ptp(block.angles["input"].counts) > 2 * 360_000


def test_temperatures_have_probes_with_errors_and_the_reducer_warms():
    twin = driven(make(mounting="reducer"), "input")
    twin.set_climate(23.0)
    twin.command_speed("input", 1200.0 * RPM)
    first = twin.advance(0.5)
    for _ in range(4):
        last = twin.advance(10.0)
    assert set(last.temperatures) == {
        "ambient", "input_transducer", "output_transducer", "reducer", "calibrator"
    }  # fmt: skip
    assert last.truth.temperature_c["reducer"] > first.truth.temperature_c["reducer"] + 0.2
    for name, shown in last.temperatures.items():
        assert 0.0 < abs(shown - last.truth.temperature_c[name]) < 0.2


def test_ambient_before_the_first_block_is_where_everything_starts():
    twin = BenchTwin(NOMINAL, 1, active_channels=())
    twin.set_climate(30.0)
    assert set(np.round(list(twin.advance(0.01).truth.temperature_c.values()), 1)) == {30.0}
    twin.set_climate(10.0)
    assert min(twin.advance(1.0).truth.temperature_c.values()) > 29.5


@pytest.mark.parametrize("side", SIDES)
def test_certificate_removes_most_of_the_calibrators_error(side):
    twin = BenchTwin(NOMINAL, 1, active_channels=())
    certificate = twin.certificate(side)
    assert certificate.torque_nm.size == 101
    assert np.all(np.diff(certificate.torque_nm) > 0.0)
    path = np.linspace(-1.0, 1.0, 801) * RANGE[side]
    shown = twin.static_sweep(side, path, preload=False).reference_nm
    raw = np.max(np.abs(shown - path)) / RANGE[side]
    corrected = np.max(np.abs(certificate.correct(shown) - path)) / RANGE[side]
    assert 0.5e-4 < raw < 2.6e-4
    assert corrected < 0.9e-4
    assert corrected < 0.6 * raw
    twin.mount("verification_standard")
    shown = twin.static_sweep(side, path, preload=False).reference_nm
    assert np.max(np.abs(shown - path)) / RANGE[side] < 3e-5


def test_mounting_anew_reseats_a_little():
    twin = BenchTwin(NOMINAL, 1, active_channels=())
    path = np.linspace(0.0, 50.0, 20)
    before = twin.static_sweep("input", path).reading_nm
    twin.mount("calibrator")
    change = np.max(np.abs(twin.static_sweep("input", path).reading_nm - before)) / 50.0
    assert 0.0 < change < 1e-4


def test_option_of_240_khz():
    parameters = TwinParameters.draw("nominal", 3, carrier_hz=240e3)
    twin = driven(make(parameters=parameters, channels=["input_torque"]), "input")
    plate = twin.nameplate("input_torque")
    assert plate.nominal_zero_hz == 240e3
    assert plate.modulation_hz == (60e3, 420e3)
    twin.command_torque("input", 50.0)
    twin.advance(0.5)
    ticks = twin.advance(0.2).edges["input_torque"]
    assert counted_hz(ticks) == pytest.approx(360e3, rel=5e-3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda twin: twin.advance(0.0), "above 0 s"),
        (lambda twin: twin.advance(float("nan")), "above 0 s"),
        (lambda twin: twin.set_mode("input", "brake"), "free, driven, locked"),
        (lambda twin: twin.set_mode("left", "free"), "input, output"),
        (lambda twin: twin.mount("gearbox"), "calibrator"),
        (lambda twin: twin.command_torque("input", float("inf")), "finite"),
        (lambda twin: twin.set_active_channels(["torque"]), "input_torque"),
        (lambda twin: twin.nameplate("torque"), "input_torque"),
        (lambda twin: twin.static_sweep("input", np.zeros((2, 2))), "one dimension"),
        (lambda twin: twin.static_sweep("input", np.array([np.nan])), "finite"),
        (lambda _: BenchTwin(NOMINAL, timebase_hz=99_999_999.5), "whole multiple"),
        (lambda _: TwinParameters.draw("new"), "nominal, worn"),
        (lambda _: TwinParameters.draw("worn", -1), "at least 0"),
        (lambda _: TwinParameters.draw("worn", 1, carrier_hz=10e3), "240000"),
    ],
)
def test_nonsense_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call(BenchTwin(NOMINAL, 1, active_channels=()))


@given(
    path=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=20),
    speed=st.floats(0.0, 125.0),
    side=st.sampled_from(SIDES),
)
def test_sweep_is_made_of_the_operators(path, speed, side):
    """Fails too if Numba's cache is older than an operator: then delete twin/__pycache__/*.nb*."""
    part = getattr(NOMINAL, side)
    torque = np.array(path) * RANGE[side]
    twin = BenchTwin(NOMINAL, 1, active_channels=())
    found = twin.static_sweep(side, torque, speed_rad_s=speed, preload=False).frequency_hz
    state, silent = fresh_transducer_state(), np.zeros(NOISES)
    at_transducer = [0.0, *(transducer_torque(part.chain, true, 0.0) for true in torque)]
    expected = [
        transducer_frequency(
            part.transducer,
            transducer_signal(part.transducer, state, t, 23.0, speed, 0.0, silent)
            + RANGE[side] * signal_shift(part.turning, t / RANGE[side], 23.0, 23.0, speed),
        )
        for t in at_transducer
    ]
    np.testing.assert_allclose(found, expected[1:], rtol=1e-13)
