"""Create models by name, and rebuild them from model files."""

from __future__ import annotations

from typing import Any

from torquebench.compensation.base import CompensationModel
from torquebench.compensation.discrepancy import DiscrepancyUncertainty
from torquebench.compensation.hybrid import HybridModel
from torquebench.compensation.kinds import MODELS, parsed_kind
from torquebench.compensation.state import decode_value
from torquebench.errors import InputError, ModelMismatchError
from torquebench.message import Message

__all__ = ["POSTERIOR_POINTS", "make_model", "model_from_state"]

POSTERIOR_POINTS = 200
"""Largest number of points to which the posterior of the truth is fitted; more are averaged."""


def make_model(name: str, **parameters: Any) -> CompensationModel:
    """Make an unfitted model by its name, with a calibrated uncertainty.

    The hybrid states its own uncertainty. The covariance of every other kind doesn't contain the
    error of its form, so it is wrapped in a `DiscrepancyUncertainty` with the hybrid as the
    posterior.

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
    >>> make_model("polynomial", degree=3).kind_parameters["degree"]
    3
    """
    kind, part_of_name = parsed_kind(name)
    known = MODELS[kind].parameter_names()
    for parameter in parameters:
        if parameter not in known:
            raise InputError(
                Message("parameter {parameter!r} of model {name!r}", parameter, name),
                ", ".join(known),
                "name one of these",
            )
    estimator = MODELS[kind](**{**part_of_name, **parameters})
    if isinstance(estimator, HybridModel):
        return estimator
    return DiscrepancyUncertainty(estimator, HybridModel(maximum_points=POSTERIOR_POINTS))


def model_from_state(state: dict[str, Any]) -> CompensationModel:
    """Rebuild a fitted model from `CompensationModel.get_state`, bit for bit.

    Parameters
    ----------
    state : dict
        As from `get_state`.

    Returns
    -------
    model : CompensationModel
        Of the kind that the state names.

    Raises
    ------
    InputError
        When the kind isn't known or the state isn't complete.
    ModelMismatchError
        A hybrid model whose inference this version no longer has.
    """
    kind = state.get("kind")
    if kind not in MODELS:
        raise InputError(
            Message("model kind {kind!r}", kind),
            ", ".join(sorted(MODELS)),
            "use the version of torquebench that the model was made with",
        )
    try:
        if kind == HybridModel.kind and "dictionary_" in state["fitted"]:
            raise ModelMismatchError(
                "a hybrid model of version 0.2.0 or before",
                "models of this version, and tables exported by any",
                "fit the same calibration again, or calibrate again",
            )
        model = MODELS[str(kind)].restored(state)
        if "discrepancy" not in state:
            return model
        posterior = HybridModel(maximum_points=POSTERIOR_POINTS)
        uncertainty = decode_value(state["discrepancy"])
        return DiscrepancyUncertainty.around(model, posterior, uncertainty)
    except (KeyError, TypeError, AttributeError) as problem:
        raise InputError(
            Message("state of a {kind} model that can't be rebuilt ({problem})", kind, problem),
            "a complete state as written by this version",
            "fit the model again",
        ) from problem
