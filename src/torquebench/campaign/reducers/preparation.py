"""Measurements of the bench before a reducer test: its twist, and readings of empty shafts."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from torquebench.bench.devices import BenchDevices
from torquebench.bench.roles import Side
from torquebench.campaign.reducers.catalogue import ReducerTest
from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.campaign.reducers.twist import TwistCompliance, twist_compliances
from torquebench.campaign.reducers.uncertainty import tares_of
from torquebench.procedures import Plan
from torquebench.procedures.reducers.empty_run import empty_run
from torquebench.procedures.reducers.loop import bench_twist
from torquebench.procedures.reducers.setup import ReducerLimits
from torquebench.reducers import Tare
from torquebench.units import ARCMIN

__all__ = ["Known", "Preparation", "preparations"]


@dataclass
class Known:
    """Known properties of the bench.

    Parameters
    ----------
    twists : mapping of side to TwistCompliance
    tares : mapping of side to Tare
    """

    twists: dict[Side, TwistCompliance]
    tares: dict[Side, Tare]

    @classmethod
    def stated(cls, settings: ReducerTestSettings) -> Known:
        """Return the values stated beforehand."""
        known = settings.twist_arcmin_per_nm
        if known is None:
            return cls({}, {})
        twist = TwistCompliance(known * ARCMIN, 0.02 * abs(known) * ARCMIN, "as stated, ± 2 %")
        return cls({"output": twist}, {})


@dataclass(frozen=True)
class Preparation:
    """A run before the tests, with something else mounted than the reducer.

    Parameters
    ----------
    name, title : str
    plan : callable
        Makes its plan.
    learn : callable
        Enters the run's results.
    """

    name: str
    title: str
    plan: Callable[[BenchDevices], Plan[Any]]
    learn: Callable[[Known, Any], None]


def preparations(
    tests: Collection[ReducerTest],
    limits: ReducerLimits,
    settings: ReducerTestSettings,
    rotating: Collection[Side] = (),
) -> list[Preparation]:
    """Return the measurements needed before some tests, one mounting after the other.

    Parameters
    ----------
    tests : collection of ReducerTest
        The tests that follow.
    limits : ReducerLimits
    settings : ReducerTestSettings
    rotating : collection of side
        Sides whose measuring chain corrects the effects of rotation: they need an empty run only if
        the settings require it.
    """
    found = []
    twist = settings.bench_twist
    largest_nm = settings.plans["hysteresis"].torque_share * limits.rated_torque_nm
    loops_nm: dict[Side, float] = {
        "output": largest_nm,
        "input": largest_nm / abs(limits.ratio),
    }
    needed = any(test.bench_twist for test in tests) and settings.twist_arcmin_per_nm is None
    if needed and twist is not None:

        def twisted(known: Known, recording: Any) -> None:
            known.twists = twist_compliances(recording)

        found.append(
            Preparation(
                "bench-twist",
                "Twist of the bench",
                lambda devices: bench_twist(devices, twist, loops_nm=loops_nm),
                twisted,
            )
        )
    empty = settings.empty_run
    turning = [side for test in tests for side in test.empty_run]
    if empty is not None and (set(turning) - set(rotating) or (turning and settings.tare_always)):
        within = empty.within(limits)

        def emptied(known: Known, recording: Any) -> None:
            known.tares = tares_of(recording, limits.ratio)

        found.append(
            Preparation(
                "empty-run",
                "Empty run, nothing mounted",
                lambda devices: empty_run(devices, limits, within),
                emptied,
            )
        )
    return found
