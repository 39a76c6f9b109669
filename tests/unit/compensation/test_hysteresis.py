"""Hysteresis with memory, held against relays of a Preisach model that plays don't contain."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from tests.support.draws import some

from torquebench.compensation import features, make_model
from torquebench.compensation.hysteresis import (
    HistoryCompensator,
    HysteresisOperator,
    non_negative_solution,
    one_sided_path,
)
from torquebench.compensation.table import compile_table
from torquebench.errors import InputError

_FS = 2000.0
_REVERSING_NM = _FS * np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])
"""Turning points of a calibration in cycles 0 → +FS → 0 → −FS → 0."""


class RelayChain:
    """A torque chain whose hysteresis is a Preisach model: relays with an up and a down threshold.

    Everything is in full scales; `density` weighs the relays by half-width and centre.
    """

    def __init__(self, density, amplitude=6e-4):
        edges = np.linspace(-1.05, 1.05, 60)
        up, down = (grid.ravel() for grid in np.meshgrid(edges, edges))
        self.up, self.down = up[up > down], down[up > down]
        weight = density((self.up - self.down) / 2, (self.up + self.down) / 2)
        self.weight = amplitude * weight / weight.sum()
        self.state = np.where(self.up + self.down > 0, -1.0, 1.0)

    def drive(self, torque):
        """Readings along a path of torques, moved through finely between them."""
        readings, before = [], float(torque[0])
        for target in torque:
            for x in np.linspace(before, target, int(abs(target - before) / 0.01) + 2)[1:]:
                self.state[x >= self.up] = 1.0
                self.state[x <= self.down] = -1.0
            curve = 4e-3 * target + 2e-3 * target * abs(target) + 4e-4 * np.tanh(target / 0.015)
            readings.append(target - curve - self.weight @ self.state)
            before = target
        return np.array(readings)


_DENSITIES = {
    "narrow": lambda width, centre: np.exp(-width / 0.2) + 0.0 * centre,
    "wide": lambda width, centre: np.exp(-(((width - 0.3) / 0.25) ** 2)) + 0.0 * centre,
    "skew": lambda width, centre: np.exp(-width / 0.25) * (1 + 1.5 * np.abs(centre)),
}

_TURNS = [0, 0.9, -0.2, 0.5, 0.3, 0.7, 0.1, -0.6, -0.3, -0.8, -0.2, 0.4, 0.2, 0.6, 0.95, 0.5, 0.8]


def _work_path(seed=4):
    turns = [*_TURNS, *np.random.default_rng(seed).uniform(-0.9, 0.9, 12)]
    legs = [np.linspace(a, b, 40)[1:] for a, b in itertools.pairwise(turns)]
    return np.concatenate(legs)


def _calibrated(chain, reversing, noise_fs=2e-5, uncertainty=False, cycles=1):
    """Calibrate up and down in both directions and fit the recommended model."""
    up = np.linspace(0.0, 1.0, 16)[1:]
    loop = np.concatenate([up, up[-2::-1], [0.0]])
    signs = (1.0, -1.0) * cycles
    reading = []
    if reversing:
        chain.drive([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])
    for sign in signs:
        if not reversing:
            chain.drive([0.0, sign, 0.0, sign, 0.0])
        reading.append(chain.drive(sign * loop))
    standard = _FS * np.concatenate([sign * loop for sign in signs])
    branch = np.tile(np.repeat([1.0, -1.0], 15), len(signs))
    series = np.repeat(np.arange(1.0, len(signs) + 1.0), loop.size)
    noise = noise_fs * np.random.default_rng(1).standard_normal(standard.size)
    X = features(_FS * (np.concatenate(reading) + noise), branch, series)
    model = make_model("hybrid", range_nm=_FS).fit(X, standard)
    return compile_table(model, uncertainty=uncertainty)


def _rms(error):
    return float(np.sqrt(np.mean(np.square(error)))) / _FS


@pytest.mark.parametrize("reversing", [False, True])
@pytest.mark.parametrize("density", some(sorted(_DENSITIES), by_day=1))
def test_inner_loops_and_reversals_stay_compensated(density, reversing):
    chain = RelayChain(_DENSITIES[density])
    table = _calibrated(chain, reversing)
    path = _REVERSING_NM if reversing else one_sided_path(_FS)
    share = _work_path()
    reading, torque = _FS * chain.drive(share), _FS * share
    column = np.sign(np.diff(share, prepend=0.0)) * np.sign(share)
    by_column = _rms(table.torque(reading, column) - torque)
    unaware = _rms(table.torque(reading) - torque)
    live = HistoryCompensator(table, HysteresisOperator.from_table(table, path)).push(reading)
    known = slice(40, None)
    by_history = _rms((live.torque_nm - torque)[known])
    assert by_history < 0.6 * min(by_column, unaware)
    assert np.all(np.abs(live.coordinate) <= 1.0)


@pytest.mark.parametrize("density", sorted(_DENSITIES))
def test_one_quiet_cycle_tells_remanence_from_a_zero_that_creeps(density):
    """With little noise a loop's own shape shows, which no formula has: it is no creep."""
    chain = RelayChain(_DENSITIES[density])
    table = _calibrated(chain, reversing=True, noise_fs=2e-5)
    share = _work_path()
    compensator = HistoryCompensator(table, HysteresisOperator.from_table(table, _REVERSING_NM))
    live = compensator.push(_FS * chain.drive(share))
    assert _rms((live.torque_nm - _FS * share)[40:]) < 4e-5


def test_live_torque_lies_between_both_curves_of_the_table_as_the_operators_state():
    table = _calibrated(RelayChain(_DENSITIES["narrow"]), reversing=False)
    compensator = HistoryCompensator(table)
    operator = compensator.operator
    reading = _FS * _work_path()[::7]
    grid, falling, rising = operator.reference
    fall = np.interp(reading, grid, falling)
    rise = np.maximum(np.interp(reading, grid, rising), fall)
    outward = np.where(reading >= 0.0, 1, -1)
    up, down = table.torque(reading, outward), table.torque(reading, -outward)
    bounds = []
    for state in operator.tracker().push(reading):
        inside = np.clip(state, fall, rise)
        share = (inside - fall) / np.maximum(rise - fall, 1e-9)
        bounds.append(down + share * (up - down) + operator.amplitude_nm * (state - inside))
    live = compensator.push(reading)
    np.testing.assert_array_equal(live.torque_nm, 0.5 * (bounds[0] + bounds[1]))
    np.testing.assert_array_equal(live.middle_nm, 0.5 * (up + down))


def test_calibrated_loop_gives_the_models_own_branches():
    """Along the very path of the calibration the result is the branch-aware model itself."""
    table = _calibrated(RelayChain(_DENSITIES["narrow"]), reversing=False)
    compensator = HistoryCompensator(table)
    compensator.push(one_sided_path(_FS)[:5])
    up = np.linspace(0.0, _FS, 200)[1:]
    rising = compensator.push(up)
    falling = compensator.push(up[::-1])
    # within half a step of the reference grid, and not where both branches meet at zero
    inside = slice(20, None)
    tolerance = 3e-5 * _FS
    np.testing.assert_allclose(
        rising.torque_nm[inside], table.torque(up, np.ones(up.size))[inside], atol=tolerance
    )
    np.testing.assert_allclose(
        falling.torque_nm[:-20], table.torque(up[::-1], -np.ones(up.size))[:-20], atol=tolerance
    )
    assert rising.coordinate[-100] > 0.9
    assert falling.coordinate[120] < -0.9


def test_unknown_history_widens_by_half_the_loop_and_holds_the_truth():
    table = _calibrated(RelayChain(_DENSITIES["wide"]), reversing=True)
    operator = HysteresisOperator.from_table(table, _REVERSING_NM)
    middle = 0.4 * _FS
    first = HistoryCompensator(table, operator).push([middle])
    loop = abs(table.torque([middle], [1])[0] - table.torque([middle], [-1])[0])
    assert first.half_width_nm[0] == pytest.approx(loop / 2, rel=0.35)
    assert first.half_width_nm[0] > 0.3 * loop / 2
    # after full excursions to either side nothing is unknown
    settled = HistoryCompensator(table, operator)
    settled.push([_FS, -_FS, _FS, -_FS])
    assert settled.push([middle]).half_width_nm[0] < 0.02 * loop
    settled.forget()
    assert settled.push([middle]).half_width_nm[0] == pytest.approx(first.half_width_nm[0])


@pytest.fixture(
    scope="module", params=some(itertools.product(sorted(_DENSITIES), (False, True)), by_day=2)
)
def stated(request):
    """A chain, its table with uncertainty, and the plays that follow from the table."""
    density, reversing = request.param
    table = _calibrated(RelayChain(_DENSITIES[density]), reversing, 1e-4, uncertainty=True)
    path = _REVERSING_NM if reversing else one_sided_path(_FS)
    return _DENSITIES[density], table, HysteresisOperator.from_table(table, path)


def _walk(stated, past, turns):
    """Errors along a walk in standard uncertainties, and where the past was known."""
    density, table, operator = stated
    chain = RelayChain(density)
    chain.drive([0.0, *past])
    share = np.concatenate([np.linspace(a, b, 25)[1:] for a, b in itertools.pairwise(turns)])
    reading = _FS * chain.drive(share)
    live = HistoryCompensator(table, operator).push(reading)
    low, high = operator.tracker().push(reading)
    error = np.abs(live.torque_nm - _FS * share) / live.standard_uncertainty_nm
    return error, high - low < 0.02


def test_intervals_hold_on_walks_with_inner_loops_whether_the_past_is_known_or_not(stated):
    known, unknown = [], []
    for seed in range(8):
        generator = np.random.default_rng(seed)
        turns = generator.uniform(-0.95, 0.95, 25)
        error, settled = _walk(stated, generator.uniform(-1.0, 1.0, 6), turns)
        known.extend(error[settled] <= 1.96)
        unknown.extend(error[~settled] <= 1.96)
    assert len(known) > 100
    assert np.mean(known) > 0.9
    assert np.mean(unknown) > 0.85


def test_a_zeroed_chain_reads_zero_until_it_is_loaded(stated):
    """Then hysteresis remains, as it would without the zero."""
    _, table, operator = stated
    zeroed, plain = (HistoryCompensator(table, operator) for _ in range(2))
    noise = 1e-4 * _FS * np.random.default_rng(3).standard_normal(50)
    for compensator in (zeroed, plain):
        compensator.push(_FS * np.linspace(0.0, 0.8, 50))
        compensator.push(_FS * np.linspace(0.8, 0.0, 50))
    zeroed.take_zero()
    alone = [zeroed.copy().push(float(value)) for value in noise[:1]]
    live = zeroed.push(noise)
    remaining = plain.push(noise)
    assert alone[0].torque_nm == pytest.approx(live.torque_nm[0], abs=1e-9 * _FS)
    assert np.all(np.abs(live.torque_nm - noise) < 0.3 * np.abs(noise) + 1e-5 * _FS)
    assert np.max(live.half_width_nm) < 0.2 * np.max(remaining.half_width_nm)
    loaded = _FS * np.concatenate([np.linspace(0.0, 0.8, 50), np.linspace(0.8, 0.0, 50)])
    before = plain.push(loaded)
    in_blocks = zeroed.copy()
    after = zeroed.push(loaded)
    np.testing.assert_array_equal(after.torque_nm[3:], before.torque_nm[3:])
    np.testing.assert_array_equal(after.half_width_nm[3:], before.half_width_nm[3:])
    pieces = [in_blocks.push(part).torque_nm for part in np.split(loaded, [1, 2, 60])]
    np.testing.assert_array_equal(np.concatenate(pieces), after.torque_nm)


@settings(max_examples=5)
@given(turns=st.lists(st.floats(-0.95, 0.95), min_size=3, max_size=12))
def test_after_full_cycles_no_walk_leads_far_out_of_the_intervals(stated, turns):
    error, settled = _walk(stated, [], [0.0, 1.0, -1.0, 1.0, -1.0, *turns])
    assert np.all(settled[96:])
    assert np.max(error[96:]) < 6.0


@given(
    st.lists(st.floats(-2000.0, 2000.0), min_size=1, max_size=40),
    st.lists(st.integers(0, 40), max_size=4),
)
def test_result_does_not_depend_on_how_the_stream_is_cut(readings, cuts):
    operator = HysteresisOperator.generic(_FS)
    whole = operator.tracker().push(readings)
    tracker = operator.tracker()
    edges = [0, *sorted(min(cut, len(readings)) for cut in cuts), len(readings)]
    parts = [tracker.push(readings[a:b]) for a, b in itertools.pairwise(edges)]
    for index in (0, 1):
        np.testing.assert_array_equal(np.concatenate([p[index] for p in parts]), whole[index])


@given(st.lists(st.floats(-2000.0, 2000.0), min_size=1, max_size=30), st.floats(-2000.0, 2000.0))
def test_any_known_past_lies_within_the_bounds_of_an_unknown_one(readings, start):
    operator = HysteresisOperator.generic(_FS)
    low, high = operator.tracker().push(readings)
    assert np.all(low >= -1 - 1e-12)
    assert np.all(high <= 1 + 1e-12)
    known = operator.tracker()
    known.settle(0.0)
    known.push([start])
    state, same = known.push(readings)
    np.testing.assert_array_equal(state, same)
    assert np.all((state >= low - 1e-12) & (state <= high + 1e-12))
    # bounds never part again
    assert np.all(np.diff(high - low) <= 2.0)


def test_play_wipes_out_inner_loops():
    """Madelung's rule: returning to the last turning point forgets the inner loop."""
    operator = HysteresisOperator.generic(100.0)
    tracker, direct = operator.tracker(), operator.tracker()
    for one in (tracker, direct):
        one.push([0.0, 100.0, -100.0])
    with_inner = tracker.push([50.0, 10.0, 50.0, 80.0])[0][-1]
    without = direct.push([80.0])[0][-1]
    assert with_inner == pytest.approx(without)


def test_a_table_without_branches_needs_no_history():
    reading = np.linspace(-100.0, 100.0, 21)
    model = make_model("polynomial").fit(features(reading), 1.01 * reading)
    table = compile_table(model, uncertainty=False)
    live = HistoryCompensator(table).push([0.0, 50.0, 20.0])
    np.testing.assert_allclose(live.torque_nm, [0.0, 50.5, 20.2], atol=1e-4)
    assert live.half_width_nm.max() < 1e-3


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda o: HysteresisOperator(np.array([-1.0]), np.ones(1), 0.0, o, 1.0), "above 0 N·m"),
        (lambda o: HysteresisOperator(np.ones(2), np.ones(1), 0.0, o, 1.0), "one for each width"),
        (lambda o: HysteresisOperator.generic(1.0, o).tracker().push([np.nan]), "gaps"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(InputError, match=message):
        call(one_sided_path(1.0))


@given(st.integers(0, 2**32 - 1), st.integers(1, 15), st.integers(0, 30), st.booleans())
def test_weights_that_are_not_negative_are_those_of_scipy(seed, count, more, alike) -> None:
    draws = np.random.default_rng(seed)
    matrix = draws.normal(size=(count + more, count)) + 3.0 * alike
    goal = draws.normal(size=count + more)
    solution, distance = non_negative_solution(matrix, goal)
    expected, least = nnls(matrix, goal)
    assert solution.min() >= 0.0
    assert distance == pytest.approx(least, rel=1e-9, abs=1e-12)
    assert matrix @ solution == pytest.approx(matrix @ expected, rel=1e-6, abs=1e-9)
