"""Accuracy and coverage on chains with a known truth, of seeds that nothing was developed on."""

import numpy as np
import pytest
from tests.support.chains import FAMILIES, known_form, make_chain

from torquebench.compensation import make_model


def outcomes(kind: str, points: int, families: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """RMS error over the known form's, and coverage of readings by tenth, of every chain."""
    ratios, inside = [], []
    for seed, family in enumerate(families, 1500):
        chain = make_chain(family, seed)
        data, dense = chain.calibration(points), chain.dense(200)
        model = make_model(kind, range_nm=chain.range_nm, outliers="keep")
        model.fit(data.X, data.standard_nm)
        torque, std = model.predict(dense.X, return_std=True)
        error = torque - dense.torque_nm
        bound = known_form(chain, data).predict(dense.X) - dense.torque_nm
        ratios.append(np.sqrt(np.mean(error**2) / np.mean(bound**2)))
        tenth = np.minimum((5 * (dense.torque_nm / chain.range_nm + 1)).astype(int), 9)
        covered = np.abs(error) <= 1.96 * std
        inside.append(np.bincount(tenth, covered) / np.bincount(tenth))
    return np.array(ratios), np.array(inside)


@pytest.mark.nightly
def test_the_hybrid_is_near_the_known_form_and_covers_it() -> None:
    ratios, inside = outcomes("hybrid", 50, tuple(FAMILIES))
    assert np.median(ratios) < 1.45
    assert 0.91 < inside.mean() < 0.985
    assert np.all(inside.mean(axis=0) > 0.85)
