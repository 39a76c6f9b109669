"""A second process computes while the first one measures."""

from functools import partial

import numpy as np
import psutil

from torquebench.calibration import CalibrationData
from torquebench.campaign.fitting import ModelChoice, fit_models
from torquebench.cli.second_process import second_process


def second_processes(before: set[psutil.Process]) -> list[psutil.Process]:
    """Return new children, without the one that tidies up after multiprocessing."""
    new = set(psutil.Process().children()) - before
    return [each for each in new if "resource_tracker" not in " ".join(each.cmdline())]


def test_what_fits_in_the_second_process_is_what_fits_here() -> None:
    rising = np.linspace(100.0, 2000.0, 20)
    torque_nm = np.concatenate((rising, rising[::-1], -rising, -rising[::-1]))
    branch = np.tile(np.repeat([1, -1], 20), 2)
    reading_nm = 1.002 * torque_nm + 0.8 * branch * np.sin(torque_nm / 700.0)
    data = CalibrationData(reading_nm, torque_nm, np.repeat([1, 2], 40), branch, 2000.0)
    choices = [ModelChoice("hybrid"), ModelChoice("polynomial-2")]
    with second_process() as other:
        there = other.begin(partial(fit_models, data, choices))()
    for one, other in zip(there, fit_models(data, choices), strict=True):
        X = data.features(one.model.n_features_in_)
        np.testing.assert_allclose(one.model.predict(X), other.model.predict(X), atol=1e-9)
        assert (one.name, one.remarks, one.choice) == (other.name, other.remarks, other.choice)


def test_what_a_second_process_that_dies_has_begun_is_computed_here() -> None:
    before = set(psutil.Process().children())
    with second_process() as other:
        wait = other.begin(partial(sum, (1, 2)))
        for each in second_processes(before):
            each.kill()
        assert wait() == 3
        assert other.begin(partial(sum, (2, 2)))() == 4
