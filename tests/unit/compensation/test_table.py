"""Compiled tables: the kernel against NumPy, the bound against the model, ranges and faults."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.compensation import MODELS, features, make_model
from torquebench.compensation.kinds import NETWORKS
from torquebench.compensation.piecewise import PiecewisePolynomial, approximate
from torquebench.compensation.table import CompensationTable, compile_table
from torquebench.errors import InputError

_RANGE = 2000.0
KINDS = sorted({*MODELS, *NETWORKS} - {"network"})


def _calibration(points=60, seed=3):
    generator = np.random.default_rng(seed)
    quarter = np.linspace(0.0, 1.0, points // 4)
    share = np.concatenate([quarter, quarter[::-1], -quarter, -quarter[::-1]])
    branch = np.repeat([1.0, -1.0, 1.0, -1.0], quarter.size)
    standard = _RANGE * share
    extra = 3e-3 * share + 2e-3 * share * np.abs(share) + 3e-4 * np.tanh(share / 0.01)
    extra += 2e-4 * np.sign(share) * branch * np.abs(share) * (1 - np.abs(share))
    reading = standard - _RANGE * (extra + 2e-4 * generator.standard_normal(share.size))
    return features(reading, branch), standard


def _parameters(kind):
    return {"published-network": {"epochs": 300}}.get(kind, {})


@pytest.fixture(scope="module")
def fitted():
    X, y = _calibration()
    return {
        kind: make_model(kind, range_nm=_RANGE, **_parameters(kind)).fit(X, y) for kind in KINDS
    }


@pytest.mark.parametrize("kind", KINDS)
def test_every_model_compiles_within_its_bound(fitted, kind):
    model = fitted[kind]
    table = compile_table(model, uncertainty=kind in ("hybrid", "polynomial"))
    assert table.bound_nm < 1e-6 * _RANGE
    generator = np.random.default_rng(11)
    low, high = table.reading_low_nm, table.reading_high_nm
    reading = np.concatenate(
        [
            generator.uniform(low, high, 3000),
            generator.uniform(-0.03, 0.03, 1000) * _RANGE,
            [low, high, _RANGE, -_RANGE, 1e-9, -1e-9],
        ]
    )
    for branch in (-1, 0, 1):
        signs = np.full(reading.size, branch, dtype=np.int8)
        expected, deviation = model.predict(features(reading, signs), return_std=True)
        assert np.max(np.abs(table.torque(reading, signs) - expected)) <= table.bound_nm * 1.0001
        if table.uncertainty_curve is not None:
            close = np.abs(table.standard_uncertainty(reading, signs) - deviation)
            assert np.max(close) <= table.uncertainty_curve.bound * 1.0001


def _reference(reading, branch, piecewise):
    """The formula that `PiecewisePolynomial.evaluate` documents, in NumPy."""
    clamped = np.clip(reading, piecewise.low, piecewise.high)
    central = np.clip(clamped, -piecewise.near, piecewise.near)
    location = piecewise.scale * clamped + piecewise.extra * central + piecewise.zero
    number = np.floor(location + 0.5).astype(int)
    place = location - number
    rows = piecewise.coefficients[branch.astype(int) + 1, number]
    result = np.zeros_like(reading)
    for column in rows.T[::-1]:
        result = result * place + column
    return piecewise.gain * reading + result


@given(
    st.integers(0, 40),
    st.sampled_from([2, 4]),
    st.booleans(),
    st.sampled_from([0.0, 1.0]),
    st.integers(0, 1000),
)
def test_kernel_agrees_with_numpy(size, order, with_branch, gain, seed):
    generator = np.random.default_rng(seed)
    piecewise = PiecewisePolynomial(
        generator.standard_normal((3, 48, order)),
        # from -16 to 16: 1 wide, between -8 and 8 only a half
        *(1.0, 23.5, 1.0, 8.0, -15.0, 15.0, gain, 0.0),
        branch_aware=True,
    )
    reading = generator.uniform(-17.0, 17.0, size)
    branch = generator.integers(-1, 2, size).astype(np.int8)
    out = np.empty(size)
    outside = piecewise.evaluate(reading, branch if with_branch else None, out)
    assert outside == np.count_nonzero(np.abs(reading) > 15.0)
    used = branch if with_branch else np.zeros(size, dtype=np.int8)
    np.testing.assert_allclose(out, _reference(reading, used, piecewise), rtol=1e-12, atol=1e-10)


def test_results_may_replace_the_readings(fitted):
    table = compile_table(fitted["hybrid"], uncertainty=False)
    reading = np.random.default_rng(1).uniform(-_RANGE, _RANGE, 10_003)
    branch = np.random.default_rng(2).integers(-1, 2, reading.size)
    expected = table.torque(reading, branch)
    in_place = reading.copy()
    assert table.torque(in_place, branch, out=in_place) is in_place
    np.testing.assert_array_equal(in_place, expected)


@given(st.floats(-2040.0, 2040.0), st.sampled_from([-1, 0, 1]))
def test_single_reading_equals_the_array(fitted_table, reading, branch):
    array = fitted_table.torque([reading], [branch])[0]
    # at an edge, rounding decides which of two polynomials that meet there is taken
    assert fitted_table.at(reading, branch) == pytest.approx(array, abs=1e-9 * _RANGE)


@pytest.fixture(scope="module", params=["hybrid", "published-network"])
def fitted_table(request):
    X, y = _calibration()
    model = make_model(request.param, range_nm=_RANGE, **_parameters(request.param)).fit(X, y)
    return compile_table(model, uncertainty=False)


def test_step_at_reversal_is_kept():
    """Two polynomials that don't meet at zero: the table jumps where the model does."""
    reading = np.linspace(-100.0, 100.0, 41)
    standard = reading + np.where(reading < 0, -0.5, 0.5)
    model = make_model("polynomial", per_direction=True, degree=1, outliers="keep")
    model.fit(features(reading), standard)
    table = compile_table(model, uncertainty=False)
    around = np.array([-1e-6, 0.0, 1e-6])
    np.testing.assert_allclose(table.torque(around), model.predict(features(around)), atol=1e-4)
    assert table.at(0.0) == pytest.approx(table.torque([0.0])[0], abs=1e-12)


@pytest.mark.parametrize(
    ("readings", "range_nm", "margin"),
    [
        (np.linspace(0.0, 100.0, 12), 100.0, 0.02),
        (np.linspace(0.0, 100.0, 12), 102.0, 0.0),
        (np.linspace(-70.0, 0.0, 12), None, 0.05),
        (np.linspace(20.0, 90.0, 12), None, 0.02),
        (np.linspace(-33.0, 100.0, 12), None, 0.013),
    ],
)
def test_lopsided_ranges(readings, range_nm, margin):
    model = make_model("polynomial", degree=2, range_nm=range_nm, range_margin=margin)
    model.fit(features(readings), 1.01 * readings + 1e-4 * readings**2)
    table = compile_table(model)
    low, high = model.reading_low_nm_, model.reading_high_nm_
    inside = np.linspace(low, high, 777)
    error = np.abs(table.torque(inside) - model.predict(features(inside)))
    assert np.max(error) <= table.bound_nm * 1.0001
    assert table.at(low) == pytest.approx(model.predict([[low]])[0], abs=1e-3)
    assert table.at(high) == pytest.approx(model.predict([[high]])[0], abs=1e-3)


def test_kink_is_followed_and_a_jump_is_refused():
    kink = approximate(
        lambda reading, _: np.abs(reading - 12.3) * 1e-3,
        (-100.0, 100.0),
        100.0,
        1e-6,
        gain=0.0,
        branch_aware=False,
        name="kink",
    )
    assert kink.bound <= 1e-4
    with pytest.raises(InputError, match=r"from the jump by 0\.01\d* N·m at 12\.[23]"):
        approximate(
            lambda reading, _: np.where(reading > 12.3, 0.01, 0.0),
            (-100.0, 100.0),
            100.0,
            1e-6,
            gain=0.0,
            branch_aware=False,
            name="jump",
        )


@pytest.mark.parametrize("kink_nm", [*np.linspace(-99.5, 99.5, 200)[::7].tolist(), 89.5])
def test_a_kink_is_followed_wherever_it_lies_in_its_interval(kink_nm):
    """Its place can hide that the deviation falls with the intervals' width."""
    curve = approximate(
        lambda reading, _: 1e-3 * np.abs(reading - kink_nm) + 2e-3 * np.exp(-0.5 * np.abs(reading)),
        (-100.5, 100.5),
        100.0,
        1e-6,
        gain=0.0,
        branch_aware=False,
        name="kink",
    )
    assert curve.bound <= 1e-4


@pytest.mark.parametrize(
    "shape",
    [
        lambda u: np.sqrt(np.abs(u)),
        lambda u: np.abs(u) ** 0.6,
        lambda u: np.tanh(u / 5e-4) * np.sqrt(np.abs(u)),
        lambda u: np.tanh(u / 5e-4),
        lambda u: np.exp(-0.5 * ((u - 0.3) / 0.02) ** 2),
        lambda u: np.sin(157.0 * u),
    ],
)
def test_bound_holds_between_the_points_that_were_looked_at(shape):
    piecewise = approximate(
        lambda reading, _: reading + 0.3 * shape(reading / 1000.0),
        (-1020.0, 1020.0),
        1000.0,
        1e-6,
        gain=1.0,
        branch_aware=False,
        name="shape",
    )
    generator = np.random.default_rng(3)
    edges = piecewise.nodes()
    share = generator.uniform(0.0, 1.0, 40)
    share[:20] *= 0.1  # where roots begin
    share[10:20] = 1.0 - share[10:20]
    reading = (edges[:-1, None] + np.diff(edges)[:, None] * share).ravel()
    out = np.empty(reading.size)
    piecewise.evaluate(reading, None, out)
    error = np.abs(out - reading - 0.3 * shape(reading / 1000.0))
    assert np.max(error) <= piecewise.bound <= 1e-3


def test_curve_that_is_not_a_number_is_refused():
    with pytest.raises(InputError, match="no number at"), np.errstate(invalid="ignore"):
        approximate(
            lambda reading, _: np.sqrt(reading),
            (-1.0, 1.0),
            1.0,
            1e-6,
            gain=0.0,
            branch_aware=False,
            name="root",
        )


def test_intervals_cover_the_range_and_are_narrow_near_zero(fitted):
    curve = compile_table(fitted["hybrid"], uncertainty=False).curve
    nodes = curve.nodes()
    assert (nodes[0], nodes[-1]) == (curve.low, curve.high)
    assert np.all(np.diff(nodes) > 0)
    assert np.any(nodes == 0.0)
    assert np.diff(nodes)[np.searchsorted(nodes, 0.0)] < 0.5 * np.diff(nodes).max()
    middle = 0.5 * (nodes[1:-2] + nodes[2:-1])
    location = curve.scale * middle + curve.extra * np.clip(middle, -curve.near, curve.near)
    np.testing.assert_allclose(np.diff(location), 1.0, atol=1e-6)


@pytest.fixture(scope="module")
def simple_table():
    X, y = _calibration()
    return compile_table(make_model("polynomial", range_nm=_RANGE).fit(X, y))


def test_readings_outside_are_counted_and_named(simple_table):
    reading = np.zeros(20)
    reading[7], reading[13] = 2100.0, np.nan
    with pytest.raises(InputError, match=r"2 readings .* first 2100 N·m at position 7"):
        simple_table.torque(reading)
    with pytest.raises(InputError, match="2 readings outside"):
        simple_table.torque(reading, out=reading)
    with pytest.raises(InputError, match="reading 2100"):
        simple_table.at(2100.0)
    with pytest.raises(InputError, match="reading nan"):
        simple_table.at(float("nan"))


def test_live_path_counts_instead(simple_table):
    torque = np.array([0.0, 3000.0, np.nan, -3000.0])
    assert simple_table.curve.evaluate(torque, None, torque) == 3
    # an overload keeps its size
    assert torque[1] == pytest.approx(3000.0, rel=0.02)
    assert torque[3] == pytest.approx(-3000.0, rel=0.02)
    assert np.isnan(torque[2])
    assert simple_table.curve.evaluate(np.array([1.0, 2.0]), None, np.empty(2)) == 0


def test_empty_input(simple_table):
    assert simple_table.torque([]).size == 0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda t: t.torque([[1.0]]), "one row"),
        (lambda t: t.torque([1.0, 2.0], [1]), "1 branches for 2 readings"),
        (lambda t: t.torque([1.0], np.array([2], dtype=np.int8)), "a branch of 2"),
        (lambda t: t.torque([1.0], out=np.empty(2)), "output array"),
        (lambda t: t.torque([1.0], out=np.empty(1, np.float32)), "output array"),
        (
            lambda t: CompensationTable(t.curve, None, t.kind, 1.0).standard_uncertainty([1.0]),
            "without uncertainty",
        ),
    ],
)
def test_bad_arguments_are_named(simple_table, call, message):
    with pytest.raises(InputError, match=message):
        call(simple_table)


def test_impossible_tolerance_is_refused(fitted):
    with pytest.raises(InputError, match="table tolerance"):
        compile_table(fitted["polynomial"], tolerance=0.0)


@pytest.mark.nightly
def test_a_loop_that_closes_steeply_is_followed_less_finely_instead_of_for_minutes():
    rising = np.linspace(0.0, 1900.0, 30)
    standard = np.concatenate((rising, rising[::-1]))
    branch = np.repeat([1.0, -1.0], 30)
    noise = np.random.default_rng(3).normal(0.0, 0.1, 60)
    X = features(1.002 * standard + 2.0 * branch + noise, branch)  # open at the largest torque
    model = make_model("hybrid", range_nm=2000.0).fit(X, standard)
    table = compile_table(model, uncertainty=False)
    assert table.curve.intervals < 1 << 16
    assert 1e-6 * 2000.0 < table.bound_nm < 1e-5 * 2000.0
    reading = np.linspace(-40.0, 2040.0, 1001)
    for side in (-1.0, 1.0):
        branches = np.full(reading.size, side)
        followed = table.torque(reading, branches.astype(np.int8))
        exact = model.predict(features(reading, branches))
        assert np.max(np.abs(followed - exact)) <= table.bound_nm


def test_intervals_are_not_narrowed_where_that_is_known_to_be_hopeless():
    evaluated = 0

    def closing(reading, branch):
        nonlocal evaluated
        evaluated += reading.size
        return np.asarray(reading + 0.06 * branch * np.sqrt(np.clip(2000.0 - reading, 0.0, None)))

    with pytest.raises(InputError, match="narrower than the range"):
        approximate(closing, (-40.0, 2040.0), 2000.0, 1e-6, gain=1.0, branch_aware=True,
                    name="loop", largest=1 << 14)  # fmt: skip
    assert evaluated < 100_000
