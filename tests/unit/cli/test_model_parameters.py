"""Parameters of a model as text."""

import json

import pytest

from torquebench import cli
from torquebench.cli.options import named_values
from torquebench.operations import OPERATIONS


def test_values_become_numbers_and_words() -> None:
    given = ["epochs=300", "learning_rate = 5e-3", "mapping=direct", "target_error_nm=none"]
    texts = named_values(given, "--parameter", "epochs=300")
    request = {"tables": ["a.csv"], "model": "published-network", "parameters": texts}
    assert OPERATIONS["fit"].request.model_validate(request).parameters == {
        "epochs": 300,
        "learning_rate": 0.005,
        "mapping": "direct",
        "target_error_nm": None,
    }


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
        (["range_nm=3"], "range_nm"),
    ],
)
def test_bad_parameters_are_named(
    given: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = [part for each in given for part in ("--parameter", each)]
    arguments = ["fit", "none.csv", "--model", "published-network", *words, "--json"]
    monkeypatch.setattr("sys.argv", ["torquebench", *arguments])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert message in " ".join(error.values())
