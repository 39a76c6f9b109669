"""What the benchmark compares with gives the counter's own results."""

import numpy as np
import pytest
from benchmarks import signal_solutions
from benchmarks.signals import noise_ratio, pulse_train

from torquebench.signals import EdgeBlock, edges_of_bits, regression

TRAIN = pulse_train(60e3, 3000, seed=1)


@pytest.mark.parametrize("name", signal_solutions.available())
def test_other_solutions_agree(name, monkeypatch):
    monkeypatch.setenv("POLARS_MAX_THREADS", "1")
    frequency = signal_solutions.available()[name](TRAIN, 100_000, 100e6)
    counted = regression(EdgeBlock(TRAIN, 0, int(TRAIN[-1]) + 1, 100e6), 1e-3).frequency_hz
    # The first window began before the train did.
    np.testing.assert_allclose(frequency, counted[1 : 1 + frequency.size], rtol=1e-12)
    assert frequency.size >= counted.size - 2


def test_bits_agree():
    packed = np.random.default_rng(2).integers(0, 256, 500, dtype=np.uint8)
    assert np.array_equal(
        signal_solutions.bits_with_numpy(packed), edges_of_bits(packed, 1.0).ticks
    )


def test_the_noise_is_measured_against_theory():
    scatter, ratio = noise_ratio("regression", both_edges=False, windows=400)
    assert ratio == pytest.approx(1.0, abs=0.12)
    assert scatter == pytest.approx(2.7, rel=0.15)
