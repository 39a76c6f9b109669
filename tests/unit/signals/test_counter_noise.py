"""Noise of the counters against the formulas of the field (Rubiola et al., arXiv:1506.05009)."""

import numpy as np
import pytest
from tests.counting import counted

from torquebench.signals import EdgeBlock

TIMEBASE = 100e6
FREQUENCY = 61_234.567


def errors(method, jitter_s, window_s, *, windows=2500, seed=3):
    """Errors of many windows, each with its own phase, and the uncertainty that is stated."""
    generator = np.random.default_rng(seed)
    frequency = FREQUENCY * generator.uniform(0.99, 1.01, windows)
    period = TIMEBASE / frequency[:, None]
    length = round(window_s * TIMEBASE)
    starts = np.arange(windows) * length
    number = np.arange(int(length / period.max()) - 1)
    phase = generator.uniform(0.01, 1.0, (windows, 1)) * period
    times = starts[:, None] + phase + number * period
    times = times + generator.normal(0.0, jitter_s * TIMEBASE, times.shape)
    block = EdgeBlock(np.floor(times).astype(np.int64).ravel(), 0, windows * length, TIMEBASE)
    record = counted(block, window_s, method, edge_jitter_s=jitter_s, check_train=False)
    return record["frequency_hz"] - frequency, record["frequency_uncertainty_hz"]


# Relative standard deviations over τ with n edges: √2 σ_t/τ, which is T_c/(√6 τ) for
# quantisation alone, √12 σ_t/(τ√n) and 4 σ_t/(τ√n), with σ_t² = σ_j² + T_c²/12.
FORMULAS = {
    "reciprocal": lambda noise, tau, edges: np.sqrt(2) * noise / tau + 0 * edges,
    "regression": lambda noise, tau, edges: np.sqrt(12) * noise / (tau * np.sqrt(edges)),
    "triangular": lambda noise, tau, edges: 4 * noise / (tau * np.sqrt(edges)),
}


@pytest.mark.parametrize("window_s", [1e-3, 10e-3])
@pytest.mark.parametrize(
    ("method", "jitter_s"),
    [("reciprocal", 0.0), ("reciprocal", 5e-9), ("regression", 5e-9), ("triangular", 5e-9)],
)
def test_noise_is_within_15_percent_of_the_formula(method, jitter_s, window_s):
    windows = 2500 if window_s < 5e-3 else 600
    error, stated = errors(method, jitter_s, window_s, windows=windows)
    measured = float(np.sqrt(np.mean(error**2)))
    noise = np.sqrt(jitter_s**2 + 1 / TIMEBASE**2 / 12)
    expected = FORMULAS[method](noise, window_s, window_s * FREQUENCY) * FREQUENCY
    assert measured == pytest.approx(expected, rel=0.15)
    assert measured == pytest.approx(float(stated.mean()), rel=0.08)


def test_quantisation_alone_leaves_the_regression_below_its_formula():
    error, stated = errors("regression", 0.0, 10e-3, windows=600)
    assert np.sqrt(np.mean(error**2)) < 1.15 * stated.mean()


def test_a_wrong_timebase_scales_every_frequency(pulse_train):
    # The counter's clock runs 10 ppm fast: it counts more ticks for the same time.
    ticks = pulse_train(60e3, 50e-3, timebase_hz=TIMEBASE * (1 + 1e-5), jitter_s=1e-9)
    record = counted(EdgeBlock(ticks[ticks < 4_000_000], 0, 4_000_000, TIMEBASE), 10e-3)
    np.testing.assert_allclose(record["frequency_hz"], 60e3 * (1 - 1e-5), rtol=1e-7)
