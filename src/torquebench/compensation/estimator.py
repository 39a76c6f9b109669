"""The scikit-learn estimator interface of models, without importing scikit-learn.

Fitting a model to arrays, reading it from a file and applying it don't need scikit-learn, whose
import takes longer than all three. The methods that scikit-learn itself calls import it.
"""

from __future__ import annotations

import copy
import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, TypeGuard, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from torquebench.compensation.columns import FloatArray
from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["Between", "Estimator", "Limit", "OneOf", "Truth", "clone", "parameter"]


Kind = TypeVar("Kind", bound="Estimator")


@dataclass(frozen=True)
class Between:
    """Numbers between two limits, which belong to it unless it is open there.

    Parameters
    ----------
    kind : type
        `numbers.Integral` or `numbers.Real`.
    low, high : float or None
        None where there is no limit.
    open_low, open_high : bool
    """

    kind: type
    low: float | None
    high: float | None = None
    open_low: bool = False
    open_high: bool = False

    def allows(self, value: object) -> bool:
        """Whether a value is one of them."""
        if not isinstance(value, self.kind) or not isinstance(value, Real):
            return False
        number = float(value)
        above = self.low is None or (number > self.low if self.open_low else number >= self.low)
        below = self.high is None or (number < self.high if self.open_high else number <= self.high)
        return above and below and np.isfinite(number).item()

    def __str__(self) -> str:
        low = "(-inf" if self.low is None else f"{'(' if self.open_low else '['}{self.low:g}"
        high = "inf)" if self.high is None else f"{self.high:g}{')' if self.open_high else ']'}"
        return f"{'an int' if self.kind is Integral else 'a float'} in the range {low}, {high}"


@dataclass(frozen=True)
class OneOf:
    """One of some words."""

    words: frozenset[str]

    def allows(self, value: object) -> bool:
        """Whether a value is one of them."""
        return isinstance(value, str) and value in self.words

    def __str__(self) -> str:
        return f"one of {', '.join(sorted(self.words))}"


@dataclass(frozen=True)
class Truth:
    """True or False."""

    def allows(self, value: object) -> bool:
        """Whether a value is one of them."""
        return isinstance(value, (bool, np.bool_))

    def __str__(self) -> str:
        return "True or False"


Limit = Between | OneOf | Truth | None
"""Type of a parameter's value; None allows None."""


class Parameter(NamedTuple):
    """An argument of a constructor: its default, and the values that it may have."""

    default: object
    allowed: tuple[Limit, ...]


def parameter(default: object, *allowed: Limit) -> Any:
    """Declare an argument of an estimator's constructor.

    Examples
    --------
    >>> class Model(Estimator):
    ...     degree: int = parameter(2, Between(Integral, 1, 30))
    >>> Model(degree=3).get_params(), Model()
    ({'degree': 3}, Model())
    """
    return Parameter(default, allowed)


class Estimator:
    """Parameters, limits of parameters and checks of data as scikit-learn's base class has them.

    A class declares its parameters by `parameter`. Its constructor stores each of them under its
    own name and does nothing else.
    """

    if TYPE_CHECKING:

        def __init__(self, **parameters: Any) -> None: ...

    n_features_in_: int
    declared: ClassVar[dict[str, Parameter]] = {}
    """The class's own parameters, then those of its base."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        own = {name: each for name, each in vars(cls).items() if isinstance(each, Parameter)}
        for name, each in own.items():
            setattr(cls, name, each.default)
        if own:
            cls.declared = own | {n: each for n, each in cls.declared.items() if n not in own}
            # It comes from the declared parameters, which typing doesn't know.
            cls.__init__ = _constructor(cls.declared)  # type: ignore[method-assign]

    @classmethod
    @functools.cache
    def parameter_names(cls) -> tuple[str, ...]:
        """Return the names of the constructor's arguments in alphabetical order."""
        names = inspect.signature(cls.__init__).parameters
        return tuple(sorted(name for name in names if name != "self"))

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the constructor's arguments by name.

        Parameters
        ----------
        deep : bool, default True
            Those of models among them as well, as `name__parameter`.
        """
        found: dict[str, Any] = {}
        for name in self.parameter_names():
            value = found[name] = getattr(self, name)
            if deep and isinstance(value, Estimator):
                inner = value.get_params()
                found |= {f"{name}__{key}": each for key, each in inner.items()}
        return found

    def set_params(self, **parameters: Any) -> Self:
        """Set arguments of the constructor by name, those of models among them likewise.

        Raises
        ------
        ValueError
            There is no such parameter.
        """
        for key, value in parameters.items():
            name, nested, rest = key.partition("__")
            if name not in self.parameter_names():
                raise ValueError(
                    f"Invalid parameter {name!r} for estimator {self}. "
                    f"Valid parameters are: {list(self.parameter_names())!r}."
                )
            if nested:
                getattr(self, name).set_params(**{rest: value})
            else:
                setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        signature = inspect.signature(type(self).__init__).parameters
        given = [
            f"{name}={value!r}"
            for name in signature
            if name != "self"
            and (value := getattr(self, name)) is not signature[name].default
            and value != signature[name].default
        ]
        return f"{type(self).__name__}({', '.join(given)})"

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import RegressorTags, Tags, TargetTags

        # scikit-learn's test data vary any column; here only the first is a reading.
        return Tags(
            estimator_type="regressor",
            target_tags=TargetTags(required=True),
            regressor_tags=RegressorTags(poor_score=True),
        )

    def get_metadata_routing(self) -> Any:
        """Return the metadata routing for scikit-learn's pipelines: none."""
        from sklearn.utils.metadata_routing import MetadataRequest

        return MetadataRequest(owner=self)

    def score(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> float:
        """Return the coefficient of determination R² of the prediction."""
        from sklearn.base import RegressorMixin

        found: float = RegressorMixin.score(self, X, y, sample_weight)
        return found

    # ---- checks ---------------------------------------------------------------------------

    def check_parameters(self) -> None:
        """Refuse parameters outside their limits."""
        for name in self.parameter_names():
            value = getattr(self, name)
            allowed = self.declared[name].allowed if name in self.declared else ()
            if not allowed or any(
                value is None if limit is None else limit.allows(value) for limit in allowed
            ):
                continue
            raise InputError(
                Message("{parameter} = {value!r} of {kind}", name, value, type(self).__name__),
                " or ".join("None" if limit is None else str(limit) for limit in allowed),
                "give a value within the limits",
            )

    def _require_fit(self) -> None:
        """Raise scikit-learn's `NotFittedError` if the model isn't fitted."""
        if "points_" not in vars(self):
            from sklearn.utils.validation import check_is_fitted

            check_is_fitted(self)

    def _checked_points(self, X: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return checked columns and values; raises `ValueError` as scikit-learn does."""
        if _plain(X, 2) and _plain(y, 1) and X.shape[0] == y.shape[0]:
            self.n_features_in_ = X.shape[1]
            vars(self).pop("feature_names_in_", None)
            return X, y
        from sklearn.utils.validation import validate_data

        X, y = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=1)
        return np.asarray(X), np.asarray(y, dtype=np.float64)

    def _checked_rows(self, X: ArrayLike) -> FloatArray:
        """Return as many checked columns as `fit` had; raises `ValueError` likewise."""
        known = getattr(self, "n_features_in_", None)
        if _plain(X, 2) and X.shape[1] == known and "feature_names_in_" not in vars(self):
            return X
        from sklearn.utils.validation import validate_data

        return np.asarray(validate_data(self, X, dtype=np.float64, reset=False))


def _constructor(declared: Mapping[str, Parameter]) -> Callable[..., None]:
    """Return a constructor with these arguments, as scikit-learn reads them from its signature."""
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    signature = inspect.Signature(
        [
            inspect.Parameter("self", kind),
            *(inspect.Parameter(n, kind, default=each.default) for n, each in declared.items()),
        ]
    )

    def construct(*arguments: Any, **named: Any) -> None:
        given = signature.bind(*arguments, **named)
        given.apply_defaults()
        model = given.arguments.pop("self")
        vars(model).update(given.arguments)

    # `inspect` reads the arguments from this attribute, which typing doesn't know.
    construct.__signature__ = signature  # type: ignore[attr-defined]
    construct.__name__ = "__init__"
    return construct


def _plain(values: ArrayLike, dimensions: int) -> TypeGuard[FloatArray]:
    """Return whether values are a non-empty array of finite float64."""
    return (
        type(values) is np.ndarray
        and values.dtype == np.float64
        and values.ndim == dimensions
        and values.size > 0
        and bool(np.isfinite(values).all())
    )


def clone(model: Kind) -> Kind:
    """Return an unfitted copy with copies of the same parameters."""
    parameters = {
        name: clone(value) if isinstance(value, Estimator) else copy.deepcopy(value)
        for name, value in model.get_params(deep=False).items()
    }
    return type(model)(**parameters)
