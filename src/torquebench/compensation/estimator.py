"""The scikit-learn estimator interface of models, without importing scikit-learn.

Fitting a model to arrays, reading it from a file and applying it don't need scikit-learn, whose
import takes longer than all three. The methods that scikit-learn itself calls import it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Self, TypeGuard, dataclass_transform

import numpy as np
from numpy.typing import ArrayLike

from torquebench.compensation.columns import FloatArray
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.compensation.checks import Outlier
    from torquebench.compensation.curve_uncertainty import CurveUncertainty


@dataclass(frozen=True)
class Between:
    """Numbers between two limits; a limit is included unless it is open.

    Parameters
    ----------
    kind : type
        `numbers.Integral` or `numbers.Real`.
    low, high : float or None
        None where there is no limit.
    """

    kind: type
    low: float | None
    high: float | None = None
    open_low: bool = False
    open_high: bool = False

    def allows(self, value: object) -> bool:
        """Return whether the value is allowed."""
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
    """A set of allowed words."""

    words: frozenset[str]

    def allows(self, value: object) -> bool:
        """Return whether the value is allowed."""
        return isinstance(value, str) and value in self.words

    def __str__(self) -> str:
        return f"one of {', '.join(sorted(self.words))}"


@dataclass(frozen=True)
class Truth:
    """True or False."""

    def allows(self, value: object) -> bool:
        """Return whether the value is allowed."""
        return isinstance(value, (bool, np.bool_))

    def __str__(self) -> str:
        return "True or False"


Limit = Between | OneOf | Truth | None
"""Values that a parameter allows; None allows None."""


def parameter(*allowed: Limit, default: object) -> Any:
    """Declare an argument of an estimator's constructor.

    Examples
    --------
    >>> class Model(Estimator):
    ...     degree: int = parameter(Between(Integral, 1, 30), default=2)
    >>> Model(degree=3).get_params(), Model()
    ({'degree': 3}, Model())
    """
    return field(default=default, metadata={"allowed": allowed})


@dataclass_transform(kw_only_default=True, eq_default=False, field_specifiers=(parameter,))
class Estimator:
    """A dataclass of parameters with the methods that scikit-learn calls of an estimator.

    A subclass declares its parameters by `parameter`; they are keyword-only arguments.
    """

    n_features_in_: int
    outliers_: list[Outlier]
    full_scale_nm_: float
    reading_low_nm_: float
    reading_high_nm_: float
    noise_nm_: float
    effective_parameters_: float
    degrees_of_freedom_: float
    points_: int
    uncertainty_: CurveUncertainty | None
    tables_: dict[bool, Any]
    """Compiled tables of the fitted model, with and without branches."""
    maximum_points: int | None = 2000
    """More points than this are averaged with their neighbours, with a `PointsReducedWarning`."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        dataclass(kw_only=True, eq=False, repr=False)(cls)

    @classmethod
    def parameter_names(cls) -> tuple[str, ...]:
        """Return the names of the constructor's arguments in alphabetical order."""
        return tuple(sorted(item.name for item in fields(cls)))  # type: ignore[arg-type] # by subclasses

    def get_params(self, deep: bool = True) -> dict[str, Any]:  # noqa: ARG002 # there are no nested ones
        """Return the constructor's arguments by name."""
        return {name: getattr(self, name) for name in self.parameter_names()}

    def set_params(self, **parameters: Any) -> Self:
        """Set arguments of the constructor by name; `ValueError` for an unknown name."""
        for name, value in parameters.items():
            if name not in self.parameter_names():
                raise ValueError(
                    f"Invalid parameter {name!r} for estimator {self}. "
                    f"Valid parameters are: {list(self.parameter_names())!r}."
                )
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        changed = (
            f"{name}={value!r}"
            for name, value in self.get_params().items()
            if value is not getattr(type(self), name) and value != getattr(type(self), name)
        )
        return f"{type(self).__name__}({', '.join(changed)})"

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import RegressorTags, Tags, TargetTags

        # scikit-learn's tests vary any column; in these models only the first one is a reading.
        return Tags(
            estimator_type="regressor",
            target_tags=TargetTags(required=True),
            regressor_tags=RegressorTags(poor_score=True),
        )

    def get_metadata_routing(self) -> Any:
        """Return the metadata routing for scikit-learn's pipelines: none."""
        from sklearn.utils.metadata_routing import MetadataRequest

        return MetadataRequest(owner=self)

    # ---- checks ---------------------------------------------------------------------------

    def check_parameters(self) -> None:
        """Refuse parameters outside their limits."""
        for item in fields(self):  # type: ignore[arg-type] # by subclasses
            allowed, value = item.metadata.get("allowed", ()), getattr(self, item.name)
            if not allowed or any(
                value is None if limit is None else limit.allows(value) for limit in allowed
            ):
                continue
            raise InputError(
                Message("{parameter} = {value!r} of {kind}", item.name, value, type(self).__name__),
                " or ".join("None" if limit is None else str(limit) for limit in allowed),
                "give a value within the limits",
            )

    def _require_fit(self) -> None:
        """Raise scikit-learn's `NotFittedError` if the model isn't fitted."""
        if "points_" not in vars(self):
            with _scikit_learn(Message("a model that isn't fitted"), "a model after `fit`"):
                from sklearn.utils.validation import check_is_fitted

                check_is_fitted(self)

    def _checked_points(self, X: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return checked columns and values; raises `ValueError` as scikit-learn does."""
        columns, values = _array(X, 2), _array(y, 1)
        if columns is not None and values is not None and len(columns) == len(values):
            self.n_features_in_ = columns.shape[1]
            if hasattr(self, "feature_names_in_"):  # left by an earlier fit to a frame
                del self.feature_names_in_
            return columns, values
        with _scikit_learn(_described(X, y), "rows of finite numbers, and as many values"):
            from sklearn.utils.validation import validate_data

            X, y = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=1)
        return np.asarray(X), np.asarray(y, dtype=np.float64)

    def _checked_rows(self, X: ArrayLike) -> FloatArray:
        """Return checked rows with as many columns as `fit` had; raises `ValueError` otherwise."""
        expected = getattr(self, "n_features_in_", None)
        columns = _array(X, 2)
        named = "feature_names_in_" in vars(self)
        if columns is not None and columns.shape[1] == expected and not named:
            return columns
        with _scikit_learn(
            _described(X), Message("rows of {known} finite numbers, as `fit` had", expected)
        ):
            from sklearn.utils.validation import validate_data

            return np.asarray(validate_data(self, X, dtype=np.float64, reset=False))


@contextmanager
def _scikit_learn(found: Message, allowed: Message | str) -> Iterator[None]:
    """Let scikit-learn report a wrong argument; without scikit-learn, report it briefly."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("sklearn"):
            raise
        raise InputError(
            found, allowed, "pip install 'torquebench[notebook]' gives a more detailed message"
        ) from error


def _described(*arguments: ArrayLike) -> Message:
    shapes = ", ".join(str(np.shape(argument)) for argument in arguments)
    return Message("arrays of shape {shapes} that aren't plain numbers", shapes)


def _array(values: ArrayLike, dimensions: int) -> FloatArray | None:
    """Return values as a non-empty array of finite float64, or None if that isn't possible."""
    if _plain(values, dimensions):
        return values
    if not isinstance(values, list | tuple | np.ndarray):
        return None
    try:
        numbers = np.asarray(values)
    except ValueError:  # rows of different lengths
        return None
    if numbers.dtype.kind not in "fiu":
        return None
    numbers = numbers.astype(np.float64)
    return numbers if _plain(numbers, dimensions) else None


def _plain(values: ArrayLike, dimensions: int) -> TypeGuard[FloatArray]:
    """Return whether values already are a non-empty array of finite float64."""
    return (
        type(values) is np.ndarray
        and values.dtype == np.float64
        and values.ndim == dimensions
        and values.size > 0
        and bool(np.isfinite(values).all())
    )
