"""Two load cells in series, weights of 10 lb added and removed: plateaus, hysteresis, outliers.

Source: CIE324 swing project, University at Buffalo (MIT). Steps are in lb and indications in raw
counts; the evaluation is in relative quantities, so the unit doesn't matter to it.
"""

import numpy as np
import pytest
from scipy.io import loadmat

from torquebench.calibration import LoadingSeries, evaluate_static
from torquebench.signals import steady_value

STEP_COUNTS = 9900.0
PATH = [0, 1, 2, 3, 4, 3, 2, 1, 0]


def plateaus(time_s, counts):
    """Return the steady values of the nine plateaus, above the first one."""
    start = np.median(counts[:20])
    level = np.rint((counts - start) / STEP_COUNTS)
    near = np.abs((counts - start) / STEP_COUNTS - level) < 0.08
    outlying = counts < -1e6
    known = np.flatnonzero(near & ~outlying)
    cuts = np.flatnonzero(np.diff(level[known])) + 1
    found = []
    for members in np.split(known, cuts):
        if members.size < 25:
            continue
        part = slice(members[0], members[-1] + 1)
        found.append(
            (int(level[members[0]]), steady_value(time_s[part], counts[part], tolerance=20.0))
        )
    assert [number for number, _ in found] == PATH
    return [steady for _, steady in found], np.array(
        [steady.value - found[0][1].value for _, steady in found]
    )


def test_staircase_and_hysteresis_of_the_first_cell(reference_data):
    cells = loadmat(reference_data("cie324-loadcell/loadCellCalData.mat"))["acquiredData"]
    _, counts = plateaus(np.arange(float(len(cells))), cells[:, 3].astype(float))
    # The plateaus as whoever collected these data read them off.
    np.testing.assert_allclose(counts[1:5], [9920, 19826, 29716, 39560], atol=60)
    np.testing.assert_allclose(counts[5:], [29648, 19711, 9853, -185], atol=110)
    series = LoadingSeries(0.0, counts[1:5], counts[[7, 6, 5, 4]], counts[8])
    result = evaluate_static(
        [10.0, 20.0, 30.0, 40.0], [series], resolution=1.0, reference_uncertainty_percent=0.1
    )
    middle = result.reversibility_percent[1] * result.mean[1] / result.span
    assert middle == pytest.approx(0.29, abs=0.1)
    assert result.zero_residual_percent == pytest.approx(100 * 185 / 39560, abs=0.05)
    # The cell itself is straight: the line through zero leaves less than the hysteresis.
    assert np.max(np.abs(result.interpolation(1).deviation_percent)) < 0.3


def test_outliers_do_not_reach_the_plateaus(reference_data):
    table = np.loadtxt(reference_data("cie324-loadcell/LoadCellCalibrationData.txt"), delimiter=",")
    time_s = table[:, 0] / 1000.0
    for column in (10, 11):
        counts = table[:, column]
        outlying = counts < -1e6
        assert outlying.sum() == 4
        steady, found = plateaus(time_s, counts)
        assert sum(value.rejected for value in steady) >= 4
        # The same staircase without the outliers at all: the plateaus agree within their noise.
        _, clean = plateaus(time_s[~outlying], counts[~outlying])
        np.testing.assert_allclose(found, clean, atol=60)
        np.testing.assert_allclose(np.diff(found)[:4], 1e4, rtol=0.02)
