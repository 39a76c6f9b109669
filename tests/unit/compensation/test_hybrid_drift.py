"""Creep of the zero as a Gaussian process over the time of a calibration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torquebench.compensation.hybrid.drift import NO_DRIFT_SHARE, drift_kinds


@settings(max_examples=20)
@given(clocks=st.integers(1, 2), seed=st.integers(0, 1000))
def test_every_kind_starts_at_the_zero_and_ends_with_unit_variance(clocks: int, seed: int) -> None:
    inner = np.random.default_rng(seed).uniform(0, 1, (clocks, 8))
    kinds = drift_kinds(np.column_stack([np.zeros(clocks), inner, np.ones(clocks)]))
    assert len(kinds) == clocks + 1
    assert sum(kind.share for kind in kinds) == pytest.approx(1.0 - NO_DRIFT_SHARE)
    for kind in kinds:
        assert np.linalg.eigvalsh(kind.covariance)[0] > -1e-12
        np.testing.assert_allclose(kind.covariance[0], 0.0, atol=1e-15)
        assert kind.covariance[-1, -1] == pytest.approx(1.0)


def test_without_a_clock_nothing_creeps() -> None:
    assert drift_kinds(np.zeros((0, 5))) == []
