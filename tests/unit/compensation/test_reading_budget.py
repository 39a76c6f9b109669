"""Budgets of compensated readings: GUM, Monte Carlo and the vectorised form agree."""

from math import inf

import numpy as np
import pytest
from benchmarks.chains import make_chain
from hypothesis import given
from hypothesis import strategies as st

from torquebench.compensation import features, make_model
from torquebench.compensation.budget import (
    T40B_2000_NM,
    ChainSpecification,
    ReadingBudget,
    ReadingConditions,
)
from torquebench.compensation.table import compile_table
from torquebench.errors import InputError

_RANGE = 2000.0
_SPECIFICATION = ChainSpecification(
    reference_percent=0.02,
    temperature_span_percent_per_10k=0.05,
    temperature_zero_percent_per_10k=0.05,
    drift_percent_per_year=0.02,
    zero_drift_percent_per_h=0.001,
    counter_nm=0.02,
    timebase_relative=1e-6,
)
_CONDITIONS = ReadingConditions(
    calibration_age_h=2000.0,
    zero_age_h=3.0,
    temperature_change_calibration_k=4.0,
    temperature_change_zero_k=-1.0,
    zero_nm=0.05,
    zero_degrees_of_freedom=9.0,
)


def _calibration(points=13, noise=0.3):
    share = np.linspace(0.0, 1.0, points)
    share = np.concatenate([share, share[::-1], -share, -share[::-1]])
    branch = np.repeat([1.0, -1.0, 1.0, -1.0], points)
    extra = 3e-3 * share + 2e-3 * share * np.abs(share)
    extra += 3e-4 * np.sign(share) * branch * np.abs(share) * (1 - np.abs(share))
    scatter = noise * np.random.default_rng(8).standard_normal(share.size)
    return features(_RANGE * (share - extra) + scatter, branch), _RANGE * share


@pytest.fixture(scope="module")
def model():
    return make_model("physics", range_nm=_RANGE).fit(*_calibration())


@pytest.fixture(scope="module")
def budgets(model):
    return ReadingBudget(model, _SPECIFICATION)


def test_every_source_of_the_list_is_a_line(budgets):
    budget = budgets.budget(1200.0, 0, _CONDITIONS)
    contributions = {line.name: line.contribution for line in budget.lines}
    missing = {
        "model", "reference", "scatter", "hysteresis", "zero", "zero drift", "counter", "timebase",
        "drift", "span temperature coefficient", "zero temperature coefficient",
    } - {name for name, part in contributions.items() if part > 0}  # fmt: skip
    assert not missing
    torque = budget.value
    assert contributions["reference"] == pytest.approx(1e-4 * torque, rel=1e-6)
    assert contributions["drift"] == pytest.approx(2e-4 * 2000 / 8766 * torque / 3**0.5, rel=1e-6)
    assert contributions["span temperature coefficient"] == pytest.approx(
        5e-5 * 4.0 * torque / 3**0.5, rel=1e-6
    )
    assert contributions["zero temperature coefficient"] == pytest.approx(
        5e-5 * 1.0 * _RANGE / 3**0.5, rel=1e-6
    )
    assert budget.unit == "N·m"
    assert "hysteresis" in budget.text()


def test_known_branch_has_no_hysteresis_and_less_uncertainty(budgets, model):
    unknown, up = budgets.budget(900.0, 0), budgets.budget(900.0, 1)
    assert up.standard_uncertainty < unknown.standard_uncertainty
    expected = model.predict(features([900.0, 900.0], [1.0, -1.0]))
    assert up.value == pytest.approx(expected[0])
    assert unknown.value == pytest.approx(expected.mean())
    line = next(line for line in unknown.lines if line.name == "hysteresis")
    assert line.standard_uncertainty == pytest.approx(np.ptp(expected) / 2 / 2**0.5)
    given_by_history = budgets.budget(900.0, 0, hysteresis_nm=0.0)
    assert given_by_history.standard_uncertainty < unknown.standard_uncertainty


def test_model_and_scatter_share_their_degrees_of_freedom(model):
    bare = ReadingBudget(model, ChainSpecification(0.0))
    budget = bare.budget(1000.0, 1)
    assert budget.degrees_of_freedom == pytest.approx(bare.degrees_of_freedom)
    assert bare.degrees_of_freedom == pytest.approx(
        model.points_ - model.effective_parameters_, rel=1e-9
    )


@pytest.mark.parametrize("branch", [0, 1])
def test_monte_carlo_confirms_the_budget(budgets, branch):
    checked = budgets.check(1500.0, branch, _CONDITIONS, generator=np.random.default_rng(3))
    assert checked.agrees, checked.sentence()
    assert checked.monte_carlo.value == pytest.approx(checked.budget.value, abs=0.05)


def test_disagreement_is_said():
    """One dominant rectangular source: t-factors give a wider interval than the truth."""
    X, y = _calibration(noise=0.001)
    model = make_model("physics", range_nm=_RANGE).fit(X, y)
    budgets = ReadingBudget(model, ChainSpecification(0.0))
    checked = budgets.check(
        1500.0, 0, hysteresis_nm=5.0, generator=np.random.default_rng(3), significant_digits=2
    )
    assert not checked.agrees
    assert "do not agree" in checked.sentence()


@given(
    st.lists(
        st.tuples(st.floats(-2000.0, 2000.0), st.sampled_from([-1, 0, 1])), min_size=1, max_size=4
    ),
    st.floats(-10.0, 10.0),
    st.floats(1.0, 20.0),
)
def test_stream_equals_the_single_budgets(rows, warmer, averaged):
    X, y = _calibration()
    budgets = _cached_budgets(X, y)
    conditions = ReadingConditions(
        calibration_age_h=500.0,
        zero_age_h=1.0,
        temperature_change_calibration_k=warmer,
        zero_nm=0.05,
        zero_degrees_of_freedom=9.0,
        averaged=averaged,
    )
    reading, branch = np.array(rows).T
    stream = budgets.stream(reading, branch, conditions)
    for k, (one, side) in enumerate(rows):
        budget = budgets.budget(one, side, conditions)
        # near zero the model tapers its branch off: there the derivative sees the last digits only
        assert stream.standard_uncertainty_nm[k] == pytest.approx(
            budget.standard_uncertainty, rel=1e-6
        )
        assert stream.degrees_of_freedom[k] == pytest.approx(budget.degrees_of_freedom, rel=1e-5)
        assert stream.expanded_uncertainty_nm[k] == pytest.approx(
            budget.expanded_uncertainty(), rel=1e-6
        )


_CACHE: dict[str, ReadingBudget] = {}


def _cached_budgets(X, y):
    if "budgets" not in _CACHE:
        model = make_model("physics", range_nm=_RANGE).fit(X, y)
        _CACHE["budgets"] = ReadingBudget(model, _SPECIFICATION)
    return _CACHE["budgets"]


def test_table_gives_the_same_as_its_model(model):
    reading = np.linspace(-1900.0, 1900.0, 50)
    by_model = ReadingBudget(model, T40B_2000_NM).stream(reading)
    by_table = ReadingBudget(model, T40B_2000_NM, compile_table(model)).stream(reading)
    np.testing.assert_allclose(
        by_table.expanded_uncertainty_nm, by_model.expanded_uncertainty_nm, rtol=0.02
    )


def test_single_readings_lie_within_their_intervals(budgets, model):
    """New readings with the calibration's noise, nothing else wrong: 95 % intervals hold it."""
    bare = ReadingBudget(model, ChainSpecification(0.0))
    generator = np.random.default_rng(12)
    share = generator.uniform(-1.0, 1.0, 4000)
    branch = generator.choice([-1.0, 1.0], share.size)
    extra = 3e-3 * share + 2e-3 * share * np.abs(share)
    extra += 3e-4 * np.sign(share) * branch * np.abs(share) * (1 - np.abs(share))
    reading = _RANGE * (share - extra) + 0.3 * generator.standard_normal(share.size)
    stream = bare.stream(reading, branch, coverage_probability=0.95)
    error = model.predict(features(reading, branch)) - _RANGE * share
    inside = np.mean(np.abs(error) <= stream.expanded_uncertainty_nm)
    assert 0.90 < inside < 0.99


def test_what_a_form_misses_counts_once():
    """Single readings lie within 95 % intervals of models that can't follow the chain, too."""
    known, unknown = {}, {}
    generator = np.random.default_rng(8)
    for family in ("reference", "power-law", "skewed-hysteresis", "kinked", "rippled"):
        for seed in (310, 311):
            chain = make_chain(family, seed)
            data, dense = chain.calibration(50), chain.dense()
            X = dense.X[np.abs(dense.X[:, 0]) < 1.01 * chain.range_nm]
            truth = dense.torque_nm[np.abs(dense.X[:, 0]) < 1.01 * chain.range_nm]
            reading = X[:, 0] + chain.range_nm * chain.noise.draw(truth.size, generator)
            for kind in ("polynomial-2", "spline", "physics"):
                model = make_model(kind, range_nm=chain.range_nm).fit(data.X, data.standard_nm)
                budgets = ReadingBudget(model, ChainSpecification(0.0))
                up, down = (model.predict(features(reading, b, 1)) for b in (1, -1))
                for inside, branch, torque in (
                    (known, X[:, 1], np.where(X[:, 1] > 0, up, down)),
                    (unknown, np.zeros(truth.size), 0.5 * (up + down)),
                ):
                    stream = budgets.stream(reading, branch, coverage_probability=0.95)
                    within = np.abs(torque - truth) <= stream.expanded_uncertainty_nm
                    inside.setdefault(kind, []).append(np.mean(within))
    for inside in (known, unknown):
        for values in inside.values():
            assert 0.91 < np.mean(values) < 0.98


def test_perfect_fit_still_has_a_degree_of_freedom():
    reading = np.linspace(-10.0, 10.0, 5)
    model = make_model("polynomial", degree=3).fit(features(reading), 1.01 * reading)
    assert ReadingBudget(model, T40B_2000_NM).degrees_of_freedom == 1.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ChainSpecification(-0.1), "reference_percent"),
        (lambda: ChainSpecification(0.1, reference_coverage_factor=0.0), "above 0"),
        (lambda: ReadingConditions(zero_age_h=-1.0), "zero_age_h"),
        (lambda: ReadingConditions(temperature_change_zero_k=inf), "a finite number"),
        (lambda: ReadingConditions(averaged=0.5), "1 or more"),
    ],
)
def test_impossible_circumstances_are_named(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_reading_outside_the_range_is_refused(budgets):
    with pytest.raises(InputError, match="outside the calibrated range"):
        budgets.budget(2100.0)
    with pytest.raises(InputError, match="outside the calibrated range"):
        budgets.stream([0.0, 2100.0])
