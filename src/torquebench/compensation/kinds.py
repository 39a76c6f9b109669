"""Every kind of model by its name."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from torquebench.errors import InputError

if TYPE_CHECKING:
    from torquebench.compensation.base import CompensationModel

__all__ = ["MODELS", "make_model", "register"]

MODELS: dict[str, type[CompensationModel]] = {}
"""Every kind of model by its name on the command line and in model files."""

_Model = TypeVar("_Model", bound="type[CompensationModel]")


def register(kind: str) -> Callable[[_Model], _Model]:
    """Enter a class into `MODELS` under its name.

    Parameters
    ----------
    kind : str
        Lower-case name with hyphens, such as "bayesian-network".

    Returns
    -------
    decorator : callable
        Class decorator that sets `kind`.
    """

    def enter(model: _Model) -> _Model:
        model.kind = kind
        MODELS[kind] = model
        return model

    return enter


def make_model(name: str, **parameters: Any) -> CompensationModel:
    """Make an unfitted model by its name.

    Parameters
    ----------
    name : str
        One of `MODELS`; "polynomial-3" is short for a polynomial of degree 3.
    **parameters
        The model's own parameters.

    Returns
    -------
    model : CompensationModel

    Raises
    ------
    InputError
        When the name or a parameter isn't known.

    Examples
    --------
    >>> make_model("polynomial", degree=3).degree
    3
    """
    kind = name
    stem, _, suffix = name.rpartition("-")
    if stem == "polynomial" and suffix.isdigit():
        kind, parameters = "polynomial", {"degree": int(suffix), **parameters}
    if kind not in MODELS:
        raise InputError(f"model {name!r}", ", ".join(sorted(MODELS)), "name one of these")
    known = MODELS[kind]._get_param_names()
    for parameter in parameters:
        if parameter not in known:
            raise InputError(
                f"parameter {parameter!r} of model {name!r}", ", ".join(known), "name one of these"
            )
    return MODELS[kind](**parameters)
