"""A fit that is worse than the raw reading says so and why, from its own errors."""

import numpy as np
import pytest

from torquebench.calibration import CalibrationData
from torquebench.campaign.fitting import fit_table
from torquebench.compensation import compare


def chain(count: int) -> CalibrationData:
    """A module whose ripple and loop are within 0.7 % of full scale, both branches."""
    up = np.linspace(-2000.0, 2000.0, count // 2)
    reading = np.concatenate([up, up[::-1]])
    branch = np.repeat([1, -1], up.size)
    share = reading / 2000.0
    added = 6.0 * share + 3.0 * share**2 + 2.0 * branch * (1.0 - share**2)
    noise = np.random.default_rng(4).normal(0.0, 0.2, reading.size)
    return CalibrationData(
        reading_nm=reading,
        standard_nm=reading + added + noise,
        branch=branch,
        series=np.ones(reading.size, dtype=int),
        range_nm=2000.0,
    )


@pytest.fixture(scope="module")
def few() -> CalibrationData:
    return chain(30)


def test_the_published_network_names_its_start(few: CalibrationData) -> None:
    fitted = fit_table(few, "few.csv", "published-network")
    (said,) = [each for each in fitted.remarks if "worse than the raw reading" in each]
    assert "'nguyen-widrow'" in said
    assert "neither start nor epochs" in said
    assert "small-uniform" in said
    assert "30 points" in said


@pytest.mark.nightly
def test_other_models_and_more_points_are_not_blamed(few: CalibrationData) -> None:
    assert not any("worse than the raw" in each for each in fit_table(few, "few.csv").remarks)
    many = fit_table(chain(120), "many.csv", "published-network")
    assert not any("worse than the raw" in each for each in many.remarks)


def test_too_few_epochs_are_named_as_such(few: CalibrationData) -> None:
    from torquebench.compensation import make_model

    model = make_model("published-network", epochs=20, range_nm=2000.0)
    comparison = compare(few.features(2), few.standard_nm, {"net": model}, range_nm=2000.0)
    said = comparison.behind_raw("net")
    assert "after 20 epochs" in said
    assert "more epochs" in said
