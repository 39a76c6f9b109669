"""Torque, U and budget of a measuring chain, and what torques of one calibration share."""

import json
from math import inf, sqrt
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.chains import make_chain

from torquebench.chain import (
    EFFECTS,
    SWITCHES,
    Component,
    Counter,
    Creep,
    Drift,
    Dynamics,
    Inertia,
    MeasuredRotation,
    MeasuredTemperature,
    MeasuringChain,
    Mounting,
    Readings,
    Reference,
    Ripple,
    Rotation,
    Shared,
    SwitchedOff,
    Temperature,
    Timebase,
    Torque,
    Zero,
    effect_from,
    joined,
)
from torquebench.chain.effects.switched_off import Switch
from torquebench.compensation import CompensationModel, features, make_model
from torquebench.errors import InputError
from torquebench.uncertainty import CertifiedUncertainty, Distribution

RANGE_NM = 2000.0
EFFECTS_OF_ALL_KINDS = (
    Reference("certificate", CertifiedUncertainty.flat(0.4, 40.0, 2000.0), 0.0, 0.0),
    Temperature("data sheet", 0.1, 5e-5, 23.0, 18.0, 30.0),
    Rotation("data sheet", 0.2, 0.2, 15.0),
    Counter("counter", 0.02),
    Timebase("other clock", "PXI-1", 10.0, 4000.0),
    Zero("zeroing", 0.05, 4.0, 0.03),
    Drift("drift record", 0.02, 8766.0),
    Mounting("three positions", 0.01),
    Creep("data sheet", 0.02),
    Inertia("empty runs", 0.002, 1e-5, 30.0),
    Dynamics("steps", 1e-4, (1.5, -0.5), ((0.1, -0.1),), 2e-4, 3e-4),
    MeasuredTemperature(
        "empty runs",
        23.0,
        12.0,
        38.0,
        (0.0, 60.0),
        (-2.0, 3.0),
        (0.1, 0.2),
        (1e-4, 0.0),
        (0.0,) * 2,
    ),
    MeasuredRotation(
        "empty runs",
        23.0,
        -9.0,
        9.0,
        12.0,
        38.0,
        (0.0, 10.0),
        (0.0, 60.0),
        *(((0.0, 0.0), (0.1, 0.2)),) * 4,
        running_in_s=60.0,
        running_in_nm=(0.1, 0.2),
        running_in_uncertainty_nm=(0.01, 0.02),
    ),
    Ripple(
        "empty runs",
        1200.0,
        0.01,
        (1.0,),
        ((0.0, 0.0, 0.1, 0.0, 0.0),),
        ((0.0, 0.0, 0.2, 0.0, 0.0),),
        (0.0, 1200.0),
        (0.0, 0.01),
    ),
    SwitchedOff("a person", ("hysteresis",)),
)
OF_LIMITS = EFFECTS_OF_ALL_KINDS[:11]


def calibration(points: int = 13, noise_nm: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    share = np.linspace(0.0, 1.0, points)
    share = np.concatenate([share, share[::-1], -share, -share[::-1]])
    branch = np.repeat([1.0, -1.0, 1.0, -1.0], points)
    scatter = noise_nm * np.random.default_rng(8).standard_normal(share.size)
    return features(RANGE_NM * (share - additional(share, branch)) + scatter, branch), (
        RANGE_NM * share
    )


def additional(share: np.ndarray, branch: np.ndarray) -> np.ndarray:
    loop = 3e-4 * np.sign(share) * branch * np.abs(share) * (1 - np.abs(share))
    return np.asarray(3e-3 * share + 2e-3 * share * np.abs(share) + loop)


@pytest.fixture(scope="module")
def model() -> CompensationModel:
    return make_model("hybrid", range_nm=RANGE_NM).fit(*calibration())


@pytest.fixture(scope="module")
def chain(model: CompensationModel) -> MeasuringChain:
    return MeasuringChain(model, OF_LIMITS)


def rows(*reading_nm: float, **known: object) -> Readings:
    return Readings(np.array(reading_nm), **known)  # type: ignore[arg-type]


def test_every_registered_effect_is_tested_and_stored_exactly() -> None:
    assert {effect.kind for effect in EFFECTS_OF_ALL_KINDS} == set(EFFECTS)
    for effect in EFFECTS_OF_ALL_KINDS:
        in_file = json.loads(json.dumps(effect.specification()))
        assert effect_from(in_file) == effect


def test_components_are_as_their_limits_say(chain: MeasuringChain) -> None:
    torque = chain.torque(
        rows(
            1200.0,
            temperature_c=27.0,
            zero_temperature_c=28.0,
            speed_rpm=-10.0,
            zero_age_h=3.0,
            calibration_age_h=2000.0,
        )
    )
    value = torque.value_nm[0]
    expected = {
        "reference standard": 0.2,
        "temperature of span": 5e-5 * sqrt(16 + 0.25 / 3) * value / sqrt(3),
        "temperature of zero": 0.1 * sqrt(1 + 0.25 / 3) / sqrt(3),
        "zero over speed": 0.2 * 0.01 / sqrt(3),
        "bearing drag": 0.2 / sqrt(3),
        "noise of the reading": 0.02,
        "time base": 1e-5 * (4000.0 + value) / sqrt(3),
        "zero": 0.03,
        "zero drift": 0.15 / sqrt(3),
        "drift": 2e-4 * 2000 / 8766 * value / sqrt(3),
        "mounting": 1e-4 * value,
        "creep": 2e-4 * value / sqrt(3),
        "inertia": 0.002 * 30.0 / sqrt(3),
    }
    for name, size in expected.items():
        assert torque.component(name)[0] == pytest.approx(size, rel=1e-9), name
    budget = torque.budget()
    assert set(expected) | {"static curve", "hysteresis", "scatter"} == {
        line.name for line in budget.lines
    }
    assert budget.value == value
    assert budget.standard_uncertainty == pytest.approx(torque.standard_uncertainty_nm[0])
    assert budget.expanded_uncertainty() == pytest.approx(torque.expanded_uncertainty_nm[0])


def test_noise_of_the_calibration_s_steps_counts_once(model: CompensationModel) -> None:
    """The scatter of step means contains their standard error: a steady reading added it again."""
    counter = Counter("steps", 0.7, steps_nm=0.4)
    chain = MeasuringChain(model, (counter,))
    noise = [
        chain.torque(rows(900.0, **known)).component("noise of the reading")[0]
        for known in ({}, {"counter_nm": 0.4}, {"counter_nm": 0.5}, {"window_s": np.inf})
    ]
    assert noise == pytest.approx([sqrt(0.7**2 - 0.4**2), 0.0, 0.3, 0.0])
    assert counter.gaps() == () != Counter("steps").gaps()
    mean = chain.torque(rows(900.0, 900.0)).mean()
    assert mean.component("noise of the reading")[0] == pytest.approx(noise[0] / sqrt(2.0))
    moved = mean.steady(0.1, 0.6, chain.steps_nm)
    assert moved.value_nm[0] == pytest.approx(mean.value_nm[0] + 0.1)
    assert moved.component("noise of the reading")[0] == pytest.approx(sqrt(0.6**2 - 0.4**2))
    bare = MeasuringChain(model).torque(rows(900.0, counter_nm=0.5))  # without any record
    assert bare.component("noise of the reading")[0] == 0.5


def test_lines_of_a_budget_say_what_they_are(chain: MeasuringChain) -> None:
    """Corrections and not the torque, with the shape and the correlation of each row."""
    torque = chain.torque(
        rows(
            900.0, 900.0, temperature_c=np.array([30.0, 23.0]), zero_temperature_c=23.0,
            acceleration_rad_s2=np.array([np.nan, 3.0]),
        )
    )  # fmt: skip
    again = joined([torque.at([0]), torque.at([1])])
    for row, other in ((0, 0), (1, 0)):
        for budget in (torque.budget(row), again.budget(row), torque.at([row]).budget(other)):
            lines = {line.name: line for line in budget.lines}
            shapes = [lines[name].distribution for name in ("temperature of span", "inertia")]
            assert shapes == (
                ["rectangular"] * 2 if row == 0 else ["product of two rectangular", "normal"]
            )
            assert lines["scatter"].shared is Shared.LOADING
            assert lines["drift"].shared is Shared.CALIBRATION
            assert 900.0 + sum(line.value for line in budget.lines) == pytest.approx(budget.value)


def test_what_is_not_measured_widens_and_never_narrows(chain: MeasuringChain) -> None:
    known = chain.torque(
        rows(
            900.0,
            branch=np.ones(1),
            temperature_c=23.0,
            zero_temperature_c=23.0,
            speed_rpm=0.0,
            zero_age_h=0.0,
            calibration_age_h=0.0,
            counter_nm=0.0,
        )
    )
    unknown = chain.torque(rows(900.0))
    for name in (
        "hysteresis", "temperature of zero", "temperature of span", "zero over speed",
        "bearing drag", "zero drift", "drift", "noise of the reading",
    ):  # fmt: skip
        assert unknown.component(name)[0] > known.component(name)[0], name
    nan = chain.torque(rows(900.0, temperature_c=np.nan, speed_rpm=np.array([np.nan])))
    assert nan.expanded_uncertainty_nm == pytest.approx(unknown.expanded_uncertainty_nm)


def test_the_standard_counts_less_below_its_smallest_certified_torque(
    chain: MeasuringChain,
) -> None:
    torque = chain.torque(rows(-1000.0, 0.0, 20.0, 1000.0))
    part = torque.component("reference standard")
    assert part[[0, 3]] == pytest.approx([0.2, 0.2])
    assert part[1] < 0.01
    assert part[2] == pytest.approx(0.2 * abs(torque.value_nm[2]) / 40.0)


def test_an_influence_without_a_record_is_named(model: CompensationModel) -> None:
    bare = MeasuringChain(model)
    assert "temperature of zero and span" in bare.missing()
    assert "reference standard" in bare.missing()
    assert {"creep under load", "inertia between transducer and flange"} <= set(bare.missing())
    assert "time base" not in bare.missing()
    assert MeasuringChain(model, OF_LIMITS).missing() == ()


def test_limits_count_only_where_a_chain_has_no_record(model: CompensationModel) -> None:
    own = Temperature("three temperatures", None, 1e-5, 30.0)
    chain = MeasuringChain(model, (Zero("zeros", None, zero_nm=0.1), own)).with_limits(
        [
            Zero("data sheet", 0.2, 4.0),
            Temperature("data sheet", 0.3, 9e-5, 23.0),
            Drift("data sheet", 0.01),
        ]
    )
    zero, temperature, drift = chain.stored
    assert zero == Zero("zeros; data sheet", 0.2, 4.0, zero_nm=0.1)
    assert temperature == Temperature("three temperatures; data sheet", 0.3, 1e-5, 30.0)
    assert drift == Drift("data sheet", 0.01)
    complete = MeasuringChain(model, OF_LIMITS)
    assert complete.with_limits([Drift("data sheet", 5.0)]).stored == complete.stored


def test_a_span_that_was_not_identified_takes_the_limit_that_is_stated(
    model: CompensationModel,
) -> None:
    measured = MeasuredTemperature(
        "empty run", 30.0, 12.0, 38.0, (0.0, 60.0), (-2.0, 3.0), (0.1, 0.2)
    )
    bare = MeasuringChain(model, (measured,))
    assert "temperature of span" in bare.missing()
    limit = Temperature("data sheet", 0.3, 9e-5, 23.0, 18.0, 28.0)
    for chain in (bare.with_limits([limit]), MeasuringChain(model, (limit, measured))):
        assert not {"temperature of span", "temperature of zero"} & set(chain.missing())
        torque = chain.torque(rows(1000.0, temperature_c=34.0, zero_temperature_c=34.0))
        names = [each.name for each in torque.components]
        assert names.count("temperature of span") == names.count("temperature of zero") == 1
        change_k = np.hypot(4.0, 0.5 / sqrt(3))  # since the calibration of the chain
        assert torque.component("temperature of span")[0] == pytest.approx(
            9e-5 * change_k * torque.value_nm[0] / sqrt(3)
        )
        assert torque.component("temperature of zero")[0] == 0.0  # as measured


def test_chains_of_one_model_compile_it_once(chain: MeasuringChain) -> None:
    """A switch of a correction in the live stream took as long as a compilation."""
    table = chain.curve.table
    assert table is not None
    assert chain.switched("a person", ["hysteresis"]).curve.table is table
    again = make_model("polynomial", range_nm=RANGE_NM).fit(*calibration())
    first = MeasuringChain(again).curve.table
    again.fit(*calibration(noise_nm=0.0))
    assert MeasuringChain(again).curve.table is not first


def test_a_limit_that_is_not_known_is_named(model: CompensationModel) -> None:
    chain = MeasuringChain(model, (Zero("zeros", None, zero_nm=0.1), Temperature("", None, 1e-5)))
    assert {"zero drift", "temperature of zero"} <= set(chain.missing())
    torque = chain.torque(rows(1000.0))
    assert torque.component("zero") == pytest.approx([0.1])
    assert torque.component("temperature of span")[0] > 0.0
    with pytest.raises(InputError, match="-1"):
        Zero("zeros", -1.0)


def test_a_known_branch_has_no_hysteresis(chain: MeasuringChain, model: CompensationModel) -> None:
    torque = chain.torque(rows(900.0, 900.0, 900.0, branch=np.array([1.0, -1.0, 0.0])))
    expected = model.predict(features([900.0, 900.0], [1.0, -1.0]))
    assert torque.value_nm[:2] == pytest.approx(expected, abs=2e-6 * RANGE_NM)
    assert torque.value_nm[2] == pytest.approx(expected.mean(), abs=2e-6 * RANGE_NM)
    loop = torque.component("hysteresis")
    assert loop[:2].tolist() == [0.0, 0.0]
    assert loop[2] == pytest.approx(np.ptp(expected) / 2 / sqrt(2), rel=1e-3)
    total = 900.0 + torque.added("static curve") + torque.added("hysteresis")
    assert torque.value_nm == pytest.approx(total)


def test_a_stream_on_the_loop_says_the_same_as_a_row(chain: MeasuringChain) -> None:
    stream = chain.stream()
    path = np.concatenate([np.linspace(a, b, 60) for a, b in ((0, 1), (1, 0), (0, 1))])
    parts = [stream.push(Readings(part)) for part in np.array_split(RANGE_NM * path, 17)]
    live = joined(parts)
    row = int(np.argmin(np.abs(path[120:] - 0.5))) + 120
    reading = Readings(RANGE_NM * path[row : row + 1], branch=np.ones(1))
    one = chain.torque(reading)
    assert live.value_nm[row] == pytest.approx(one.value_nm[0], abs=1e-9)
    assert live.expanded_uncertainty_nm[row] == pytest.approx(
        one.expanded_uncertainty_nm[0], rel=1e-12
    )
    whole = chain.stream().push(Readings(RANGE_NM * path))
    np.testing.assert_array_equal(whole.value_nm, live.value_nm)
    np.testing.assert_array_equal(whole.expanded_uncertainty_nm, live.expanded_uncertainty_nm)


def test_a_copied_stream_goes_its_own_way(chain: MeasuringChain) -> None:
    stream = chain.stream()
    stream.push(Readings(np.linspace(0.0, 1900.0, 50)))
    copy = stream.copy()
    before = copy.copy().push(rows(1000.0)).value_nm
    copy.push(rows(-1900.0, 1900.0))
    assert stream.copy().push(rows(1000.0)).value_nm == before


def test_a_comparison_of_two_torques_cancels_what_they_share(chain: MeasuringChain) -> None:
    pair = chain.torque(rows(1000.0, 1000.0, temperature_c=26.0, speed_rpm=5.0))
    difference = pair.combined([1.0, -1.0])
    left = {each.name: float(each.uncertainty_nm[0]) for each in difference.components}
    for shared in (
        "static curve", "reference standard", "temperature of span", "temperature of zero",
        "time base", "drift", "mounting", "zero", "zero drift", "zero over speed", "bearing drag",
    ):  # fmt: skip
        assert left[shared] == pytest.approx(0.0, abs=1e-12), shared
    for new in ("scatter", "hysteresis", "noise of the reading"):
        assert left[new] == pytest.approx(sqrt(2.0) * pair.component(new)[0]), new
    assert difference.value_nm == pytest.approx([0.0])
    # with another mounting and another zero they come back
    apart = pair.combined([1.0, -1.0], mounting=[1, 2], zeroing=[1, 2])
    assert apart.component("mounting")[0] == pytest.approx(sqrt(2) * pair.component("mounting")[0])
    assert apart.component("zero")[0] == pytest.approx(sqrt(2) * pair.component("zero")[0])
    assert apart.component("reference standard")[0] == pytest.approx(0.0, abs=1e-12)
    # the mean of both directions keeps the span and loses what turns its sign
    both = chain.torque(rows(500.0, -500.0, speed_rpm=5.0)).combined([0.5, -0.5])
    assert both.component("reference standard")[0] == pytest.approx(0.2, rel=0.01)
    assert both.component("zero over speed")[0] == pytest.approx(0.0, abs=1e-12)


def test_errors_of_the_curve_far_apart_are_independent(chain: MeasuringChain) -> None:
    near, far = (chain.torque(rows(500.0, second)) for second in (502.0, 1500.0))
    single = far.component("static curve")
    assert far.combined([1.0, -1.0]).component("static curve")[0] == pytest.approx(
        np.hypot(*single)
    )
    assert near.combined([1.0, -1.0]).component("static curve")[0] < 0.2 * single[0]
    branches = chain.torque(rows(500.0, 500.0, branch=np.array([1.0, -1.0])))
    assert branches.combined([1.0, -1.0]).component("static curve")[0] == pytest.approx(
        np.hypot(*branches.component("static curve"))
    )


def test_windows_of_one_loading_average_only_what_is_white(chain: MeasuringChain) -> None:
    torque = chain.torque(rows(*[800.0] * 16))
    mean = torque.mean()
    for component in torque.components:
        expected = torque.component(component.name)[0]
        if component.shared is Shared.NOTHING:
            expected /= 4.0
        assert mean.component(component.name)[0] == pytest.approx(expected), component.name


def test_what_is_not_trusted_is_taken_back_and_stays_uncertain(chain: MeasuringChain) -> None:
    torque = chain.torque(rows(900.0, branch=np.ones(1)))
    middle = torque.without("hysteresis")
    added = torque.added("hysteresis")[0]
    assert added != 0.0
    assert middle.value_nm[0] == pytest.approx(torque.value_nm[0] - added)
    assert middle.component("hysteresis")[0] == pytest.approx(abs(added) / sqrt(3.0))
    assert middle.added("hysteresis").tolist() == [0.0]


def test_monte_carlo_confirms_the_budget(chain: MeasuringChain) -> None:
    checked = chain.torque(rows(1500.0)).check(generator=np.random.default_rng(3))
    assert checked.agrees, checked.sentence()
    assert checked.monte_carlo.value == pytest.approx(checked.budget.value, abs=0.05)
    loop = Component("loop", Shared.LOADING, np.array([1.0]), distribution=Distribution.ARCSINE)
    uneven = Torque(np.array([10.0]), (loop,))
    assert not uneven.check(generator=np.random.default_rng(3), significant_digits=2).agrees


@given(
    st.lists(st.floats(-1900.0, 1900.0), min_size=1, max_size=4),
    st.floats(15.0, 35.0),
    st.floats(1.0, 20.0),
)
def test_every_row_is_as_if_it_stood_alone(
    readings: list[float], temperature_c: float, loadings: float
) -> None:
    chain = MeasuringChain(_MODEL[0], OF_LIMITS)
    known = {"temperature_c": temperature_c, "loadings": loadings}
    torque = chain.torque(rows(*readings, **known))
    for row, reading in enumerate(readings):
        one = chain.torque(rows(reading, **known))
        assert torque.value_nm[row] == one.value_nm[0]
        assert torque.expanded_uncertainty_nm[row] == one.expanded_uncertainty_nm[0]
        budget = torque.budget(row)
        assert budget.expanded_uncertainty() == pytest.approx(one.expanded_uncertainty_nm[0])


_MODEL = [make_model("polynomial", degree=2, range_nm=RANGE_NM).fit(*calibration())]


def test_single_readings_lie_within_their_intervals(model: CompensationModel) -> None:
    """New readings with the calibration's noise, nothing else wrong: 95 % intervals hold it."""
    generator = np.random.default_rng(12)
    share = generator.uniform(-1.0, 1.0, 4000)
    branch = generator.choice([-1.0, 1.0], share.size)
    reading = RANGE_NM * (share - additional(share, branch))
    reading += 0.3 * generator.standard_normal(share.size)
    torque = MeasuringChain(model).torque(Readings(reading, branch=branch))
    error = torque.value_nm - RANGE_NM * share
    inside = np.mean(np.abs(error) <= 1.96 * torque.standard_uncertainty_nm)
    assert 0.92 < inside < 0.985


@pytest.mark.nightly
def test_what_a_form_misses_counts_once() -> None:
    """Single readings lie within 95 % intervals of models that can't follow the chain, too."""
    known: dict[str, list[float]] = {}
    unknown: dict[str, list[float]] = {}
    generator = np.random.default_rng(8)
    for family in ("reference", "power-law", "skewed-hysteresis", "kinked", "rippled"):
        for seed in (310, 311):
            made = make_chain(family, seed)
            data, dense = made.calibration(50), made.dense()
            within = np.abs(dense.X[:, 0]) < 1.01 * made.range_nm
            X, truth = dense.X[within], dense.torque_nm[within]
            noise = made.range_nm * made.noise.draw(truth.size, generator)
            for kind in ("polynomial-2", "hybrid"):
                model = make_model(kind, range_nm=made.range_nm).fit(data.X, data.standard_nm)
                chain = MeasuringChain(model)
                for inside, branch in ((known, X[:, 1]), (unknown, np.zeros(truth.size))):
                    torque = chain.torque(Readings(X[:, 0], branch=branch))
                    error = torque.value_nm + noise - truth
                    held = np.abs(error) <= 1.96 * torque.standard_uncertainty_nm
                    inside.setdefault(kind, []).append(float(np.mean(held)))
    for inside in (known, unknown):
        for kind, values in inside.items():
            assert 0.91 < np.mean(values) < 0.985, kind


@pytest.mark.parametrize(
    ("specification", "message"),
    [
        ({"kind": "drift", "record": "", "percent_per_year": -0.1}, "percent_per_year = -0.1"),
        ({"kind": "drift", "record": "", "percent_per_year": inf}, "a finite number"),
        ({"kind": "drift", "record": "", "percent": 0.1}, "other fields"),
        ({"kind": "moon", "record": ""}, "effect 'moon'"),
    ],
)
def test_impossible_effects_are_named(specification: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        effect_from(specification)


def test_a_reading_outside_the_range_is_refused_by_the_effect_that_ends_there(
    chain: MeasuringChain,
) -> None:
    with pytest.raises(InputError, match="row 1: static curve with hysteresis: reading 2100 N·m"):
        chain.torque(rows(0.0, 2100.0))
    live = chain.stream().push(rows(100.0, 2100.0, np.nan))
    assert np.isnan(live.expanded_uncertainty_nm).tolist() == [False, True, True]
    assert np.isnan(live.value_nm).tolist() == [False, True, True]


def test_the_switches_of_the_api_are_those_of_the_chain() -> None:
    assert get_args(Switch) == tuple(SWITCHES)
