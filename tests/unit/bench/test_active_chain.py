import gc
import sys
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from tests.streamed import streamed

from torquebench.bench.active_chain import ActiveChain, ZeroTaken
from torquebench.chain import (
    Counter,
    Dynamics,
    Effect,
    Inertia,
    MeasuredRotation,
    MeasuredTemperature,
    MeasuringChain,
    Mounting,
    Reference,
    Temperature,
    Torque,
    Zero,
    joined,
)
from torquebench.compensation import (
    MODEL_NAMES,
    MODELS,
    CompensationModel,
    features,
    make_model,
)
from torquebench.dynamics import TransferFunction, design_inverse
from torquebench.signals import Record
from torquebench.uncertainty import CertifiedUncertainty

FULL_SCALE_NM = 300.0
SINGLE_CURVE = ["bayesian-network", "polynomial", "radial-basis"]
WITH_BRANCHES = ["hybrid"]


def fitted(kind: str) -> CompensationModel:
    draw = np.random.default_rng(5)
    half = np.linspace(-FULL_SCALE_NM, FULL_SCALE_NM, 31)
    reading = np.concatenate((half, half[::-1]))
    branch = np.where(np.diff(np.abs(reading), append=FULL_SCALE_NM) > 0.0, 1, -1)
    extra = 1e-3 * reading + 0.6 * (reading / FULL_SCALE_NM) ** 2 + 0.05 * branch
    standard = reading + extra + draw.normal(0.0, 0.02, reading.size)
    return make_model(kind, range_nm=FULL_SCALE_NM).fit(features(reading, branch), standard)


@cache
def chain_of(model: CompensationModel) -> MeasuringChain:
    """A chain never changes: its table is computed once for all tests."""
    return MeasuringChain(model)


def active_chain(model: CompensationModel) -> ActiveChain:
    return ActiveChain(chain_of(model), "1", model.kind)


class Stream:
    """Windows of 1 ms one behind the other."""

    def __init__(self, active: ActiveChain) -> None:
        self.active, self.stop_s = active, 0.0

    def push(self, reading_nm: np.ndarray, gap_s: float = 0.0, **known: float) -> Torque:
        time_s = self.stop_s + gap_s + 1e-3 * np.arange(1, reading_nm.size + 1)
        self.stop_s = float(time_s[-1]) if time_s.size else self.stop_s
        return streamed(self.active, time_s, reading_nm, **known)


@pytest.mark.parametrize("kind", SINGLE_CURVE)
def test_live_windows_get_what_the_model_says(kind: str) -> None:
    assert kind in MODEL_NAMES
    model = fitted(kind)
    active = active_chain(model)
    reading = np.random.default_rng(1).uniform(-FULL_SCALE_NM, FULL_SCALE_NM, 200)
    reading[0] = 0.0
    found = Stream(active).push(reading)
    rows = features(reading, 0, 0, 3.0, 23.0)[:, : model.n_features_in_]
    torque_nm, uncertainty_nm = model.predict(rows, return_std=True)
    allowed = 1e-6 * FULL_SCALE_NM
    np.testing.assert_allclose(found.value_nm, torque_nm, rtol=0.0, atol=allowed)
    np.testing.assert_allclose(found.component("static curve"), uncertainty_nm, 0.0, allowed)
    kept = active.window(0.0, 1.0)
    assert kept is not None
    np.testing.assert_array_equal(kept[1].value_nm, found.value_nm)
    np.testing.assert_array_equal(kept[1].standard_uncertainty_nm, found.standard_uncertainty_nm)


def all_effects() -> tuple[Effect, ...]:
    speeds, celsius = (0.0, 1200.0), (10.0, 40.0)
    table, small = ((0.0, 0.0), (0.1, 0.2)), ((0.01, 0.01), (0.01, 0.01))
    return (
        MeasuredTemperature("runs", 23.0, 10.0, 40.0, celsius, (0.0, 0.3), (0.01, 0.01)),
        MeasuredRotation(
            "runs", 23.0, -1200.0, 1200.0, 10.0, 40.0, speeds, celsius, table, small, table, small,
            noise_nm=(0.01, 0.02), window_s=1e-3,
        ),
        Inertia("ramps", 0.0025, 0.00002, largest_rad_s2=300.0),
        Dynamics("steps", 1e-3, late_s=1e-3),
        Reference("certificate", CertifiedUncertainty.flat(0.06, 6.0, FULL_SCALE_NM)),
        Counter("counter", 0.001),
        Zero("description", 0.01, 4.0),
        Mounting("three positions", 0.01),
    )  # fmt: skip


def test_a_window_of_a_chain_with_all_effects_needs_few_calls() -> None:
    """Formulas take a single window as floats: the live path consists of such windows."""
    active = ActiveChain(MeasuringChain(loop_model("hybrid"), all_effects()), "1", "hybrid")
    active.zero = ZeroTaken(0.0, 23.0, 0.03)
    known = {
        "speed_rpm": 600.0,
        "temperature_c": 25.0,
        "acceleration_rad_s2": 31.4,
        "acceleration_uncertainty_rad_s2": 2.0,
    }

    def window(number: int) -> tuple[Record, dict[str, float], float]:
        columns = {"time_s": 1e-3 * number, "reading_nm": 10.0, "counter_nm": 1e-3}
        record = Record({name: np.array([value]) for name, value in columns.items()})
        return record, known, 1e-3 * number

    for number in range(1, 5):
        active.push(*window(number))
    last = window(5)
    calls = []
    sys.setprofile(lambda frame, event, _: calls.append(frame) if event == "call" else None)
    try:
        torque = active.push(*last)
    finally:
        sys.setprofile(None)
    assert torque.has_number.all()
    assert len({each.name for each in torque.components}) > 12
    assert len(calls) < 210


def test_what_is_remembered_is_nothing_for_the_garbage_collection_to_walk_through() -> None:
    stream = Stream(active_chain(loop_model("hybrid")))
    pieces = [stream.push(np.full(3, 0.1 * FULL_SCALE_NM)) for _ in range(10)]
    gc.collect()
    before = len(gc.get_objects())
    pieces += [stream.push(np.full(3, 0.1 * FULL_SCALE_NM)) for _ in range(200)]
    expected = joined(pieces)
    del pieces
    gc.collect()
    assert len(gc.get_objects()) - before < 200
    kept = stream.active.window(0.0, 10.0)
    assert kept is not None
    np.testing.assert_array_equal(kept[1].value_nm, expected.value_nm)
    for one, other in zip(kept[1].components, expected.components, strict=True):
        assert (one.name, one.shared, one.distribution) == (
            other.name,
            other.shared,
            other.distribution,
        )
        np.testing.assert_array_equal(one.uncertainty_nm, other.uncertainty_nm)
        np.testing.assert_array_equal(one.value_nm, other.value_nm)
        assert (one.place is None) == (other.place is None)
        if one.place is not None and other.place is not None:
            np.testing.assert_array_equal(one.place, other.place)


def test_the_zeros_age_and_temperature_count_in_the_stream() -> None:
    effects = (Zero("drift", 1.0), Temperature("data sheet", 0.1, 0.0, 23.0))
    active = ActiveChain(MeasuringChain(fitted("polynomial"), effects), "1", "polynomial")
    unknown = Stream(active).push(np.zeros(3), temperature_c=25.0)
    active.zero = ZeroTaken(0.0, 25.0, 0.0)
    known = Stream(active).push(np.zeros(3), temperature_c=25.0)
    for name in ("zero drift", "temperature of zero"):
        assert known.component(name)[0] < 0.2 * unknown.component(name)[0]
    hour = streamed(active, [3600.0], [0.0], temperature_c=35.0)
    assert hour.component("zero drift")[0] == pytest.approx(1.0 / np.sqrt(3.0))
    assert hour.component("temperature of zero")[0] == pytest.approx(1.0 / np.sqrt(3.0), rel=0.01)


def test_the_standard_error_of_the_zero_counts_in_the_stream() -> None:
    """It was dropped where a zero was taken, and U of the live torque didn't contain it."""
    effects = (Zero("zeros of the tables", 0.0, zero_nm=0.04),)
    active = ActiveChain(MeasuringChain(fitted("polynomial"), effects), "1", "polynomial")
    assert Stream(active).push(np.zeros(3)).component("zero") == pytest.approx(0.04)
    active.zero = ZeroTaken(0.0, 23.0, 0.03)
    assert Stream(active).push(np.zeros(3)).component("zero") == pytest.approx(0.05)


def test_short_windows_have_a_stream_of_their_own_that_starts_where_the_other_stands() -> None:
    active = active_chain(loop_model("hybrid"))
    stream = Stream(active)
    stream.push(ramp(0.0, 1.0, 0.0, 0.5))
    time_s = stream.stop_s + 1e-4 * np.arange(1, 6)
    reading = np.full(5, 0.5 * FULL_SCALE_NM)
    streamed(active, time_s, reading, fine=True, speed_rpm=0.0, temperature_c=23.0)
    rising = stream.push(np.full(3, 0.5 * FULL_SCALE_NM))
    fine = active.fine_window(0.0, 10.0)
    assert fine is not None
    assert fine[1].value_nm == pytest.approx(rising.value_nm[0])
    active.end_fine()
    assert active.fine_window(0.0, 10.0) is None


@cache
def loop_model(kind: str) -> CompensationModel:
    """A chain whose loop is ten times its noise, calibrated up and down in both directions."""
    draw, steps = np.random.default_rng(6), 13
    size = np.concatenate((np.linspace(0.04, 1.0, steps), np.linspace(0.98, 0.02, steps)))
    side, up = np.repeat([1.0, -1.0], 2 * steps), np.tile(np.repeat([1.0, -1.0], steps), 2)
    u = side * np.tile(size, 2)
    extra = 1e-3 * u + 2e-3 * u * np.abs(u) + side * up * LOOP * (1.0 - np.abs(u))
    reading = FULL_SCALE_NM * u
    standard = reading + FULL_SCALE_NM * (extra + draw.normal(0.0, 1e-4, u.size))
    model = make_model(kind, range_nm=FULL_SCALE_NM)
    return model.fit(features(reading, up, np.where(side > 0, 1, 2)), standard)


LOOP = 1e-3


def ramp(*turning_points: float) -> np.ndarray:
    legs = [np.linspace(start, stop, 200) for start, stop in pairwise(turning_points)]
    return FULL_SCALE_NM * np.concatenate(legs)


@pytest.mark.parametrize("kind", WITH_BRANCHES)
def test_the_branch_of_live_windows_follows_from_those_before(kind: str) -> None:
    model = loop_model(kind)
    stream = Stream(active_chain(model))
    path = ramp(0.0, 1.0, 0.0, 1.0, 0.0)
    live = joined([stream.push(block) for block in np.array_split(path, 80)])
    std = np.hypot(live.component("static curve"), live.component("hysteresis"))
    for leg, branch in ((2, 1), (3, -1)):
        middle = slice(200 * leg + 60, 200 * leg + 140)
        rows = features(path[middle], branch, 1)[:, : model.n_features_in_]
        expected, own_std = model.predict(rows, return_std=True)
        wrong = model.predict(features(path[middle], -branch, 1)[:, : model.n_features_in_])
        away = np.abs(live.value_nm[middle] - expected)
        assert np.max(away / np.abs(wrong - expected)) < 0.25
        assert np.median(std[middle]) < 2.0 * np.median(own_std)
    assert std[1] > 1.5 * std[401]  # nothing was known of the past


def test_a_fault_a_gap_and_the_start_make_the_past_unknown() -> None:
    path = ramp(0.0, 1.0, 0.0, 1.0, 0.5)
    here = path[-1:].repeat(10)

    def after(reading: np.ndarray, gap_s: float = 0.0) -> Torque:
        stream = Stream(active_chain(loop_model("hybrid")))
        stream.push(path)
        return stream.push(reading, gap_s)

    quiet = after(here).component("hysteresis")
    after_gap = after(here, 1.0).component("hysteresis")
    broken = here.copy()
    broken[4] = np.nan
    after_fault = after(broken)
    at_start = Stream(active_chain(loop_model("hybrid"))).push(here).component("hysteresis")
    assert np.all(after_gap > 1.5 * quiet)
    np.testing.assert_allclose(after_gap, at_start)
    np.testing.assert_allclose(after_fault.component("hysteresis")[:4], quiet[:4])
    assert np.isnan(after_fault.value_nm[4])
    assert np.all(after_fault.component("hysteresis")[5:] > 1.5 * quiet[5:])


def test_a_standing_torque_is_taken_where_the_stream_stands_and_moves_nothing() -> None:
    active = active_chain(loop_model("hybrid"))
    unknown = active.standing()
    stream = Stream(active)
    stream.push(ramp(0.0, 1.0, 0.001))
    falling = active.standing()
    assert falling.value_nm == active.standing().value_nm
    stream.push(ramp(0.001, -1.0, -0.001))
    rising = active.standing()
    assert abs(rising.value_nm[0] - falling.value_nm[0]) == pytest.approx(
        2.0 * LOOP * FULL_SCALE_NM, rel=0.5
    )
    assert unknown.component("hysteresis")[0] > falling.component("hysteresis")[0]
    assert len(stream.push(np.zeros(0))) == 0


def test_faults_and_readings_beyond_the_range_get_no_number() -> None:
    stream = Stream(active_chain(fitted("polynomial")))
    found = stream.push(np.array([np.nan, 10.0, 2.0 * FULL_SCALE_NM, -np.inf]))
    for values in (found.value_nm, found.standard_uncertainty_nm):
        assert np.isnan(values).tolist() == [True, False, True, True]


class Warm(MODELS["polynomial"]):  # type: ignore[name-defined,misc]
    """A model that looks at the temperature."""

    used_features = ("reading_nm", "temperature_c")


class Stepped(MODELS["polynomial"]):  # type: ignore[name-defined,misc]
    """A model that jumps where no table may."""

    def _predict(self, X):  # type: ignore[no-untyped-def]
        return super()._predict(X) + (X[:, 0] > 33.3)


@pytest.mark.parametrize("kind", [Warm, Stepped])
def test_a_model_without_a_table_is_asked_itself(kind: type[CompensationModel]) -> None:
    reading = np.linspace(-FULL_SCALE_NM, FULL_SCALE_NM, 61)
    rows = features(reading, 0, 0, 0.0, 23.0)
    model = kind(range_nm=FULL_SCALE_NM).fit(rows, 1.001 * reading)
    stream = Stream(active_chain(model))
    assert stream.active.chain.curve.table is None
    found = stream.push(reading, speed_rpm=0.0, temperature_c=23.0)
    torque_nm, uncertainty_nm = model.predict(rows, return_std=True)
    np.testing.assert_allclose(found.value_nm, torque_nm, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(found.component("static curve"), uncertainty_nm)
    assert np.isnan(stream.push(reading, speed_rpm=0.0).value_nm).all()


def test_torques_by_a_dynamic_filter_have_the_time_at_which_they_acted() -> None:
    transfer = TransferFunction(80.0, 0.1, 5e-5, 2e-4, 1e-3)
    effect = Dynamics.of("steps", design_inverse(transfer, 1e-3))
    model = make_model("polynomial").fit(
        features(np.linspace(-50.0, 50.0, 21)), np.linspace(-50.0, 50.0, 21)
    )
    active = ActiveChain(MeasuringChain(model, (effect,)), "1", model.kind)
    time_s = 1e-3 * np.arange(1, 201)
    # a slow pulse: the chain shows it late by its group delay only
    middle_s = 0.1
    pulse = 20.0 * np.exp(-0.5 * ((time_s - transfer.group_delay_s - middle_s) / 0.02) ** 2)
    streamed(active, time_s, pulse)
    found = active.window(0.0, 1.0)
    assert found is not None
    torque, at = found[1].value_nm, found[0] - transfer.group_delay_s
    assert abs(float(torque @ at) / float(torque.sum()) - middle_s) < 1e-3
    assert effect.delay_s - effect.late_s > 1.5e-3
