"""Create models by name, and rebuild them from model files."""

from __future__ import annotations

from typing import Any

import numpy as np

from torquebench.compensation.base import CompensationModel
from torquebench.compensation.kinds import MODELS, NETWORKS, parsed_kind
from torquebench.compensation.state import encode_value
from torquebench.errors import InputError, ModelMismatchError
from torquebench.message import Message


def make_model(name: str, **parameters: Any) -> CompensationModel:
    """Make an unfitted model by its name.

    Parameters
    ----------
    name : str
        One of `MODELS`; "polynomial-3" is short for a polynomial of degree 3, "bayesian-network"
        and "published-network" for the network by its training.
    **parameters
        Parameters of that kind of model.

    Raises
    ------
    InputError
        When the name or a parameter isn't known.

    Examples
    --------
    >>> make_model("polynomial", degree=3)
    PolynomialModel(degree=3)
    """
    kind, part_of_name = parsed_kind(name)
    model = MODELS[kind](**part_of_name)
    if "training" in parameters and "training" in model.kind_parameters:
        model.set_params(training=parameters["training"])
    allowed = model.kind_parameters
    for parameter in parameters:
        if parameter not in allowed:
            raise InputError(
                Message("parameter {parameter!r} of model {name!r}", parameter, name),
                ", ".join(allowed),
                "name one of these",
            )
    return model.set_params(**parameters)


def model_from_state(state: dict[str, Any]) -> CompensationModel:
    """Rebuild a fitted model from `CompensationModel.get_state`, bit for bit.

    Parameters
    ----------
    state : dict
        As from `get_state`, of this version or of 0.2.0.

    Returns
    -------
    model : CompensationModel
        Model of the kind that the state names.

    Raises
    ------
    InputError
        When the kind isn't known or the state isn't complete.
    ModelMismatchError
        A model of 0.2.0, of a kind or inference that was removed since.
    """
    kind = str(state.get("kind"))
    if kind not in {*MODELS, *NETWORKS, *_GONE}:
        raise InputError(
            Message("model kind {kind!r}", kind),
            ", ".join(sorted(MODELS)),
            "use the version of torquebench that the model was made with",
        )
    try:
        if "uncertainty_" not in state["fitted"] or "dictionary_" in state["fitted"]:
            state = _of_0_2_0(state)
        return MODELS[state["kind"]].restored(state)
    except (KeyError, TypeError, AttributeError) as problem:
        raise InputError(
            Message("state of a {kind} model that can't be rebuilt ({problem})", kind, problem),
            "a complete state as written by this version",
            "fit the model again",
        ) from problem


_GONE = frozenset({"gaussian-process", "physics", "spline"})
_COVARIANCES = (
    "hessian_",
    "noise_variance_",
    "precision_",
    "training_inputs_",
    "training_weights_",
)


def _of_0_2_0(state: dict[str, Any]) -> dict[str, Any]:
    """Convert the state of a model written by 0.2.0 to the form of this version."""
    kind, fitted = state["kind"], dict(state["fitted"])
    fitted["uncertainty_"] = state.get("discrepancy")
    if (
        kind in _GONE
        or kind == "hybrid"
        or (kind != "polynomial" and fitted["uncertainty_"] is None)
    ):
        raise ModelMismatchError(
            Message("a model of kind {kind} of version 0.2.0 or before", kind),
            "models of this version, and tables exported by any",
            "fit the same calibration again, or calibrate again",
        )
    for name in _COVARIANCES:
        fitted.pop(name, None)
    parameters = state["parameters"]
    if kind in NETWORKS:
        parameters = {**parameters, "training": NETWORKS[kind]}
        fitted.pop("log_evidence_", None)
        if members := fitted.pop("members_", None):
            fitted["networks_"] = [member["content"]["parameters"] for member in members]
        else:
            fitted["networks_"], fitted["shares_"] = [fitted.pop("parameters_")], _ONE
        fitted.setdefault("training_curve_", encode_value(np.zeros((0, 2))))
        kind = "network"
    return {"kind": kind, "parameters": parameters, "fitted": fitted}


_ONE = encode_value(np.ones(1))
