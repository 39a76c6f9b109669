from dataclasses import replace

import numpy as np
import pytest

from torquebench.calibration import CalibrationData
from torquebench.campaign.fitting import fit_table
from torquebench.compensation.repeats import NoiseFloor
from torquebench.reports.fit_report import fit_page
from torquebench.reports.page import render_page


@pytest.mark.parametrize(
    ("freedom", "said"), [(1, "(degrees of freedom: 1)"), (2, "(degrees of freedom: 2)")]
)
def test_degrees_of_freedom_are_counted_in_words(freedom: int, said: str) -> None:
    standard = np.linspace(-100.0, 100.0, 41)
    branch = np.where(standard > 0.0, 1.0, -1.0)
    data = CalibrationData(0.99 * standard, standard, np.ones(41, int), branch, 100.0)
    fitted = fit_table(data, "data.csv", "polynomial-2")
    page = render_page(fit_page(replace(fitted, noise=NoiseFloor(0.01, freedom))))
    assert said in page
