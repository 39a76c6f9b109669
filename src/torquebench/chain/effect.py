"""The interface of all effects of a measuring chain, and their storage by kind."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from math import isfinite
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.chain.readings import Readings
from torquebench.chain.torque import Component
from torquebench.elementwise import Values
from torquebench.errors import InputError
from torquebench.message import Message

EFFECTS: dict[str, type[Effect]] = {}
"""All stored effects by the kind named in chain files."""


class Refusal(NamedTuple):
    """Readings for which an effect isn't valid.

    Parameters
    ----------
    rows : bool array of shape (n,)
    found, allowed : str
        Value of the first refused reading, and the range in which the effect is valid.
    """

    rows: NDArray[np.bool_]
    found: str
    allowed: str


@dataclass(frozen=True)
class MeasuredPart:
    """Largest identified value of one part of an effect over its measured range.

    Parameters
    ----------
    percent, u_percent : float
        Largest value and largest U (k = 2), in % of full scale; for a span, in % of the torque.
    measured : str
        Range in which it was measured, with its unit.
    """

    name: str
    percent: float
    u_percent: float
    measured: str

    @classmethod
    def of(
        cls,
        name: str,
        values: ArrayLike,
        standard_u: ArrayLike,
        full_scale: float,
        measured: str,
    ) -> MeasuredPart:
        """Return a part from its values and standard uncertainties in the unit of full scale."""
        value, u = (
            100.0 * float(np.max(np.abs(np.asarray(numbers)))) / full_scale
            for numbers in (values, standard_u)
        )
        return cls(name, value, 2.0 * u, measured)


@dataclass(frozen=True)
class Effect(ABC):
    """One influence on a reading: its correction and its uncertainty.

    A subclass is a frozen dataclass of numbers and text. It returns its components for arrays of
    readings. A subclass that depends on earlier readings returns a separate object from `stream`;
    the other subclasses return themselves.

    Attributes
    ----------
    kind : str
        Name in chain files, set by `register`.
    title : str
        Name in words.
    needs : tuple of str
        Fields of `Readings` that it uses. One that isn't measured enters as an uncertainty over the
        range that the effect states for it.
    corrects_reading : bool
        Whether it corrects the reading, before the static curve.
    influence : str
        Kind of the effect whose assumed limits this measured effect replaces; "" for none.
    expected : bool
        Whether U is incomplete in a chain without this effect or one that replaces it.
    of_turning : bool
        Whether it was measured while speed, temperature or acceleration changed.
    record : str
        Source of its numbers: a certificate, a data sheet, a calibration.
    """

    kind: ClassVar[str] = ""
    influence: ClassVar[str] = ""
    title: ClassVar[str] = ""
    needs: ClassVar[tuple[str, ...]] = ()
    corrects_reading: ClassVar[bool] = False
    expected: ClassVar[bool] = True
    of_turning: ClassVar[bool] = False
    record: str

    @abstractmethod
    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the contributions of the effect to readings.

        Parameters
        ----------
        readings : Readings
            The next readings of the stream, or independent rows.
        torque_nm : float64[n] or float
            Torque after all effects before this one, N·m; a float for a single reading.
        """

    def outside(self, readings: Readings) -> Refusal | None:  # noqa: ARG002 - most refuse none
        """Return the readings for which the effect isn't valid; None if there are none."""
        return None

    def identified(
        self,
        range_nm: float,  # noqa: ARG002 - most effects are stated, not identified
    ) -> tuple[MeasuredPart, ...]:
        """Return the parts that were identified from measurements of a rotating chain."""
        return ()

    def gaps(self) -> tuple[str, ...]:
        """Name the parts of the effect that weren't identified and aren't in U."""
        return ()

    def left_of(self, limit: Effect) -> Effect | None:  # noqa: ARG002 - most replace all of it
        """Return the part of a limit that this measured effect leaves valid; None for no part.

        Parameters
        ----------
        limit : Effect
            Effect of the kind that `influence` names.
        """
        return None

    def stream(self) -> Effect:
        """Return an object that follows one stream of readings; by default the effect itself."""
        return self

    def copy(self) -> Effect:
        """Return a second stream in the same state."""
        return self

    def forget(self) -> None:  # noqa: B027 - most have no memory
        """Discard the history, as after a gap or a fault."""

    def take_zero(self) -> None:  # noqa: B027 - most have no memory
        """Let the next readings count from a zero that was just taken without load."""

    def specification(self) -> dict[str, Any]:
        """Return kind and fields as JSON-ready values."""
        return {"kind": self.kind, **{item.name: getattr(self, item.name) for item in fields(self)}}

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, int | float) and not isfinite(value):
                raise InputError(
                    Message("{title}: {name} = {value}", self.title, item.name, value),
                    "a finite number",
                )
            limit = item.metadata.get("least")
            if limit is not None and value is not None and value < limit:
                raise InputError(
                    Message("{title}: {name} = {value}", self.title, item.name, value),
                    Message("{limit:g} or more", limit),
                )

    @classmethod
    def from_specification(cls, values: Mapping[str, Any]) -> Self:
        """Rebuild the effect from its `specification`, with tuples for lists."""
        return cls(**{name: _in_tuples(value) for name, value in values.items()})


def _in_tuples(value: Any) -> Any:
    return tuple(map(_in_tuples, value)) if isinstance(value, list | tuple) else value


_Effect = TypeVar("_Effect", bound=type[Effect])


def register(kind: str) -> Callable[[_Effect], _Effect]:
    """Return a decorator that enters an effect into `EFFECTS` under its kind."""

    def enter(effect: _Effect) -> _Effect:
        effect.kind = kind
        EFFECTS[kind] = effect
        return effect

    return enter
