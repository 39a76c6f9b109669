"""The worked example of a static calibration, golden/static_torque_calibration.json."""

import json
from decimal import Decimal

import numpy as np
import pytest

from torquebench.calibration import LoadingSeries, classify, evaluate_static

# 1e-9 of each value, but never below the last digits of a double in the indication itself: the
# smallest f_a of 7.7e-6 % is a difference of two numbers that agree in their first seven digits.
RELATIVE = 1e-9
DOUBLE_PERCENT = 100 * 2 * np.finfo(np.float64).eps


@pytest.fixture
def golden(reference_data):
    path = reference_data("golden/static_torque_calibration.json")
    return json.loads(path.read_text(encoding="utf-8"))


def deflections(entry):
    """Return I − I₀ of the decimal texts, each rounded once."""
    zero = Decimal(entry["I0"])
    return np.array([float(Decimal(text) - zero) for text in entry["I"]])


@pytest.fixture
def evaluation(golden):
    series = []
    for entry in golden["inputs"].values():
        if entry["dir"] == "dec":
            rising = series.pop()
            series.append(
                LoadingSeries(
                    rising.position_deg,
                    rising.increasing,
                    deflections(entry),
                    float(Decimal(entry["If"]) - Decimal(entry["I0"])),
                )
            )
        else:
            end = entry.get("If")
            zero_return = None if end is None else float(Decimal(end) - Decimal(entry["I0"]))
            series.append(LoadingSeries(entry["pos"], deflections(entry), zero_return=zero_return))
    return evaluate_static(
        golden["M_Nm"],
        series,
        resolution=golden["inputs_scalar"]["r_Hz"],
        reference_uncertainty_percent=golden["inputs_scalar"]["W_ref_pct_k2"],
        scale=15.0,
    )


def assert_golden(found, expected):
    np.testing.assert_allclose(found, expected, rtol=RELATIVE, atol=DOUBLE_PERCENT)


def test_mean_span_and_sensitivity(golden, evaluation):
    np.testing.assert_allclose(evaluation.mean, golden["mean_increasing_Hz"], rtol=1e-14)
    assert evaluation.span == pytest.approx(golden["span_Hz"], rel=1e-14)
    assert evaluation.sensitivity == pytest.approx(golden["sensitivity_Hz_per_Nm"], rel=1e-14)


def test_relative_deviations(golden, evaluation):
    assert_golden(evaluation.repeatability_percent, golden["b_prime_pct"])
    assert_golden(evaluation.reproducibility_range_percent, golden["b_range_pct"])
    assert_golden(evaluation.reproducibility_deviation_percent, golden["b_std_pct"])
    assert_golden(evaluation.reversibility_percent, golden["h_pct"])
    assert_golden(evaluation.zero_residual_percent, golden["f0_pct"])
    assert_golden(evaluation.resolution_percent, golden["r_pct"])
    assert_golden(evaluation.indication_deviation_percent, golden["fq_pct_fixed_scale_15HzPerNm"])


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_interpolations_through_zero(golden, evaluation, degree):
    expected = golden["fit_through_zero"][str(degree)]
    found = evaluation.interpolation(degree)
    np.testing.assert_allclose(found.coefficients, expected["coef_Hz_per_Nm_pow"], rtol=1e-9)
    assert_golden(found.deviation_percent, expected["fa_pct"])


@pytest.mark.parametrize(
    ("name", "degree", "form", "decreasing"),
    [
        ("W_pct_k2_range_cubic_inc", 3, "range", False),
        ("W_pct_k2_range_linear_incdec", 1, "range", True),
        ("W_pct_k2_std_cubic_inc", 3, "standard-deviation", False),
        ("W_pct_k2_std_linear_incdec", 1, "standard-deviation", True),
    ],
)
def test_expanded_uncertainty_in_four_variants(golden, evaluation, name, degree, form, decreasing):
    found = evaluation.uncertainty_percent(degree, form, decreasing=decreasing)
    np.testing.assert_allclose(found, golden[name], rtol=RELATIVE)


def test_interval_about_the_fixed_scale(golden, evaluation):
    found = evaluation.interval_percent(1, "standard-deviation", decreasing=True)
    np.testing.assert_allclose(found, golden["W_interval_pct_std_fixed_scale"], rtol=RELATIVE)


def test_classes(golden, evaluation):
    cubic = classify(evaluation, degree=3, decreasing=False)
    assert cubic.whole_range == golden["class_cubic_increasing"]
    linear = classify(evaluation, degree=1, decreasing=True)
    assert linear.whole_range == golden["class_linear_inc_dec"]
