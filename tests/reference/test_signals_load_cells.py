"""Steady values of a real staircase: two load cells in series, with converter read errors."""

import numpy as np
import pytest
from scipy.io import loadmat

from torquebench.signals import steady_value
from torquebench.signals.steady import outliers

# Plateaus of cell 1 in counts above the first zero, from the data set's description, and the
# samples of the recording without clock in which they lie.
PLATEAUS = [0, 9920, 19826, 29716, 39560, 29648, 19711, 9853, -185]
LEVELS = [
    (0, 330), (360, 650), (675, 820), (843, 915), (966, 1075), (1098, 1146), (1212, 1700),
    (1732, 1825), (1842, 2040),
]  # fmt: skip


@pytest.fixture(scope="module")
def recording(reference_data):
    table = np.loadtxt(reference_data("cie324-loadcell/LoadCellCalibrationData.txt"), delimiter=",")
    return table[:, 0] / 1e3, table[:, 10], table[:, 11]


def test_the_read_errors_are_found(recording):
    _, first, second = recording
    for cell in (first, second):
        errors = np.flatnonzero(np.abs(cell) > 1e6)
        assert errors.size == 4
        found = np.flatnonzero(outliers(cell))
        assert set(errors) <= set(found)
        # beside them only single samples at the moments when a weight is placed
        assert found.size <= errors.size + 6


def test_plateaus_give_their_published_values(reference_data):
    table = loadmat(reference_data("cie324-loadcell/loadCellCalData.mat"))["acquiredData"]
    cell = table[:, 3].astype(float)
    steady = [steady_value(np.arange(low, high) * 1.0, cell[low:high]) for low, high in LEVELS]
    values = np.array([step.value for step in steady])
    # within 0.25 % of span: the description's values are of single samples
    np.testing.assert_allclose(values - values[0], PLATEAUS, atol=0.0025 * 39560)
    hysteresis = values[[7, 6, 5]] - values[[1, 2, 3]]
    assert np.all(hysteresis < 0)
    assert all(step.standard_error < 10 for step in steady)


def test_a_outlier_changes_a_plateau_by_less_than_its_error(recording):
    time, first, _ = recording
    low, high = 40, 155
    window = slice(low, high)
    outlying = np.flatnonzero(np.abs(first[window]) > 1e6)
    assert outlying.size == 1
    whole = steady_value(time[window], first[window], settling_limit=0.0)
    without = steady_value(
        np.delete(time[window], outlying), np.delete(first[window], outlying), settling_limit=0.0
    )
    assert abs(whole.value - without.value) < 0.1 * without.standard_error
