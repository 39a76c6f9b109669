"""Model parameters on the command line: `--parameter epochs=20000`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from torquebench.cli.options import named_values
from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["ParameterOption", "model_parameters"]

ParameterOption = Annotated[
    list[str] | None,
    typer.Option(
        "--parameter",
        metavar="NAME=VALUE",
        help="A parameter of the model. May be repeated. Of published-network: mapping "
        "(residual, direct), start (nguyen-widrow, small-uniform), hidden, epochs, "
        "learning_rate, target_error_nm, random_state.",
    ),
]


def model_parameters(kind: str, given: list[str] | None) -> dict[str, Any]:
    """Check and return a model's parameters from the command line.

    Parameters
    ----------
    kind : str
        Kind of the model.
    given : list of str or None
        Texts ``NAME=VALUE``.

    Raises
    ------
    InputError
        A parameter doesn't exist, is given twice, or is outside its limits.

    Examples
    --------
    >>> model_parameters("published-network", ["epochs=2000", "start=small-uniform"])
    {'epochs': 2000, 'start': 'small-uniform'}
    """
    if not given:
        return {}
    from torquebench.campaign.fitting import CHOSEN_ELSEWHERE, ModelChoice

    texts = named_values(given, "--parameter", "epochs=20000")
    for name in texts:
        if name in CHOSEN_ELSEWHERE:
            raise InputError(
                Message("--parameter {name}", name),
                "parameters of the model alone",
                "use --range, --outliers",
            )
    parameters = {name: _value(text) for name, text in texts.items()}
    ModelChoice(kind, parameters).check()
    return parameters


def _value(text: str) -> Any:
    if text.lower() in ("none", ""):
        return None
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
