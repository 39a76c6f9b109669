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
from torquebench.procedures.reducers.loop import BenchTwistRecording, bench_twist
from torquebench.procedures.reducers.running_table import RunningRecording
from torquebench.procedures.reducers.setup import ReducerLimits
from torquebench.reducers import Tare
from torquebench.units import ARCMIN


@dataclass(eq=False)
class Known:
    """Data of the bench that are stated or recorded before a test.

    Parameters
    ----------
    twist_arcmin_per_nm : float or None
        Stated twist of the bench, arcmin/(N·m).
    twist : BenchTwistRecording or None
        Twist recorded against the calibrator.
    empty : RunningRecording or None
        Empty run, recorded without a reducer.
    """

    twist_arcmin_per_nm: float | None = None
    twist: BenchTwistRecording | None = None
    empty: RunningRecording | None = None

    def needed_by(self, test: ReducerTest) -> Known:
        """Return only the data that the evaluation of a test needs."""
        return Known(
            self.twist_arcmin_per_nm if test.bench_twist else None,
            self.twist if test.bench_twist else None,
            self.empty if test.empty_run else None,
        )

    def twists(self) -> dict[Side, TwistCompliance]:
        """Return the twist of each side; sides of unknown twist are left out."""
        if self.twist is not None:
            return twist_compliances(self.twist)
        stated = self.twist_arcmin_per_nm
        if stated is None:
            return {}
        twist = TwistCompliance(stated * ARCMIN, 0.02 * abs(stated) * ARCMIN, "as stated, ± 2 %")
        return {"output": twist}

    def tares(self, ratio: float) -> dict[Side, Tare]:
        """Return the empty run of each side; `ratio` is negative where the output reverses."""
        return {} if self.empty is None else tares_of(self.empty, ratio)


@dataclass(frozen=True)
class Preparation:
    """A run before the tests, without the reducer mounted.

    Parameters
    ----------
    plan : callable
        Returns its plan.
    learn : callable
        Stores the run's recording in `Known`.
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
    """Return the measurements that some tests need before, grouped by mounting.

    Parameters
    ----------
    tests : collection of ReducerTest
        Tests that will be run.
    rotating : collection of side
        Sides whose measuring chain corrects the effects of rotation: they need an empty run only if
        the settings require it.
    """
    measurements = []
    twist = settings.bench_twist
    largest_nm = settings.plans["hysteresis"].torque_share * limits.rated_torque_nm
    loops_nm: dict[Side, float] = {
        "output": largest_nm,
        "input": largest_nm / abs(limits.ratio),
    }
    needed = any(test.bench_twist for test in tests) and settings.twist_arcmin_per_nm is None
    if needed and twist is not None:

        def keep_twist(known: Known, recording: Any) -> None:
            known.twist = recording

        measurements.append(
            Preparation(
                "bench-twist",
                "Twist of the bench",
                lambda devices: bench_twist(devices, twist, loops_nm=loops_nm),
                keep_twist,
            )
        )
    empty = settings.empty_run
    turning = [side for test in tests for side in test.empty_run]
    if empty is not None and (set(turning) - set(rotating) or (turning and settings.tare_always)):
        within = empty.within(limits)

        def keep_empty_run(known: Known, recording: Any) -> None:
            known.empty = recording

        measurements.append(
            Preparation(
                "empty-run",
                "Empty run, nothing mounted",
                lambda devices: empty_run(devices, limits, within),
                keep_empty_run,
            )
        )
    return measurements
