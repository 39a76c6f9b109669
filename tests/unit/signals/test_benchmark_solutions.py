"""What the benchmark compares with gives the counter's own results."""

import numpy as np
import pytest
from benchmarks import signal_solutions
from benchmarks.signals import noise_ratio, pulse_train
from tests.counting import counted

from torquebench.signals import EdgeBlock

TRAIN = pulse_train(60e3, 3000, seed=1)


@pytest.mark.parametrize("name", signal_solutions.available())
def test_other_solutions_agree(name, monkeypatch):
    monkeypatch.setenv("POLARS_MAX_THREADS", "1")
    frequency = signal_solutions.available()[name](TRAIN, 100_000, 100e6)
    ours = counted(EdgeBlock(TRAIN, 0, int(TRAIN[-1]) + 1, 100e6), 1e-3)["frequency_hz"]
    # The first window began before the train did.
    np.testing.assert_allclose(frequency, ours[1 : 1 + frequency.size], rtol=1e-12)
    assert frequency.size >= ours.size - 2


def test_the_noise_is_measured_against_theory():
    scatter, ratio = noise_ratio("regression", windows=400)
    assert ratio == pytest.approx(1.0, abs=0.12)
    assert scatter == pytest.approx(2.7, rel=0.15)
