"""Every model is a scikit-learn estimator: it passes scikit-learn's own checks."""

import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
from sklearn.utils.estimator_checks import estimator_checks_generator

from torquebench.compensation import (
    MODELS,
    RECOMMENDED,
    CompensationModel,
    OutlierWarning,
    make_model,
)
from torquebench.compensation.kinds import NETWORKS

# Checks that ask for what isn't installed here; each says so by skipping itself.
NOT_ASKED = {
    "check_array_api_input": "no other array library than NumPy is offered",
    "check_regressor_data_not_an_array": "its second half needs pandas, which isn't a dependency",
}
# Checks that a model can't pass, with the reason; none so far.
EXPECTED_TO_FAIL: dict[str, dict[str, str]] = {}


DECLARED = {"range_nm": 1e4}
BY_DAY = "polynomial"
"""The other kinds share their interface with this one, of which a quarter of the checks runs."""


def quick(kind: str, **parameters: Any) -> CompensationModel:
    """The checks fit some fifty times: as little training as shows the behaviour."""
    small: dict[str, dict[str, Any]] = {
        "published-network": {"epochs": 200},
        "bayesian-network": {"iterations": 5},
        "radial-basis": {"swarm_steps": 5, "iterations": 3},
    }
    return make_model(kind, **{**small.get(kind, {}), **parameters})


def all_checks() -> Iterator[Any]:
    for kind in sorted({*MODELS, *NETWORKS} - {"network"}):
        # With the range of the data; the default also with a declared one that no set exceeds.
        for parameters in ({}, DECLARED) if kind == RECOMMENDED else ({},):
            model = quick(kind, **parameters)
            with warnings.catch_warnings():
                # It is one without inheriting, so that using a model doesn't import scikit-learn.
                warnings.filterwarnings("ignore", "Estimator .* does not inherit", UserWarning)
                checks = list(estimator_checks_generator(model, legacy=True))
            for number, (estimator, check) in enumerate(checks):
                name = check.func.__name__ if isinstance(check, partial) else check.__name__
                if name in NOT_ASKED:
                    continue
                reason = EXPECTED_TO_FAIL.get(kind, {}).get(name)
                marks = [pytest.mark.xfail(reason=reason, strict=True)] if reason else []
                marks += [] if kind == BY_DAY and number % 4 == 0 else [pytest.mark.nightly]
                label = f"{kind}-{'declared' if parameters else 'from-data'}-{name}"
                yield pytest.param(estimator, check, id=label, marks=marks)


@pytest.mark.usefixtures("curve_alone")
@pytest.mark.parametrize(("estimator", "check"), list(all_checks()))
def test_scikit_learn_check(
    estimator: CompensationModel, check: Callable[[CompensationModel], None]
) -> None:
    with warnings.catch_warnings():
        # scikit-learn's test sets have points that are outliers for a torque chain, and checks that
        # want a warning of their own.
        warnings.simplefilter("ignore", OutlierWarning)
        check(estimator)
