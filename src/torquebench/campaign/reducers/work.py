"""The interface that every reducer test implements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from torquebench.bench.devices import BenchDevices
from torquebench.campaign.reducers.sampling import Unsampled
from torquebench.campaign.reducers.uncertainty import Bench
from torquebench.procedures import Plan
from torquebench.procedures.reducers.setup import ReducerLimits, WarmUp
from torquebench.reducers import ReducerDescription, ReducerResult


@runtime_checkable
class RepeatedSettings(Protocol):
    """Settings of a warm test that is repeated until its means are certain enough."""

    @property
    def warm_up(self) -> WarmUp:
        """Settings of the warm-up before the first point."""

    def longest(self) -> Any:
        """Return the settings with the largest number of repeats."""

    def with_repeats(self, most: int) -> Any:
        """Return the settings with at most so many repeats."""


@dataclass(frozen=True)
class Evaluated:
    """A result with remarks for its reader."""

    result: ReducerResult
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class ReducerTestWork:
    """Plan, evaluation and figure of a test.

    Parameters
    ----------
    settings, short : object
        Settings of its plan, for a full test and for a short one.
    recording : type
        Type of the plan's recording.
    plan : callable
        Returns its plan for the devices, the reducer's limits and the settings.
    evaluate : callable
        Turns the recorded data into a result.
    figures : callable
        Returns the result's figures as pairs of an ``<svg>`` element and a caption.
    unsampled : callable
        Returns the influences that the test leaves out by its settings.
    """

    settings: Any
    short: Any
    recording: type
    plan: Callable[[BenchDevices, ReducerLimits, Any], Plan[Any]]
    evaluate: Callable[[Bench, ReducerDescription, Any], Evaluated]
    figures: Callable[[Any], tuple[tuple[str, str], ...]]
    unsampled: Callable[[Any], tuple[Unsampled, ...]] = lambda _settings: ()
