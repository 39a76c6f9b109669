"""The GUM's own examples, and JCGM 101's, as golden values."""

from math import inf

import numpy as np
import pytest

from torquebench.uncertainty import (
    Quantity,
    check_by_monte_carlo,
    fit_line,
    monte_carlo,
    propagate,
)

# GUM, H.1: end-gauge calibration, lengths in nm
_GAUGE = [
    Quantity("standard", 50_000_623.0, 25.0, 18.0, unit="nm"),
    Quantity("difference", 215.0, 5.8, 24.0, unit="nm"),
    Quantity("comparator, random", 0.0, 3.9, 5.0, unit="nm"),
    Quantity("comparator, systematic", 0.0, 6.7, 8.0, unit="nm"),
    Quantity.rectangular("expansion", 11.5e-6, 2e-6, unit="1/K"),
    Quantity("mean temperature", -0.1, 0.2, unit="K"),
    Quantity.arcsine("cyclic temperature", 0.0, 0.5, unit="K"),
    Quantity.rectangular("expansion difference", 0.0, 1e-6, 50.0, unit="1/K"),
    Quantity.rectangular("temperature difference", 0.0, 0.05, 2.0, unit="K"),
]


def _gauge_length(standard, mean, noise, bias, alpha, theta, cycle, d_alpha, d_theta):
    return standard + mean + noise + bias - standard * (d_alpha * (theta + cycle) + alpha * d_theta)


def test_gum_h1_end_gauge():
    budget = propagate(_gauge_length, _GAUGE, unit="nm")
    assert budget.value == pytest.approx(50_000_838.0)
    assert budget.standard_uncertainty == pytest.approx(31.66, abs=0.01)
    assert budget.degrees_of_freedom == pytest.approx(16.75, abs=0.01)
    assert budget.expanded_uncertainty(0.99) == pytest.approx(92.0, abs=1.5)
    contributions = {line.name: line.contribution for line in budget.lines}
    assert contributions["temperature difference"] == pytest.approx(16.6, abs=0.05)
    assert contributions["expansion difference"] == pytest.approx(2.9, abs=0.05)
    assert contributions["expansion"] == contributions["cyclic temperature"] == 0.0
    assert budget.dominant().name == "standard"


def test_jcgm_101_end_gauge():
    """JCGM 101:2008, 9.5: 838 nm, u = 36 nm, 99 % interval [745, 932] nm."""
    result = monte_carlo(
        _gauge_length,
        _GAUGE,
        generator=np.random.default_rng(7),
        coverage_probability=0.99,
        tolerance=0.5,
        maximum_trials=3_000_000,
    )
    assert result.converged
    assert result.value - 5e7 == pytest.approx(838.0, abs=0.5)
    assert result.standard_uncertainty == pytest.approx(36.0, abs=0.5)
    assert result.low - 5e7 == pytest.approx(745.0, abs=1.5)
    assert result.high - 5e7 == pytest.approx(932.0, abs=1.5)


def test_gum_h3_thermometer():
    temperature = [
        21.521, 22.012, 22.512, 23.003, 23.507, 23.999, 24.513, 25.002, 25.503, 26.010, 26.511,
    ]  # fmt: skip
    correction = [
        -0.171, -0.169, -0.166, -0.159, -0.164, -0.165, -0.156, -0.157, -0.159, -0.161, -0.160,
    ]  # fmt: skip
    line = fit_line(temperature, correction, reference=20.0)
    assert line.intercept == pytest.approx(-0.171204, abs=1e-6)
    assert line.slope == pytest.approx(0.00218270, abs=1e-8)
    assert line.intercept_uncertainty == pytest.approx(0.0029, abs=5e-5)
    assert line.slope_uncertainty == pytest.approx(0.00067, abs=5e-6)
    assert line.correlation == pytest.approx(-0.930, abs=5e-4)
    assert line.residual_deviation == pytest.approx(0.0035, abs=5e-5)
    at_30 = line.at(30.0)
    assert at_30.value == pytest.approx(-0.149377, abs=1e-6)
    assert at_30.standard_uncertainty == pytest.approx(0.004139, abs=1e-6)
    assert at_30.degrees_of_freedom == 9.0


def test_gum_h2_resistance_from_correlated_means():
    """GUM, H.2: R = 127.732 Ω ± 0.071 Ω, X = 219.847 Ω ± 0.295 Ω, Z = 254.260 Ω ± 0.236 Ω."""
    quantities = [
        Quantity("V", 4.9990, 0.0032, 4.0, unit="V"),
        Quantity("I", 19.6610e-3, 0.0095e-3, 4.0, unit="A"),
        Quantity("phase", 1.04446, 0.00075, 4.0, unit="rad"),
    ]
    correlations = {("V", "I"): -0.36, ("V", "phase"): 0.86, ("I", "phase"): -0.65}
    expected = {
        "R": (lambda v, i, p: v / i * np.cos(p), 127.732, 0.071),
        "X": (lambda v, i, p: v / i * np.sin(p), 219.847, 0.295),
        "Z": (lambda v, i, p: v / i + 0 * p, 254.260, 0.236),
    }
    for function, value, uncertainty in expected.values():
        budget = propagate(function, quantities, correlations=correlations)
        assert budget.value == pytest.approx(value, abs=6e-4)
        assert budget.standard_uncertainty == pytest.approx(uncertainty, abs=1.5e-3)
        # three means of the same five observations: one group with 4 degrees of freedom
        assert budget.degrees_of_freedom == pytest.approx(4.0)
        assert not budget.cautions


def test_jcgm_101_additive_rectangular():
    """JCGM 101:2008, 9.2.3: four rectangular quantities, shortest 95 % interval ±3.88."""
    four = [Quantity.rectangular(f"X{k}", 0.0, 3**0.5) for k in range(4)]
    result = monte_carlo(
        lambda *x: sum(x),
        four,
        generator=np.random.default_rng(3),
        coverage_probability=0.95,
        interval_kind="shortest",
        tolerance=0.02,
    )
    assert result.standard_uncertainty == pytest.approx(2.0, abs=0.01)
    assert result.high == pytest.approx(3.88, abs=0.05)
    assert result.low == pytest.approx(-3.88, abs=0.05)


def test_jcgm_101_gum_is_not_validated_where_the_distribution_is_no_bell():
    """JCGM 101:2008, 9.2.4: one dominant rectangular quantity, GUM ±19.8, Monte Carlo ±17.0."""
    quantities = [Quantity.rectangular(f"X{k}", 0.0, 3**0.5) for k in range(3)]
    quantities.append(Quantity.rectangular("X3", 0.0, 10 * 3**0.5))
    checked = check_by_monte_carlo(
        lambda *x: sum(x),
        quantities,
        generator=np.random.default_rng(5),
        coverage_probability=0.95,
    )
    assert checked.budget.expanded_uncertainty(0.95) == pytest.approx(19.9, abs=0.1)
    assert checked.monte_carlo.high == pytest.approx(17.0, abs=0.2)
    assert not checked.agrees
    assert "do not agree" in checked.sentence()


def test_jcgm_101_normal_sum_is_validated():
    """JCGM 101:2008, 9.2.2: four normal quantities, ±3.92."""
    quantities = [Quantity(f"X{k}", 0.0, 1.0) for k in range(4)]
    checked = check_by_monte_carlo(
        lambda *x: sum(x),
        quantities,
        generator=np.random.default_rng(5),
        coverage_probability=0.95,
        significant_digits=1,
    )
    assert checked.budget.degrees_of_freedom == inf
    assert checked.monte_carlo.high == pytest.approx(3.92, abs=0.1)
    assert checked.agrees
    assert " agree" in checked.sentence()
