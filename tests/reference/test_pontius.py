"""NIST's certified regressions (StRD): digits, deviations, and which model is selected."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from torquebench.compensation import PolynomialModel, compare, noise_floor
from torquebench.compensation.polynomial import OrthogonalPolynomial

FloatArray = NDArray[np.float64]
Extended = NDArray[np.longdouble]


def read_nist(path: Path) -> tuple[FloatArray, FloatArray, float, FloatArray, FloatArray]:
    """Certified parameters, their deviations, residual deviation, x and y of a StRD file."""
    lines = path.read_text().splitlines()
    certified = np.array(
        [
            [float(word) for word in line.split()[1:3]]
            for line in lines[:60]
            if re.match(r"\s+B\d+\s", line)
        ]
    )
    residual = next(
        float(line.split()[-1])
        for line in lines[:60]
        if re.match(r"\s+Standard Deviation\s+\d", line)
    )
    data = np.array([[float(word) for word in line.split()] for line in lines[60:] if line.strip()])
    return certified[:, 0], certified[:, 1], residual, data[:, 1], data[:, 0]


def powers_of(fitted: OrthogonalPolynomial) -> Extended:
    """Return the coefficients of 1, x, x², …, computed in extended precision."""

    def times_x(coefficients: Extended) -> Extended:
        return np.concatenate([np.zeros(1, np.longdouble), coefficients[:-1]])

    before, total, now = np.zeros((3, fitted.coefficients.size), np.longdouble)
    now[0] = 1.0
    for value, alpha, beta in zip(fitted.coefficients, fitted.alpha, fitted.beta, strict=True):
        total = total + value * now
        before, now = now, times_x(now) - alpha * now - beta * before
    result = np.zeros_like(total)  # of u = (x - centre) / scale, by Horner's scheme
    for value in total[::-1]:
        moved = times_x(result) - np.longdouble(fitted.centre) * result
        result = moved / np.longdouble(fitted.scale)
        result[0] += value
    return result


@pytest.mark.parametrize(
    ("name", "degree", "digits"), [("Pontius", 2, 12), ("Norris", 1, 12), ("Filip", 10, 12)]
)
def test_certified_parameters_to_the_digits_that_double_precision_holds(
    reference_data: Callable[[str], Path], name: str, degree: int, digits: int
) -> None:
    parameters, _, residual, x, y = read_nist(reference_data(f"nist-strd/{name}.dat"))
    model = PolynomialModel(degree=degree).fit(x[:, None], y)
    np.testing.assert_allclose(
        powers_of(model.polynomials_[0]).astype(float), parameters, rtol=10.0**-digits
    )
    assert model.noise_nm_ == pytest.approx(residual, rel=1e-9)


@pytest.mark.parametrize(("name", "degree"), [("Pontius", 2), ("Norris", 1), ("Filip", 10)])
def test_uncertainty_of_the_curve_is_the_certified_deviation_of_its_intercept(
    reference_data: Callable[[str], Path], name: str, degree: int
) -> None:
    _, deviations, _, x, y = read_nist(reference_data(f"nist-strd/{name}.dat"))
    model = PolynomialModel(degree=degree).fit(x[:, None], y)
    at_zero = model.noise_nm_ * np.sqrt(model.polynomials_[0].relative_variance(np.zeros(1))[0])
    assert at_zero == pytest.approx(deviations[0], rel=1e-9)


def test_a_quadratic_wins_on_the_load_cell_and_leaves_the_run_to_run_scatter(
    reference_data: Callable[[str], Path],
) -> None:
    _, _, _, load, deflection = read_nist(reference_data("nist-strd/Pontius.dat"))
    # As a torque chain would give it: reading in the unit of the standard, by the nominal slope.
    reading = deflection * (load.max() / deflection.max())
    comparison = compare(reading[:, None], load)
    assert "worse" not in comparison.score("polynomial-2").reason
    assert not comparison.outliers
    noise = noise_floor(reading[:, None], load)
    assert noise is not None
    assert noise.degrees_of_freedom == 20
    # Ratio of variances within what 20 degrees of freedom allow in 99 of 100 repetitions.
    ratio = (comparison.models["polynomial-2"].noise_nm_ / noise.standard_deviation_nm) ** 2
    low, high = chi2.ppf([0.005, 0.995], 20) / 20
    assert low < 1.0 / ratio < high
    assert comparison.score("polynomial-2").rms_nm < 1.1 * noise.standard_deviation_nm
    assert comparison.score("polynomial-1").rms_nm > 5 * noise.standard_deviation_nm
