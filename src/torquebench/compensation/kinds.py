"""All kinds of models by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.compensation.base import CompensationModel


class _Kinds(Mapping[str, "type[CompensationModel]"]):
    """Mapping from names to kinds of models; a class is imported at its first use.

    The module of a kind has the same name: `radial_basis` for "radial-basis".
    """

    def __init__(self, *kinds: str) -> None:
        self._classes: dict[str, type[CompensationModel] | None] = dict.fromkeys(kinds)

    def __getitem__(self, kind: str) -> type[CompensationModel]:
        if self._classes[kind] is None:
            import_module(f"torquebench.compensation.{kind.replace('-', '_')}")
        model = self._classes[kind]
        assert model is not None
        return model

    def __contains__(self, kind: object) -> bool:
        return kind in self._classes

    def __iter__(self) -> Iterator[str]:
        return iter(self._classes)

    def __len__(self) -> int:
        return len(self._classes)

    def enter(self, kind: str, model: type[CompensationModel]) -> None:
        self._classes[kind] = model


MODELS = _Kinds("hybrid", "network", "polynomial", "radial-basis")
"""All kinds of models by their name in model files."""

NETWORKS = {"bayesian-network": "levenberg-marquardt", "published-network": "gradient-descent"}
"""Names of the networks, and the training that each stands for."""

MODEL_NAMES = (*MODELS, *NETWORKS, *(f"polynomial-{degree}" for degree in range(1, 31)))
"""All names that `make_model` takes."""

_Model = TypeVar("_Model", bound="type[CompensationModel]")


def register(kind: str) -> Callable[[_Model], _Model]:
    """Return a decorator that enters a class into `MODELS` under a name.

    Parameters
    ----------
    kind : str
        Lower-case name with hyphens, such as "radial-basis".

    Returns
    -------
    decorator : callable
        Class decorator that sets `kind`.
    """

    def enter(model: _Model) -> _Model:
        model.kind = kind
        MODELS.enter(kind, model)
        return model

    return enter


def check_kind(name: str) -> str:
    """Return the name of a model if this kind exists, without importing it.

    Raises
    ------
    InputError
        No kind has this name.
    """
    parsed_kind(name)
    return name


def parsed_kind(name: str) -> tuple[str, dict[str, Any]]:
    """Return the kind of a name, and the parameters that the name contains.

    Examples
    --------
    >>> parsed_kind("polynomial-3")
    ('polynomial', {'degree': 3})
    """
    stem, _, suffix = name.rpartition("-")
    if stem == "polynomial" and suffix.isdigit():
        return "polynomial", {"degree": int(suffix)}
    if name in NETWORKS:
        return "network", {"training": NETWORKS[name]}
    if name not in MODELS:
        raise InputError(
            Message("model {name!r}", name),
            ", ".join(sorted({*MODELS, *NETWORKS})),
            "name one of these",
        )
    return name, {}
