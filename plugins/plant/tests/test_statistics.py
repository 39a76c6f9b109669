"""Statistics of production against published examples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.calibration import individuals_chart
from torquebench.errors import InputError
from torquebench_plant.statistics import (
    BenchResult,
    capability,
    compare_benches,
    ewma_chart,
    outlying_groups,
    outlying_values,
)


def with_moments(mean: float, s: float, count: int) -> np.ndarray:
    """Return values with exactly the given mean and standard deviation."""
    x = np.random.default_rng(1).normal(size=count)
    return mean + s * (x - x.mean()) / x.std(ddof=1)


def test_cp_and_its_interval_as_montgomery_has_them() -> None:
    """Introduction to Statistical Quality Control, 6th ed., example 8.4: 62, 38, s = 1.75."""
    found = capability(with_moments(50.0, 1.75, 20), lower=38.0, upper=62.0)
    assert found.cp == pytest.approx(2.29, abs=0.005)
    assert found.cp_interval == pytest.approx((1.57, 3.01), abs=0.015)


def test_cpk_and_its_interval_as_montgomery_has_them() -> None:
    """Montgomery, example 8.5: n = 20, Cpk = 1.33, 95 %: 0.88 to 1.78."""
    found = capability(with_moments(0.0, 1.0, 20), upper=3.99)
    assert found.cpk == pytest.approx(1.33)
    assert found.cpk_interval == pytest.approx((0.88, 1.78), abs=0.01)
    assert found.cp is None


def test_capability_as_nist_has_it() -> None:
    """NIST/SEMATECH e-Handbook, 7.1.6: limits 8 and 20, mean 16, s = 2: Cp 1.0, Cpk 0.6667."""
    found = capability(with_moments(16.0, 2.0, 30), lower=8.0, upper=20.0)
    assert found.cp == pytest.approx(1.0)
    assert found.cpk == pytest.approx(0.6667, abs=5e-5)


def test_a_common_uncertainty_widens_cpk_and_the_share_of_measuring_is_stated() -> None:
    values = with_moments(0.0, 1.0, 50)
    plain, doubtful = (capability(values, upper=4.0, u_common=u, u_value=0.5) for u in (0.0, 0.6))
    width = [each.cpk_interval[1] - each.cpk_interval[0] for each in (plain, doubtful)]
    assert width[1] ** 2 - width[0] ** 2 == pytest.approx((2 * 1.959964 * 0.2) ** 2, rel=1e-5)
    assert plain.measurement_share == pytest.approx(0.25)


def test_the_interval_of_cpk_covers_what_it_says() -> None:
    """Of the intervals of 3,000 simulated samples with Cpk = 1.2, 95 % contain 1.2."""
    generator = np.random.default_rng(7)
    held = 0
    for _ in range(3000):
        low, high = capability(generator.normal(0.0, 1.0, 40), lower=-3.6, upper=9.0).cpk_interval
        held += low <= 1.2 <= high
    assert held / 3000 == pytest.approx(0.95, abs=0.015)


@pytest.mark.parametrize(
    ("values", "limits", "named"),
    [
        ([1.0, 2.0], {"upper": 3.0}, "2 values"),
        ([1.0, 1.0, 1.0], {"upper": 3.0}, "spread"),
        ([1.0, 2.0, 3.0], {}, "without a limit"),
        ([1.0, 2.0, 3.0], {"lower": 3.0, "upper": 1.0}, "below"),
    ],
)
def test_what_gives_no_capability_is_refused(
    values: list[float], limits: dict[str, float], named: str
) -> None:
    with pytest.raises(InputError, match=named):
        capability(values, **limits)


NIST_EWMA = [
    *(52.0, 47.0, 53.0, 49.3, 50.1, 47.0, 51.0, 50.1, 51.2, 50.5),
    *(49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1),
]
NIST_AVERAGES = [
    *(50.60, 49.52, 50.56, 50.18, 50.16, 49.21, 49.75, 49.85, 50.26, 50.33),
    *(50.11, 49.36, 49.52, 50.05, 49.38, 49.92, 50.73, 51.23, 51.94, 51.99),
]


def test_ewma_as_nist_has_it() -> None:
    """NIST/SEMATECH e-Handbook, 6.3.2.4: weight 0.3, centre 50, s = 2.0539, limits 47.41, 52.59."""
    chart = ewma_chart(NIST_EWMA, weight=0.3, width=3.0, centre=50.0, sigma=2.0539)
    assert chart.average == pytest.approx(NIST_AVERAGES, abs=0.006)
    assert (chart.lower[-1], chart.upper[-1]) == pytest.approx((47.4115, 52.5884), abs=6e-4)
    assert chart.outside == ()


def test_ewma_as_montgomery_has_it() -> None:
    """6th ed., example 9.2, table 9.10: weight 0.1, L = 2.7; the last averages leave the limits."""
    values = [
        *(9.45, 7.99, 9.29, 11.66, 12.16, 10.18, 8.04, 11.46, 9.20, 10.34),
        *(9.03, 11.47, 10.51, 9.40, 10.08, 9.37, 10.62, 10.31, 8.52, 10.84),
        *(10.90, 9.33, 12.29, 11.50, 10.60, 11.08, 10.38, 11.62, 11.31, 10.52),
    ]
    chart = ewma_chart(values, weight=0.1, width=2.7, centre=10.0, sigma=1.0)
    assert chart.average[:3] == pytest.approx((9.945, 9.7495, 9.7036), abs=6e-5)
    assert (chart.upper[0], chart.upper[1], chart.upper[-1]) == pytest.approx(
        (10.27, 10.36, 10.62), abs=0.005
    )
    assert chart.average[-2:] == pytest.approx((10.6468, 10.6341), abs=6e-5)
    assert chart.outside == (28, 29)


def test_shewhart_as_nist_has_it() -> None:
    """NIST/SEMATECH e-Handbook, 6.3.2.2: ten batches, limits 45.8159 and 55.8041."""
    chart = individuals_chart([49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1])
    assert chart.centre == pytest.approx(50.81)
    assert chart.moving_range_mean == pytest.approx(1.8778, abs=5e-5)
    assert (chart.lower, chart.upper) == pytest.approx((45.8159, 55.8041), abs=0.002)


def test_modified_z_scores_find_single_values() -> None:
    values = [0.80, 0.81, 0.79, 0.82, 0.80, 0.81, 1.20]
    assert outlying_values(values) == (6,)
    assert outlying_values([1.0] * 9 + [2.0]) == (9,)
    assert outlying_values([1.0] * 5) == ()


def test_benches_and_batches_that_stand_out_are_found_and_others_are_not() -> None:
    generator = np.random.default_rng(3)
    values = generator.normal(1.0, 0.05, 300)
    groups = [f"B{k % 10}" for k in range(300)]
    assert not [each for each in outlying_groups(values, groups) if each.outlying]
    shifted = values + np.array([0.06 if name == "B7" else 0.0 for name in groups])
    first, *_ = outlying_groups(shifted, groups)
    assert (first.group, first.outlying, first.count) == ("B7", True, 30)


@given(st.lists(st.tuples(st.floats(-100, 100), st.floats(0.01, 10)), min_size=2, max_size=6))
def test_en_against_the_others_is_the_degree_of_equivalence(
    pairs: list[tuple[float, float]],
) -> None:
    """E_n equals Cox's d/U(d) from the mean of all benches, with which the bench is correlated."""
    found = compare_benches([BenchResult(str(k), x, u) for k, (x, u) in enumerate(pairs)])
    for each in found.benches:
        u_d = np.sqrt(each.result.expanded_uncertainty**2 - found.expanded_uncertainty**2)
        if not u_d > 1e-3 * each.result.expanded_uncertainty:
            continue  # a difference of two nearly equal squares has no digits left
        assert each.en == pytest.approx((each.result.value - found.mean) / u_d, rel=1e-6, abs=1e-6)


def test_en_against_a_reference_bench() -> None:
    """E_n = (10.5 - 10.0)/√(0.3² + 0.4²) = 1 (ISO/IEC 17043, B.3.1.3)."""
    results = [BenchResult("A", 10.0, 0.3), BenchResult("B", 10.5, 0.4), BenchResult("C", 9.9, 0.4)]
    found = compare_benches(results, "A")
    assert [each.en for each in found.benches] == pytest.approx([0.0, 1.0, -0.2])
    assert all(each.agrees for each in found.benches)
    with pytest.raises(InputError, match="reference bench D"):
        compare_benches(results, "D")
    with pytest.raises(InputError, match="each once"):
        compare_benches([results[0], results[0]])
    with pytest.raises(InputError, match="U above 0"):
        compare_benches([results[0], BenchResult("Z", 1.0, 0.0)])
