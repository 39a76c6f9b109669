"""Models whose fits are short, for tests of what all models share."""

from collections.abc import Callable
from typing import Any

import pytest

from torquebench.compensation import CompensationModel, make_model

QuickModel = Callable[..., CompensationModel]


@pytest.fixture(scope="session")
def quick_model() -> QuickModel:
    """Return a function that makes a model of a kind with little to train."""

    def make(kind: str, **parameters: Any) -> CompensationModel:
        if kind == "published-network":
            parameters = {"epochs": 500, "start": "small-uniform", **parameters}
        return make_model(kind, **parameters)

    return make
