"""Tables that agree with themselves, and parts that don't: found, placed, named with their cause.

The core of `benchmarks.contradictions` at few seeds; nothing of the simulated bench is in it.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import islice

import numpy as np
import pytest
from tests.support.chains import FAMILIES
from tests.support.contradicting_tables import FAULTS, STRANGERS, chain_table, stranger, trial
from tests.support.draws import some

from torquebench.calibration import (
    CalibrationData,
    Disagreement,
    Examination,
    examine,
    examine_table,
)

SIZE = 40


def table(
    seed: int = 0, *, scatter: float = 0.02, loop: float = 0.05, cycles: int = 1
) -> CalibrationData:
    """Return a chain of 100 N·m with a quadratic error, a loop and scatter, N·m."""
    rng = np.random.default_rng(seed)
    leg = np.concatenate([np.arange(1, 11), np.arange(9, -1, -1)]) * 10.0
    torque = np.tile(np.concatenate([leg, -leg]), cycles)
    branch = np.tile(np.repeat([1, -1, 1, -1], 10), cycles)
    error = 0.3 * torque / 100.0 + 0.2 * (torque / 100.0) ** 2
    error += loop * branch * (1.0 - np.abs(torque) / 100.0)
    series = np.repeat(np.arange(2 * cycles), 20) + 1
    reading = torque - error + scatter * rng.normal(size=torque.size)
    return CalibrationData(reading, torque, series, branch, 100.0, tared=True)


def with_reading(data: CalibrationData, rows: slice, change: Callable[[np.ndarray], np.ndarray]):
    reading = np.array(data.reading_nm)
    reading[rows] = change(reading[rows])
    return replace(data, reading_nm=reading)


def only(data: CalibrationData) -> Disagreement:
    (part,) = examine(data).disagreements
    return part


@cache
def healthy(seed: int) -> tuple[CalibrationData, Examination]:
    families = list(FAMILIES)
    data = chain_table(families[seed % len(families)], seed, 24)
    return data, examine_table(data)


@pytest.mark.parametrize("family", some(FAMILIES, by_day=9))
def test_chains_of_every_family_agree_with_themselves(family: str) -> None:
    for seed, points in ((0, 50), (1, 24)):
        assert examine_table(chain_table(family, seed, points)).disagreements == ()


@pytest.mark.parametrize("family", some(STRANGERS, by_day=6))
def test_tables_of_other_laboratories_agree_with_themselves(family: str) -> None:
    for seed in range(2):
        assert examine_table(stranger(family, seed)).disagreements == ()


@pytest.mark.parametrize("fault", some(FAULTS, by_day=0))
def test_injected_faults_are_found_at_the_right_rows(fault: str) -> None:
    """Twenty faults of 5 U to 30 U, of which 3 U and more can't be the chain itself.

    A chain of two directions can have nearly every shape of one of them: few flipped signs are 3 U
    beside it, but all are large.
    """
    least = 0.0 if fault == "sign" else 3.0
    tried = (trial(*healthy(seed), "", fault, seed, least=least) for seed in range(400))
    apparent = list(islice((one for one in tried if one is not None), 20))
    assert len(apparent) == 20
    assert np.mean([each.placed for each in apparent]) >= 0.95


@pytest.mark.nightly
def test_two_loops_show_faults_of_every_kind() -> None:
    """Sixty of 3 U to 30 U, whatever their shape: one loop can't tell all of them."""
    placed = []
    for seed, family in zip(range(15), FAMILIES, strict=False):
        data = chain_table(family, seed, 24, 2)
        agreed = examine_table(data)
        assert agreed.disagreements == ()
        for fault in ("zero", "temporary zero", "scale", "row"):
            found = trial(data, agreed, family, fault, seed)
            assert found is not None
            placed.append(found.placed)
    assert np.mean(placed) >= 0.95


def test_a_zero_that_moves_is_named_with_rows_and_size() -> None:
    for first in (6, 14, 26, 33):
        part = only(with_reading(table(), slice(first, None), lambda x: x - 0.5))
        assert (part.cause, part.first, part.last) == ("zero", first, SIZE - 1)
        assert part.zero_nm == pytest.approx(0.5, abs=part.zero_expanded_nm)
        assert part.scale_percent is None


def test_a_scale_that_changes_is_named_with_rows_and_size() -> None:
    for first in (4, 8, 13, 30):
        part = only(with_reading(table(), slice(first, None), lambda x: 0.97 * x))
        assert part.cause == "scale"
        assert part.first_range[0] <= first <= part.first_range[1]
        assert part.scale_percent == pytest.approx(3.0, abs=max(part.scale_expanded_percent, 0.2))


def test_a_change_that_either_cause_explains_names_none() -> None:
    """Over four rows of nearly one torque, a zero and a scale look the same in their scatter."""
    part = only(with_reading(table(scatter=0.1), slice(8, 12), lambda x: x - 1.0))
    assert part.cause == "unknown"
    assert (part.first, part.last) == (8, 11)
    assert part.size_nm == pytest.approx(1.0, abs=0.3)


def test_a_series_with_the_wrong_sign_is_named() -> None:
    part = only(with_reading(table(), slice(20, 40), np.negative))
    assert part.cause == "sign"
    assert part.first_range[0] <= 20 <= part.first_range[1]
    assert part.last_range[0] <= 39 <= part.last_range[1]


@pytest.mark.parametrize("column", ["reading_nm", "standard_nm"])
def test_a_stuck_value_is_named(column: str) -> None:
    data = table()
    values = np.array(getattr(data, column))
    values[25:31] = values[24]
    part = only(replace(data, **{column: values}))
    assert (part.cause, part.constant) == ("stuck", column.removesuffix("_nm"))
    assert (part.first, part.last) == (25, 30)


def test_a_wrong_row_is_a_row_and_no_contradiction() -> None:
    for row in (3, 12, 27, 36):
        for error in (0.3, 5.0, 60.0):
            found = examine(with_reading(table(), slice(row, row + 1), lambda x, e=error: x + e))
            assert [each.point for each in found.wrong_rows] == [row]
            assert found.wrong_rows[0].residual_nm == pytest.approx(-error, abs=0.15)
            assert found.disagreements == ()
            assert all(each.last < row or row < each.first for each in found.doubts)


def test_two_faults_are_two() -> None:
    data = with_reading(table(cycles=2), slice(10, 20), lambda x: x + 1.0)
    data = with_reading(data, slice(55, 56), lambda x: x - 2.0)
    found = examine(data)
    assert [(each.first, each.last) for each in found.disagreements] == [(10, 19)]
    assert [each.point for each in found.wrong_rows] == [55]


def test_what_a_chain_may_do_is_no_fault() -> None:
    """Spans that differ over the directions, a loop of 2 %, a drift, a wrong scale, a zero."""
    data = table()
    u, time = data.standard_nm / 100.0, np.linspace(0.0, 1.0, SIZE)
    for change in (
        np.where(u > 0, 2.0 * u, -1.0 * u),
        2.0 * data.branch * np.sign(u) * (np.abs(u) < 1.0),
        0.3 * time,
        0.2 * np.log1p(time / 0.05),
        -25.0 * u,
        np.full(SIZE, 7.0),
        0.4 * np.sin(2 * np.pi * u / 0.4),
    ):
        found = examine(replace(data, reading_nm=data.reading_nm + change))
        assert found.disagreements == ()


def test_the_scatter_that_repeats_show_is_not_exceeded_by_it() -> None:
    """A change within what the series themselves scatter by is none."""
    rng = np.random.default_rng(4)
    data = table(cycles=4)
    spans = 0.01 * rng.normal(size=9)
    scattered = data.reading_nm * (1.0 + spans[data.series])
    assert examine(replace(data, reading_nm=scattered)).disagreements == ()


def test_few_points_show_what_they_can() -> None:
    few = CalibrationData([5.0, 10.0], [5.0, 10.0], [1, 1], [1, 1], 10.0)
    assert examine(few).disagreements == ()
    same = CalibrationData([5.0] * 8, [5.0] * 8, [1] * 8, [1] * 8, 10.0)
    assert examine(same).disagreements == ()


def test_a_long_ramp_is_placed_to_its_block() -> None:
    torque = np.concatenate([np.linspace(0.0, 100.0, 700), np.linspace(100.0, 0.0, 700)])
    noise = 0.02 * np.random.default_rng(2).normal(size=1400)
    reading = torque * 1.001 + noise + np.where(np.arange(1400) >= 400, 0.3, 0.0)
    data = CalibrationData(reading, torque, [1] * 1400, [1] * 700 + [-1] * 700, 100.0, tared=True)
    part = only(data)
    assert part.first_range[0] - 8 <= 400 <= part.first_range[1] + 8
    assert part.last == 1399
