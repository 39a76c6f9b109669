"""Chains that turn: effects identified from empty runs, and what they state."""

from dataclasses import replace

import numpy as np
import pytest

from torquebench.chain import (
    AccelerationBySpeed,
    Component,
    EmptyRun,
    Identified,
    Inertia,
    MeasuredRotation,
    MeasuredTemperature,
    MeasuringChain,
    Readings,
    RecordedStream,
    Rotation,
    SwitchedOff,
    Temperature,
    TurningCalibration,
    Zero,
    identify,
)
from torquebench.chain.identification import tables
from torquebench.compensation import features, make_model
from torquebench.errors import InputError
from torquebench.units import RAD_S_PER_RPM

RANGE_NM = 50.0
NOISE_NM = 0.004
INERTIA = 0.002  # N·m per rad/s²
WARMTH = MeasuredTemperature(
    "empty runs",
    23.0,
    10.0,
    40.0,
    (0.0, 23.0, 50.0),
    (-0.23, 0.0, 0.27),
    (0.02, 0.0, 0.03),
    (-0.0023, 0.0, 0.0027),
    (1e-4, 0.0, 1e-4),
)
TURNING = MeasuredRotation(
    "empty runs",
    23.0,
    -1000.0,
    1000.0,
    10.0,
    40.0,
    (0.0, 100.0, 1100.0),
    (0.0, 50.0),
    ((0.0, 0.0), (0.001, 0.001), (0.01, 0.02)),
    ((0.0001, 0.0001), (0.0001, 0.0001), (0.002, 0.002)),
    ((0.01, 0.005), (0.02, 0.01), (0.03, 0.02)),
    ((0.001, 0.001), (0.001, 0.001), (0.003, 0.003)),
    (0.0, 50.0),
    ((0.0, 0.005), (0.0, 0.005), (0.0, 0.005)),
    ((0.0, 0.001), (0.0, 0.001), (0.0, 0.001)),
    running_in_s=100.0,
    running_in_nm=(0.0, 0.004, 0.004),
    running_in_uncertainty_nm=(0.0, 0.001, 0.001),
)


def chain(*effects: object) -> MeasuringChain:
    standard = np.linspace(-RANGE_NM, RANGE_NM, 41)
    noise = 0.001 * np.random.default_rng(1).standard_normal(standard.size)
    model = make_model("polynomial", range_nm=RANGE_NM).fit(features(standard + noise), standard)
    return MeasuringChain(model, tuple(effects))  # type: ignore[arg-type]


def row(reading_nm: float = 0.0, **known: object) -> Readings:
    return Readings(np.array([reading_nm]), **known)  # type: ignore[arg-type]


def part(parts: tuple[Component, ...], name: str) -> tuple[float, float]:
    found = next(each for each in parts if each.name == name)
    value, u = (np.broadcast_to(v, (1,))[0] for v in (found.value_nm, found.uncertainty_nm))
    return float(value), float(u)


def test_zero_counts_from_the_zeroing_and_span_from_the_calibration() -> None:
    torque = np.array([20.0])
    parts = WARMTH.components(row(20.0, temperature_c=50.0), torque)
    assert part(parts, "temperature of zero") == pytest.approx((-0.27, 0.03))
    assert part(parts, "temperature of span") == pytest.approx((-0.054, 0.002))
    zeroed = WARMTH.components(row(20.0, temperature_c=50.0, zero_temperature_c=50.0), torque)
    assert part(zeroed, "temperature of zero") == pytest.approx((0.0, 0.0))
    assert part(zeroed, "temperature of span") == pytest.approx((-0.054, 0.002))


def test_drag_turns_round_with_the_speed_and_the_zeros_shift_does_not() -> None:
    torque = np.array([25.0])
    late = np.array([1e9])
    ahead, back = (
        TURNING.components(row(25.0, speed_rpm=n, temperature_c=0.0, time_s=late), torque)
        for n in (600.0, -600.0)
    )
    assert part(ahead, "zero over speed")[0] == part(back, "zero over speed")[0] < 0
    assert part(ahead, "bearing drag")[0] == pytest.approx(-0.025 - 0.0025)
    assert part(back, "bearing drag")[0] == pytest.approx(+0.025 + 0.0025)
    still = TURNING.components(row(25.0, speed_rpm=0.0, temperature_c=0.0, time_s=late), torque)
    assert part(still, "bearing drag")[0] == part(still, "zero over speed")[0] == 0.0


def test_running_in_dies_away_and_counts_as_unknown_without_a_time() -> None:
    at = {"speed_rpm": 500.0, "temperature_c": 23.0}
    begin = TURNING.components(row(time_s=np.zeros(1), **at), np.zeros(1))
    assert part(begin, "running-in") == pytest.approx((-0.004, 0.001))
    later = TURNING.components(row(time_s=np.array([100.0]), **at), np.zeros(1))
    assert part(later, "running-in")[0] == pytest.approx(-0.004 / np.e)
    value, u = part(TURNING.components(row(**at), np.zeros(1)), "running-in")
    assert value == 0.0
    assert u > 0.004 / 2


@pytest.mark.parametrize(
    ("missing", "component"),
    [
        ("temperature_c", "temperature of zero"),
        ("temperature_c", "temperature of span"),
        ("speed_rpm", "bearing drag"),
        ("speed_rpm", "zero over speed"),
        ("acceleration_rad_s2", "inertia"),
    ],
)
def test_what_is_not_measured_widens(missing: str, component: str) -> None:
    turning = chain(WARMTH, TURNING, Inertia("runs", INERTIA, 1e-6, 30.0))
    known = {"temperature_c": 23.0, "speed_rpm": 0.0, "acceleration_rad_s2": 0.0}
    knowing = turning.torque(row(10.0, **known))
    blind = turning.torque(row(10.0, **{**known, missing: None}))
    nan = turning.torque(row(10.0, **{**known, missing: np.array([np.nan])}))
    assert blind.component(component)[0] > 2.0 * knowing.component(component)[0]
    assert nan.component(component) == pytest.approx(blind.component(component))
    assert np.isfinite(blind.value_nm).all()
    assert missing in turning.unmeasured(row(10.0, **{**known, missing: None}))


@pytest.mark.parametrize("name", ["zero over speed", "bearing drag", "lubrication", "running-in"])
def test_an_unknown_speed_counts_with_everything_that_rotation_may_add(name: str) -> None:
    torque, time_s = np.array([10.0]), np.zeros(1)
    known = {"temperature_c": 23.0, "time_s": time_s}
    blind = part(TURNING.components(row(10.0, **known), torque), name)
    assert blind[0] == 0.0
    for speed in np.linspace(-1000.0, 1000.0, 9):
        added, u = part(TURNING.components(row(10.0, speed_rpm=speed, **known), torque), name)
        assert blind[1] >= np.hypot(added / 3.0**0.5, u) - 1e-12


@pytest.mark.parametrize(
    ("known", "message"),
    [
        ({"temperature_c": 51.0}, "row 0: temperature of zero and span, measured: .*51 °C"),
        ({"speed_rpm": -1101.0}, "row 0: rotation, measured: speed -1101 1/min"),
        ({"speed_rpm": 10.0, "temperature_c": -1.0}, "temperature -1 °C"),
    ],
)
def test_a_reading_beyond_an_effects_record_is_refused_by_the_effects_name(
    known: dict[str, float], message: str
) -> None:
    turning = chain(WARMTH, TURNING)
    with pytest.raises(InputError, match=message):
        turning.torque(row(10.0, **{"temperature_c": 20.0, "speed_rpm": 0.0, **known}))


def test_a_zero_that_shifted_does_not_make_the_range_end() -> None:
    turning = chain(WARMTH)
    low, high = turning.curve.low_nm, turning.curve.high_nm
    warm = turning.torque(row(high + 0.2, temperature_c=50.0))
    assert abs(warm.value_nm[0] - high) < 0.3
    with pytest.raises(InputError, match="outside the calibrated range"):
        turning.torque(row(low - 0.1, temperature_c=50.0))


def test_what_was_measured_takes_the_place_of_limits() -> None:
    limits = (Temperature("data sheet", 0.01, 1e-5), Rotation("data sheet", 0.1, 0.1, 1000.0))
    assert {"rotation", "temperature"} <= {each.kind for each in chain(*limits).effects}
    measured = chain(*limits, WARMTH, TURNING)
    kinds = {each.kind for each in measured.effects}
    assert {"rotation", "temperature"}.isdisjoint(kinds)
    assert not {"temperature of zero and span", "rotation"} & set(measured.missing())
    bare = replace(WARMTH, span=(), span_uncertainty=())
    assert "temperature of span" in chain(bare).missing()


def test_a_switch_leaves_the_value_out_and_its_size_in_u() -> None:
    known = {"temperature_c": 45.0, "speed_rpm": 0.0}
    whole = chain(WARMTH, TURNING).torque(row(10.0, **known))
    off = chain(WARMTH, TURNING, SwitchedOff.of("a person", "temperature")).torque(
        row(10.0, **known)
    )
    assert off.added("temperature of zero")[0] == off.added("temperature of span")[0] == 0.0
    size = abs(whole.added("temperature of zero")[0]) / np.sqrt(3.0)
    assert off.component("temperature of zero")[0] > size
    with pytest.raises(InputError, match="hysteresis, temperature, rotation, inertia"):
        SwitchedOff.of("a person", "weather")


# --- acceleration and records ---


def test_acceleration_does_not_depend_on_where_a_record_is_cut() -> None:
    time_s = 0.02 * np.arange(400)
    speed = 300.0 * np.sin(time_s) + 0.2 * np.random.default_rng(3).standard_normal(time_s.size)
    by_speed = AccelerationBySpeed.of(time_s, speed)
    assert by_speed.half_width > 1  # noise asks for more samples
    slope, u = by_speed(time_s, speed)
    truth = 300.0 * np.cos(time_s) * RAD_S_PER_RPM
    assert np.sqrt(np.mean((slope - truth)[20:-20] ** 2)) < 0.5
    assert np.mean(np.abs(slope - truth) <= 2.0 * u + 0.05) > 0.9
    reach = by_speed.context
    middle = slice(150 - reach, 250 + reach)
    part_slope, part_u = by_speed(time_s[middle], speed[middle])
    assert part_slope[reach:-reach].tolist() == slope[150:250].tolist()
    assert part_u[reach:-reach].tolist() == u[150:250].tolist()


def test_a_gap_is_no_ramp() -> None:
    time_s = np.concatenate([np.arange(50), 500.0 + np.arange(50)]) * 0.1
    speed = np.repeat([0.0, 1000.0], 50)
    slope, _ = AccelerationBySpeed(2, 0.0, 0.1)(time_s, speed)
    assert not slope.any()


@pytest.mark.parametrize("branch", [True, False])
@pytest.mark.parametrize("kind", ["hybrid", "polynomial"])
def test_the_live_stream_equals_the_files_to_the_last_digit(kind: str, *, branch: bool) -> None:
    share = np.concatenate([np.linspace(0, 1, 15), np.linspace(1, -1, 30), np.linspace(-1, 0, 15)])
    up = np.where(np.gradient(np.abs(share)) >= 0, 1.0, -1.0)
    standard = RANGE_NM * share
    reading = standard - 0.02 * up * np.sign(share) * (1 - share**2) + 0.1 * share**2
    model = make_model(kind, range_nm=RANGE_NM)
    model.fit(features(reading, up if kind == "hybrid" else None), standard)
    turning = MeasuringChain(model, (WARMTH, TURNING, Inertia("runs", INERTIA, 1e-6, 30.0)))
    time_s = 0.02 * np.arange(500)
    record = Readings(
        40.0 * np.sin(0.7 * time_s),
        branch=np.where(np.sin(1.4 * time_s) >= 0, 1.0, -1.0) if branch else None,
        time_s=time_s,
        speed_rpm=900.0 * np.sin(time_s),
        temperature_c=25.0 + time_s,
    )
    by_speed = AccelerationBySpeed(2, 0.1, 0.02)
    whole = RecordedStream(turning, by_speed).torque(record, None)
    known = RecordedStream(turning, by_speed).completed(record, None)
    live, recorded = turning.stream(), RecordedStream(turning, by_speed)
    names = ("reading_nm", "branch", "time_s", "speed_rpm", "temperature_c",
             "acceleration_rad_s2", "acceleration_uncertainty_rad_s2")  # fmt: skip

    def block(of: Readings, rows: slice) -> Readings:
        values = {name: getattr(of, name) for name in names}
        return Readings(**{n: None if v is None else v[rows] for n, v in values.items()})

    cuts = [0, 100, 137, 300, 500]
    for start, stop, end in zip(cuts, cuts[1:], [*cuts[2:], None], strict=False):
        rows = slice(start, stop)
        pushed = live.push(block(known, rows))
        following = None if end is None else block(record, slice(stop, end))
        read = recorded.torque(block(record, rows), following)
        # live, nobody states a branch: it follows from the readings
        for part_torque in (read,) if branch else (pushed, read):
            assert part_torque.value_nm.tolist() == whole.value_nm[rows].tolist()
            u = whole.expanded_uncertainty_nm[rows]
            assert part_torque.expanded_uncertainty_nm.tolist() == u.tolist()


# --- identification ---


def zero_shift(celsius: np.ndarray) -> np.ndarray:
    warm = celsius - 23.0
    return np.asarray(0.003 * warm + 2e-5 * warm**2)


def drag(speed: np.ndarray, celsius: np.ndarray) -> np.ndarray:
    size = 0.02 + 0.03 * np.abs(speed) / 1000.0 * np.exp(-0.02 * (celsius - 23.0))
    return np.asarray(np.where(np.abs(speed) > 0.5, np.sign(speed), 0.0) * size)


def empty_run(
    celsius: float, seed: int = 0, largest: float = 1000.0, least: float = -1.0
) -> EmptyRun:
    time_s = 0.1 * np.arange(900)
    steps = np.array([0, 0.1, 0.3, 0.6, 1, 1, 0.5, 0, -0.1, -0.3, -0.6, -1, -1, -0.5, 0, 0])
    share = np.interp(time_s, np.linspace(0.0, 90.0, steps.size), np.maximum(steps, least))
    speed = largest * share
    reading = zero_shift(np.full(900, celsius)) + drag(speed, celsius + 0 * speed)
    reading = reading + INERTIA * RAD_S_PER_RPM * np.gradient(speed, time_s)
    noise = NOISE_NM * np.random.default_rng(seed).standard_normal(900)
    return EmptyRun(f"{celsius:g}.csv", time_s, reading + noise, speed, np.full(900, celsius))


def calibration(
    points: int = 24, celsius: tuple[float, ...] = (23.0, 12.0, 38.0)
) -> TurningCalibration:
    share = np.concatenate([np.linspace(0.05, 1, points // 4), np.linspace(1, 0.05, points // 4)])
    share = np.tile(np.concatenate([share, -share]), len(celsius))
    warm = np.repeat(celsius, share.size // len(celsius))
    branch = np.tile(np.repeat([1.0, -1.0, 1.0, -1.0], points // 4), len(celsius))
    standard = RANGE_NM * share
    reading = standard * (1.0 + 1e-4 * (warm - 23.0)) + zero_shift(warm) - 0.05 * share**2
    noise = NOISE_NM * np.random.default_rng(9).standard_normal(share.size)
    return TurningCalibration(reading + noise, standard, branch, np.zeros(share.size), warm)


@pytest.fixture(scope="module")
def identified() -> Identified:
    runs = [empty_run(celsius, number) for number, celsius in enumerate((12.0, 23.0, 38.0))]
    return identify(calibration(), runs, RANGE_NM)


def test_what_the_runs_contain_is_found(identified: Identified) -> None:
    warm, turning, inertia = identified.effects
    assert isinstance(warm, MeasuredTemperature)
    assert isinstance(turning, MeasuredRotation)
    assert isinstance(inertia, Inertia)
    assert inertia.moment_nm_s2 == pytest.approx(INERTIA, abs=3 * inertia.uncertainty_nm_s2 + 2e-5)
    for celsius in (12.0, 30.0, 45.0):
        known = row(temperature_c=celsius)
        value, u = part(warm.components(known, np.array([RANGE_NM])), "temperature of zero")
        assert value == pytest.approx(-zero_shift(np.array([celsius]))[0], abs=3 * u + 2e-4)
        value, u = part(warm.components(known, np.array([RANGE_NM])), "temperature of span")
        assert value == pytest.approx(-RANGE_NM * 1e-4 * (celsius - 23.0), abs=3 * u + 1e-3)
    for speed in (-800.0, -200.0, 300.0, 1000.0):
        known = row(speed_rpm=speed, temperature_c=30.0, time_s=np.array([1e9]))
        value, u = part(turning.components(known, np.zeros(1)), "bearing drag")
        truth = drag(np.array([speed]), np.array([30.0]))[0]
        assert value == pytest.approx(-truth, abs=0.003)
        assert abs(u) < 0.003
    assert any("rotating reference" in each for each in identified.remarks)


def test_points_at_other_temperatures_serve_the_static_curve(identified: Identified) -> None:
    points = calibration()
    truth = points.standard_nm - 0.05 * (points.standard_nm / RANGE_NM) ** 2
    assert np.std(identified.corrected_nm - truth) < 1.3 * NOISE_NM
    assert np.unique(identified.series).size == 3


def test_uncertainty_grows_beyond_what_was_measured(identified: Identified) -> None:
    warm = identified.effects[0]
    assert isinstance(warm, MeasuredTemperature)
    inside, outside = (
        part(warm.components(row(temperature_c=t), np.zeros(1)), "temperature of zero")[1]
        for t in (37.0, 52.0)
    )
    assert outside > 3.0 * inside


@pytest.mark.nightly
def test_a_long_run_is_averaged_and_tells_the_same(
    identified: Identified, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tables, "_MOST_ROWS", 300)  # three samples together
    runs = [empty_run(celsius, number) for number, celsius in enumerate((12.0, 23.0, 38.0))]
    short = identify(calibration(), runs, RANGE_NM)
    warm, of_all = short.effects[0], identified.effects[0]
    assert isinstance(warm, MeasuredTemperature)
    assert isinstance(of_all, MeasuredTemperature)
    assert warm.zero_nm == pytest.approx(of_all.zero_nm, abs=0.01)


def test_a_run_that_says_nothing_is_refused() -> None:
    still = empty_run(23.0, largest=0.0)
    with pytest.raises(InputError, match="one speed, one temperature and without a ramp"):
        identify(calibration(celsius=(23.0,)), [still], RANGE_NM)


def test_a_calibration_without_temperature_cant_be_related_to_warm_and_cold_runs() -> None:
    points = replace(calibration(), temperature_c=None)
    with pytest.raises(InputError, match="calibration without temperature_c"):
        identify(points, [empty_run(12.0), empty_run(38.0)], RANGE_NM)


def test_what_cant_be_identified_is_named_with_what_would_do_it() -> None:
    one_way = empty_run(23.0, least=0.0)
    found = identify(calibration(celsius=(23.0,)), [one_way], RANGE_NM)
    text = " ".join(found.remarks)
    assert "an empty run at another temperature" in text
    assert "the empty run has one direction only" in text
    assert [each.kind for each in found.effects] == ["measured rotation", "inertia"]
    turning = found.effects[0]
    with pytest.raises(InputError, match="rotation, measured: speed -500"):
        chain(turning).torque(row(speed_rpm=-500.0, temperature_c=23.0))


def test_runs_with_zeros_of_their_own_are_put_together_by_their_frequencies() -> None:
    """Each run of the bench begins with a zero at its own temperature."""
    runs = []
    for number, celsius in enumerate((12.0, 23.0, 38.0)):
        run, zero = empty_run(celsius, number), float(zero_shift(np.array([celsius]))[0])
        runs.append(replace(run, reading_nm=run.reading_nm - zero, zero_nm=0.4 + zero))
    found = identify(calibration(), runs, RANGE_NM).effects[0]
    assert isinstance(found, MeasuredTemperature)
    value = part(found.components(row(temperature_c=35.0), np.zeros(1)), "temperature of zero")[0]
    assert value == pytest.approx(-zero_shift(np.array([35.0]))[0], abs=0.003)
    with pytest.raises(InputError, match="doesn't"):
        identify(calibration(), [runs[0], replace(runs[1], zero_nm=None)], RANGE_NM)


def test_points_count_from_the_zero_that_was_taken_before_them() -> None:
    points = calibration()
    assert points.temperature_c is not None
    zeroed = replace(
        points,
        reading_nm=points.reading_nm - zero_shift(points.temperature_c),
        zero_temperature_c=points.temperature_c,
    )
    runs = [empty_run(celsius, number) for number, celsius in enumerate((12.0, 23.0, 38.0))]
    found = identify(zeroed, runs, RANGE_NM)
    truth = points.standard_nm - 0.05 * (points.standard_nm / RANGE_NM) ** 2
    assert np.std(found.corrected_nm - truth) < 1.3 * NOISE_NM
    warm = found.effects[0].components(row(temperature_c=35.0), np.zeros(1))
    assert part(warm, "temperature of zero")[0] == pytest.approx(
        -zero_shift(np.array([35.0]))[0], abs=0.003
    )


SEATED_NM = (0.02, -0.01, -0.025, 0.015, -0.02, 0.01)
"""By how much six zeros, of three series and three runs, are off: the parts seat anew each time."""


def seated(stated: bool) -> tuple[TurningCalibration, list[EmptyRun]]:
    """Return points and runs that each begin with a zero of their own."""
    points, celsius = calibration(), (23.0, 12.0, 38.0)
    warm = np.array(celsius)
    zeros = zero_shift(warm) + SEATED_NM[:3]
    of_point = np.repeat(zeros, points.reading_nm.size // 3)
    runs = []
    for number, (at, off) in enumerate(zip(celsius, SEATED_NM[3:], strict=True)):
        run, zero = empty_run(at, number), float(zero_shift(np.array([at]))[0]) + off
        runs.append(replace(run, reading_nm=run.reading_nm - zero, zero_nm=0.4 + zero))
    return replace(
        points,
        reading_nm=points.reading_nm - of_point,
        zero_temperature_c=points.temperature_c,
        zero_nm=0.4 + of_point if stated else None,
    ), runs


def test_many_points_tell_the_zero_over_temperature_and_a_single_zero_scatters() -> None:
    found = identify(*seated(stated=True), RANGE_NM)
    warm, zero = found.effects[0], found.effects[-1]
    assert isinstance(zero, Zero)
    scatter = float(np.std(SEATED_NM, ddof=1))
    assert scatter < zero.zero_nm < 2.0 * scatter
    errors = [
        part(warm.components(row(temperature_c=at), np.zeros(1)), "temperature of zero")[0]
        + zero_shift(np.array([at]))[0]
        for at in (12.0, 38.0)
    ]
    assert np.max(np.abs(errors)) < 0.005
    # readings count from a zero as it usually is, not from that of one series
    points = calibration()
    truth = points.standard_nm - 0.05 * (points.standard_nm / RANGE_NM) ** 2
    usual = float(np.mean(SEATED_NM))
    assert np.mean(found.corrected_nm - truth) == pytest.approx(-usual, abs=0.002)
    assert np.std(found.corrected_nm - truth) < 1.3 * NOISE_NM


def unloaded(points: TurningCalibration, left_nm: tuple[float, ...]) -> TurningCalibration:
    """Return points with an unloaded one after each direction, at which the chain still reads."""
    assert points.zero_nm is not None
    assert points.temperature_c is not None
    each = points.standard_nm.size // 3
    at = np.concatenate([each * k + each // 2 * (1 + np.arange(len(left_nm))) for k in range(3)])
    warm, zero = points.temperature_c[at - 1], points.zero_nm[at - 1]
    reading = np.tile(left_nm, 3) + zero_shift(warm) - (zero - 0.4)
    added = {
        "reading_nm": reading,
        "standard_nm": 0.0,
        "branch": -1.0,
        "speed_rpm": 0.0,
        "temperature_c": warm,
        "zero_temperature_c": warm,
        "zero_nm": zero,
    }
    columns = {name: np.insert(getattr(points, name), at, value) for name, value in added.items()}
    nothing = np.insert(np.zeros(points.standard_nm.size, dtype=bool), at, True)
    return replace(points, **columns, unloaded=nothing)


@pytest.mark.nightly
def test_a_zero_in_use_follows_an_unloading_from_either_direction() -> None:
    points, runs = seated(stated=True)

    def zero(left_nm: tuple[float, ...]) -> float:
        found = identify(unloaded(points, left_nm), runs, RANGE_NM).effects[-1]
        assert isinstance(found, Zero)
        return found.zero_nm

    scatter = zero((0.0, 0.0))
    assert scatter < 2.0 * float(np.std(SEATED_NM, ddof=1))
    assert zero((0.06, -0.04)) == pytest.approx(np.hypot(scatter, 0.05), rel=0.05)
    assert zero((0.06,)) < 1.2 * scatter  # one direction tells no difference


def test_zeros_that_tables_dont_state_have_no_scatter() -> None:
    effects = identify(*seated(stated=False), RANGE_NM).effects
    assert not any(isinstance(each, Zero) for each in effects)


def test_points_of_too_few_speeds_stay_as_they_were_read() -> None:
    points, _ = seated(stated=True)
    at_once = replace(
        points,
        temperature_c=np.full(points.reading_nm.size, 23.0),
        zero_temperature_c=None,
        speed_rpm=np.full(points.reading_nm.size, 500.0),
    )
    found = identify(at_once, [], RANGE_NM)
    assert found.effects == ()
    np.testing.assert_array_equal(found.corrected_nm, points.reading_nm)


def test_points_alone_tell_the_temperature_and_what_else_would_is_named() -> None:
    found = identify(calibration(points=48), [], RANGE_NM)
    (warm,) = found.effects
    assert isinstance(warm, MeasuredTemperature)
    span = part(
        warm.components(row(temperature_c=35.0), np.array([RANGE_NM])), "temperature of span"
    )
    assert span[0] == pytest.approx(-RANGE_NM * 1e-4 * 12.0, abs=3 * span[1] + 1e-3)
    text = " ".join(found.remarks)
    assert "an empty run over all working speeds" in text
    assert "an empty run with ramps" in text


def test_ripple_within_a_revolution_is_in_u_of_single_readings() -> None:
    runs = [empty_run(celsius, number) for number, celsius in enumerate((12.0, 23.0, 38.0))]
    rippled = [
        replace(
            run,
            reading_nm=run.reading_nm
            + 0.03 * (run.speed_rpm / 1000.0) ** 2 * np.sin(40.0 * np.arange(len(run)) ** 1.1),
        )
        for run in runs
    ]
    turning = identify(calibration(), rippled, RANGE_NM).effects[1]
    fast, slow = (
        part(
            turning.components(row(speed_rpm=n, temperature_c=23.0), np.zeros(1)),
            "noise in a window",
        )[1]
        for n in (1000.0, 100.0)
    )
    assert fast == pytest.approx(0.03 / np.sqrt(2.0), rel=0.3)
    assert slow < 0.3 * fast


def wandering_run(celsius: float, seed: int) -> EmptyRun:
    """Return a run that turning warms a little, while its own zero wanders by 2e-4 of full scale.

    It counts from a zero that was taken at its beginning, as the bench does.
    """
    generator = np.random.default_rng([seed, round(celsius)])
    time_s = 0.05 * np.arange(2600)
    warm = celsius + 0.35 * time_s / time_s[-1]
    steps = np.array([0, 0.1, 0.3, 0.6, 1, 1, 0.5, 0, -0.1, -0.3, -0.6, -1, -1, -0.5, 0, 0])
    speed = 1000.0 * np.interp(time_s, np.linspace(0.0, time_s[-1], steps.size), steps)
    zero = float(zero_shift(np.array([celsius]))[0])
    pace = generator.choice([-1.0, 1.0]) * generator.uniform(0.5, 1.0)
    wander = 2e-4 * RANGE_NM * pace * time_s / time_s[-1]
    reading = zero_shift(warm) - zero + wander + drag(speed, warm)
    reading = reading + INERTIA * RAD_S_PER_RPM * np.gradient(speed, time_s)
    reading = reading + 0.25 * NOISE_NM * generator.standard_normal(time_s.size)
    return EmptyRun(f"{celsius:g}.csv", time_s, reading, speed, warm, None, zero)


def test_a_zero_that_wanders_within_runs_is_no_steep_change_over_temperature() -> None:
    runs = [wandering_run(celsius, seed=2) for celsius in (12.0, 23.0, 35.0, 48.0)]
    warm = identify(calibration(celsius=(23.0, 12.0, 35.0, 48.0)), runs, RANGE_NM).effects[0]
    for celsius in (10.0, 17.0, 29.0, 41.0, 50.0):
        known = row(temperature_c=celsius)
        value, u = part(warm.components(known, np.zeros(1)), "temperature of zero")
        error = abs(value + zero_shift(np.array([celsius]))[0])
        assert error <= max(3.0 * u, 5e-5 * RANGE_NM)
        assert u < 1e-4 * RANGE_NM


@pytest.mark.nightly
def test_inertia_is_in_doubt_by_what_the_chain_reads_of_small_torques() -> None:
    """A step at the reversal takes a part of a torque of that size, and nothing of a large one."""
    points = calibration(points=96)
    stepped = replace(
        points, reading_nm=points.reading_nm - 0.1 * np.tanh(points.standard_nm / 0.4)
    )
    runs = [empty_run(celsius, number) for number, celsius in enumerate((12.0, 23.0, 38.0))]
    doubt = [
        next(e for e in identify(each, runs, RANGE_NM).effects if isinstance(e, Inertia))
        for each in (points, stepped)
    ]
    assert doubt[1].uncertainty_nm_s2 > 4.0 * doubt[0].uncertainty_nm_s2
    assert 0.03 < doubt[1].uncertainty_nm_s2 / doubt[1].moment_nm_s2 < 0.3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[::-1], "rising times"),
        (lambda t: t**1.5, "an even rate"),
        (lambda t: t[:10], "at least 20"),
    ],
)
def test_times_of_an_empty_run(change: object, message: str) -> None:
    time_s = change(np.arange(100.0))  # type: ignore[operator]
    with pytest.raises(InputError, match=message):
        EmptyRun("a.csv", time_s, *(np.zeros(time_s.size) for _ in range(3)))
