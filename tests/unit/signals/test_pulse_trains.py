import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from torquebench.signals.pulse_train import irregularities


@given(
    st.sets(st.integers(5, 90), max_size=6),
    st.integers(100, 5000),
    st.integers(0, 2**32 - 1),
)
def test_missing_pulses_are_counted(missing, period, seed):
    jitter = np.random.default_rng(seed).integers(-period // 50, period // 50 + 1, 100)
    ticks = np.delete(np.arange(100) * period + jitter, sorted(missing))
    assert irregularities(ticks) == (len(missing), 0, False)


def test_a_regular_train_has_none():
    assert irregularities(np.arange(0, 1000, 7), 1000) == (0, 0, False)


def test_a_train_that_stopped():
    assert irregularities(np.arange(0, 1000, 10), 1200).stopped


def test_too_few_edges_tell_nothing():
    assert irregularities(np.array([5])) == (0, 0, False)
