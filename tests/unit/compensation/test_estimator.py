import subprocess
import sys
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from sklearn.base import clone as scikit_learn_clone
from sklearn.base import is_regressor
from sklearn.model_selection import GridSearchCV, KFold, cross_val_score
from sklearn.pipeline import make_pipeline

from torquebench.compensation import PolynomialModel, make_model
from torquebench.compensation.estimator import Between, OneOf, Truth
from torquebench.errors import InputError

READING = np.linspace(-100.0, 100.0, 41)[:, None]
STANDARD = READING[:, 0] + 1e-4 * READING[:, 0] ** 2

WITHOUT_SCIKIT_LEARN = """
import sys
import numpy as np
from torquebench.compensation import features, make_model, model_from_state
from torquebench.station import Station  # and what measures
reading = np.linspace(-100.0, 100.0, 41)
for kind in ("hybrid", "polynomial"):
    X = features(reading, np.ones(41))
    model = make_model(kind).fit(X, reading + 1e-4 * reading**2)
    model_from_state(model.get_state()).predict(X, return_std=True)
print(sorted({"joblib", "pandas", "scipy.signal", "scipy.stats", "sklearn"} & set(sys.modules)))
"""


def test_models_are_fitted_kept_and_applied_without_importing_scikit_learn() -> None:
    """Importing it takes as long as all else that opens a bench or applies a model."""
    command = [sys.executable, "-c", WITHOUT_SCIKIT_LEARN]
    told = subprocess.run(command, capture_output=True, text=True, check=True, timeout=200)
    assert told.stdout.strip() == "[]"


def test_scikit_learn_takes_a_model_for_a_regressor() -> None:
    model = PolynomialModel(degree=3, range_nm=100.0)
    assert is_regressor(model)
    assert scikit_learn_clone(model).get_params() == model.get_params()
    folds = KFold(5, shuffle=True, random_state=0)
    assert np.all(cross_val_score(model, READING, STANDARD, cv=folds) > 0.999)
    piped = make_pipeline("passthrough", model).fit(READING, STANDARD)
    np.testing.assert_array_equal(
        piped.predict(READING), model.fit(READING, STANDARD).predict(READING)
    )
    assert model.score(READING, STANDARD) == pytest.approx(1.0)


def test_reading_and_branch_alone_are_enough_to_predict() -> None:
    """A model that was fitted with the series wanted it for every reading, too."""
    X = np.column_stack([np.tile(np.linspace(-90.0, 90.0, 25), 2), np.repeat([1.0, -1.0], 25)])
    with_series = np.column_stack([X, np.repeat([1.0, 2.0], 25)])
    model = make_model("hybrid", range_nm=100.0).fit(with_series, 1.01 * X[:, 0] + 0.01 * X[:, 1])
    expected = model.predict(with_series)
    np.testing.assert_array_equal(model.predict(X), expected)
    frame = pl.DataFrame({"branch": X[:, 1], "reading_nm": X[:, 0]})
    np.testing.assert_array_equal(model.predict(frame), expected)
    with pytest.raises(InputError):
        model.predict(X[:, :1])


def test_a_list_is_checked_as_an_array_is() -> None:
    model = PolynomialModel().fit(READING.tolist(), STANDARD.tolist())
    found = model.predict(READING.tolist())
    np.testing.assert_array_equal(found, model.predict(READING))
    with pytest.raises(InputError, match="features"):
        model.predict(np.column_stack((READING, READING)))


def test_parameters_are_copied_set_and_shown() -> None:
    model = make_model("polynomial", degree=4)
    copied = replace(model)
    assert copied.get_params() == model.get_params()
    copied.set_params(degree=5)
    assert (copied.degree, model.degree) == (5, 4)
    assert repr(PolynomialModel(degree=5, range_nm=50.0)) == (
        "PolynomialModel(degree=5, range_nm=50.0)"
    )
    with pytest.raises(ValueError, match="Invalid parameter 'degrees'"):
        PolynomialModel().set_params(degrees=3)


def test_a_grid_search_reaches_the_parameters_of_a_model_with_its_uncertainty() -> None:
    fold = np.arange(READING.size) % 4
    fold[[0, -1]] = -1  # the ends of the range stay: a model doesn't extrapolate
    folds = [(np.flatnonzero(fold != k), np.flatnonzero(fold == k)) for k in range(4)]
    search = GridSearchCV(make_model("polynomial"), {"degree": [1, 2]}, cv=folds)
    search.fit(READING, STANDARD)
    assert search.best_params_ == {"degree": 2}
    assert search.best_estimator_.predict(READING, return_std=True)[1].max() < 1e-3


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({"degree": 0}, r"degree = 0 of PolynomialModel; allowed: an int in the range \[1, 30\]"),
        ({"degree": 2.5}, "degree = 2.5"),
        ({"per_direction": "yes"}, "True or False"),
        ({"range_nm": -1.0}, r"None or a float in the range \(0, inf\)"),
        ({"range_nm": float("nan")}, "range_nm = nan"),
        ({"outliers": "ignore"}, "one of downweight, keep, refuse"),
    ],
)
def test_parameters_beyond_their_limits_are_refused(
    parameters: dict[str, object], told: str
) -> None:
    with pytest.raises(InputError, match=told):
        PolynomialModel(**parameters).fit(READING, STANDARD)


def test_limits_say_what_they_allow() -> None:
    assert str(Between(float, None, 1.0)) == "a float in the range (-inf, 1]"
    assert Truth().allows(np.True_)
    assert not Truth().allows(1)
    assert not OneOf(frozenset({"a"})).allows("b")
