"""Parameters of a model as text."""

import pytest

from torquebench.cli.models.parameters import model_parameters
from torquebench.errors import InputError


def test_values_become_numbers_and_words() -> None:
    given = ["epochs=300", "learning_rate = 5e-3", "mapping=direct", "target_error_nm=none"]
    assert model_parameters("published-network", given) == {
        "epochs": 300,
        "learning_rate": 0.005,
        "mapping": "direct",
        "target_error_nm": None,
    }
    assert model_parameters("hybrid", None) == {}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["epochs"], "NAME=VALUE"),
        (["=3"], "NAME=VALUE"),
        (["epochs=1", "epochs=2"], "twice"),
        (["nodes=3"], "parameter 'nodes'"),
        (["epochs=0"], "epochs"),
        (["epochs=many"], "epochs"),
        (["mapping=sideways"], "mapping"),
        (["range_nm=3"], "--range"),
    ],
)
def test_bad_parameters_are_named(given: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        model_parameters("published-network", given)
