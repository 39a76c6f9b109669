"""Filters with uncertainty: along a stream, against PyDynamic 2.5.1 and against Monte Carlo."""

import contextlib
import io
import warnings

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from torquebench.dynamics import Filtered, FilterStream, UncertainFilter
from torquebench.errors import InputError

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # "archived since May 2024"
    from PyDynamic.uncertainty.propagate_filter import FIRuncFilter

FloatArray = NDArray[np.float64]


def fir(taps: int = 24, *, seed: int = 1) -> UncertainFilter:
    generator = np.random.default_rng(seed)
    root = 1e-3 * generator.standard_normal((taps, taps))
    return UncertainFilter(generator.standard_normal(taps) / taps, covariance=root @ root.T)


def signal(size: int = 300, seed: int = 3) -> tuple[FloatArray, FloatArray]:
    """Return a step with noise whose uncertainty changes with time."""
    generator = np.random.default_rng(seed)
    values = 100.0 * (np.arange(size) > size // 3) + generator.standard_normal(size)
    return values, 0.2 + np.abs(np.sin(np.arange(size) / 17.0)) * generator.uniform(0.5, 2.0, size)


def pydynamic_fir(*arguments: object, **options: object) -> tuple[FloatArray, FloatArray]:
    with contextlib.redirect_stdout(io.StringIO()):
        values, uncertainty = FIRuncFilter(*arguments, **options)
    return values, uncertainty


@pytest.mark.parametrize("filter_", [fir(), fir(1)])
@pytest.mark.parametrize("cuts", [[1], [1, 2, 3, 50, 299], list(range(1, 300))])
def test_blocks_of_any_size_give_the_same_to_the_last_digit(
    filter_: UncertainFilter, cuts: list[int]
) -> None:
    values, uncertainty = signal()
    whole = filter_.stream().push(values, uncertainty)
    stream = filter_.stream()
    parts = [
        stream.push(*each)
        for each in zip(np.split(values, cuts), np.split(uncertainty, cuts), strict=True)
    ]
    for name in Filtered._fields:
        joined = np.concatenate([getattr(part, name) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, name))


@pytest.mark.parametrize("changing", [False, True])
@pytest.mark.parametrize("shape", ["covariance", "standard uncertainties", "exact"])
def test_it_equals_pydynamic(changing: bool, shape: str) -> None:
    filter_ = fir()
    assert filter_.covariance is not None
    values, uncertainty = signal()
    covariance: FloatArray | None = filter_.covariance
    theirs: FloatArray | None = covariance
    if shape == "standard uncertainties":
        theirs = np.sqrt(np.diag(filter_.covariance))
        covariance = np.diag(np.diag(filter_.covariance))
    elif shape == "exact":
        theirs = covariance = None
    ours = UncertainFilter(filter_.weights, covariance)
    if not changing:
        uncertainty = np.full(values.size, 0.7)
    kind = {"kind": "diag"} if changing else {}
    noise = uncertainty if changing else 0.7
    value, u = pydynamic_fir(values, noise, ours.weights, theirs, **kind)
    filtered = ours.stream().push(values, uncertainty)
    np.testing.assert_allclose(filtered.value, value, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(filtered.standard_uncertainty, u, rtol=1e-9)


def test_uncertainty_of_changing_noise_lies_at_its_own_time() -> None:
    """PyDynamic's issue 183: u was turned round in time; the judge is a Monte Carlo simulation."""
    size, generator = 160, np.random.default_rng(8)
    uncertainty = np.where(np.arange(size) == 60, 5.0, 0.01)
    ours = UncertainFilter(fir().weights)
    draws = uncertainty * generator.standard_normal((40_000, size))
    spread = lfilter(ours.weights, [1.0], draws, axis=1).std(axis=0)
    u = ours.stream().push(np.zeros(size), uncertainty).standard_uncertainty
    np.testing.assert_allclose(u[30:], spread[30:], rtol=0.03, atol=1e-3)
    assert np.argmax(u) >= 60
    assert np.all(u[30:60] < 0.1), "nothing may be uncertain before its cause"


def test_coefficients_and_noise_together_agree_with_monte_carlo() -> None:
    generator = np.random.default_rng(9)
    filter_ = fir(8)
    values, uncertainty = signal(60)
    assert filter_.covariance is not None
    coefficients = generator.multivariate_normal(filter_.weights, filter_.covariance, 20_000)
    results = np.array(
        [
            np.convolve(row, values + uncertainty * noise)[: values.size]
            for row, noise in zip(
                coefficients, generator.standard_normal((20_000, values.size)), strict=True
            )
        ]
    )
    u = filter_.stream().push(values, uncertainty).standard_uncertainty
    np.testing.assert_allclose(u[8:], results.std(axis=0)[8:], rtol=0.03)


def test_a_fault_gets_no_number_and_begins_the_signal_anew() -> None:
    filter_, (values, uncertainty) = fir(), signal()
    values[40:43] = np.nan
    found = filter_.stream().push(values, uncertainty)
    assert np.isnan(found.value[40:43]).all()
    after = filter_.stream().push(values[43:], uncertainty[43:])
    np.testing.assert_array_equal(found.value[43:], after.value)


def test_a_copy_goes_on_by_itself() -> None:
    values, uncertainty = signal()
    stream: FilterStream = fir().stream()
    stream.push(values[:50], uncertainty[:50])
    copy = stream.copy()
    first = stream.push(values[50:], uncertainty[50:])
    second = copy.push(values[50:], uncertainty[50:])
    for ours, theirs in zip(first, second, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_what_is_no_filter_or_no_uncertainty_is_refused() -> None:
    with pytest.raises(InputError, match="finite numbers"):
        UncertainFilter([np.nan])
    with pytest.raises(InputError, match=r"\(2, 2\)"):
        UncertainFilter([1.0, 2.0], np.eye(3))
    with pytest.raises(InputError, match="below 0"):
        fir().stream().push([1.0, 2.0], [0.1, -0.1])
    with pytest.raises(InputError, match="two equal rows"):
        fir().stream().push([1.0, 2.0], [0.1])
