"""Models fitted to one calibration, with progress, remarks and a comparison."""

import numpy as np
import pytest
from tests.watching import Watching

from torquebench.calibration import CalibrationData
from torquebench.campaign.fitting import (
    ModelChoice,
    feature_columns,
    fit_models,
    fit_table,
    model_title,
    remarks_on,
)
from torquebench.compensation import CANDIDATES, MODELS, RECOMMENDED, make_model
from torquebench.errors import InputError


def chain(seed: int = 1, outlying: bool = False) -> CalibrationData:
    """Return a chain with a quadratic error, up and down in both directions, 100 N·m."""
    rng = np.random.default_rng(seed)
    rising = np.linspace(5.0, 100.0, 20)
    loop = np.concatenate([rising, rising[-2::-1]])
    branch = np.concatenate([np.ones(20), -np.ones(19)])
    standard = np.concatenate([loop, -loop])
    reading = 0.99 * standard + 1e-5 * np.abs(standard) * standard
    reading = reading + rng.normal(0.0, 0.01, standard.size)
    if outlying:
        reading[30] += 2.0
    series = np.repeat([1, 2], loop.size)
    return CalibrationData(reading, standard, series, np.tile(branch, 2), 100.0)


def test_every_choice_is_fitted_and_reports_all_its_steps() -> None:
    watcher = Watching()
    choices = [ModelChoice("polynomial-2"), ModelChoice("radial-basis"), ModelChoice("hybrid")]
    fitted = fit_models(chain(), choices, watcher, title="Fitting the input module")
    assert [item.name for item in fitted] == ["polynomial-2", "radial-basis", "hybrid"]
    assert watcher.stages == [("Fitting the input module", 300)]
    assert (watcher.done[-1], watcher.finished) == (300, 1)
    assert all(item.model.range_nm == 100.0 for item in fitted)


def test_an_outlier_is_a_remark_and_no_warning_on_the_terminal() -> None:
    (fitted,) = fit_models(chain(outlying=True), [ModelChoice("polynomial-2")])
    assert len(fitted.remarks) == 1
    assert "row 31:" in fitted.remarks[0]
    assert remarks_on(chain(outlying=True)) == fitted.remarks


@pytest.mark.parametrize("kind", sorted(MODELS))
def test_every_kind_has_a_title_that_fits_the_table(kind: str) -> None:
    model = make_model(kind)
    title = model_title(kind, model.kind_parameters)
    assert title != kind or "-" not in kind
    assert len(title) <= 27
    assert model_title(kind)  # of a registry's entry, which has the kind alone


def test_models_are_fitted_to_the_columns_that_they_use() -> None:
    (polynomial, hybrid) = fit_models(chain(), [ModelChoice("polynomial"), ModelChoice("hybrid")])
    assert polynomial.model.n_features_in_ == feature_columns(polynomial.model) == 1
    assert hybrid.model.n_features_in_ == feature_columns(hybrid.model) >= 2


def test_an_unknown_model_is_refused() -> None:
    with pytest.raises(InputError, match="crystal-ball"):
        fit_models(chain(), [ModelChoice("crystal-ball")])
    with pytest.raises(InputError, match="crystal-ball"):
        fit_table(chain(), "data.csv", "crystal-ball")


def test_the_recommended_model_is_a_candidate() -> None:
    assert RECOMMENDED in MODELS
    assert RECOMMENDED in CANDIDATES


def test_a_table_gets_the_recommended_model_fitted_to_all_points() -> None:
    watcher = Watching()
    found = fit_table(chain(), "data.csv", progress=watcher)
    assert (found.name, found.model.kind) == (RECOMMENDED, RECOMMENDED)
    assert found.comparison is None
    assert found.fitted.rms_nm < 0.1 * found.raw.rms_nm
    assert found.model.points_ == len(found.data)
    assert watcher.stages == [("Fitting the model", 100)]


def test_a_named_model_is_taken_and_its_outliers_are_named() -> None:
    found = fit_table(chain(outlying=True), "data.csv", "polynomial-5")
    assert found.name == "polynomial-5"
    assert any("row 31:" in remark for remark in found.remarks)


def test_few_points_that_cannot_tell_growing_noise_are_a_remark() -> None:
    many = chain()
    assert not [each for each in fit_table(many, "t").remarks if "noise grows" in each]
    few = many.subset(np.arange(len(many)) % 6 == 0)
    (remark,) = (each for each in fit_table(few, "t").remarks if "noise grows" in each)
    assert f"{len(few)} points" in remark
