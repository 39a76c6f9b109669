"""Settings of the reducer tests: defaults by the reducer's size, and a short form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

from torquebench.campaign.reducers.catalogue import PARTS
from torquebench.campaign.reducers.work import RepeatedSettings
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.procedures.reducers.empty_run import EmptyRunSettings
from torquebench.procedures.reducers.loop import BenchTwistSettings, even_positions
from torquebench.procedures.reducers.setup import ReducerLimits
from torquebench.reducers import ReducerDescription


def reducer_limits(reducer: ReducerDescription) -> ReducerLimits:
    """Return the limits of a plan from a reducer's data sheet."""
    return ReducerLimits(
        ratio=reducer.signed_ratio,
        rated_torque_nm=reducer.rated_torque_nm,
        largest_torque_nm=reducer.acceleration_torque_nm,
        largest_input_rpm=reducer.max_input_speed_rpm,
    )


@dataclass(frozen=True)
class ReducerTestSettings:
    """Settings of every test.

    Parameters
    ----------
    plans : mapping of str to object
        Settings of each test's plan, by the test's name.
    bench_twist : BenchTwistSettings or None
        Settings for measuring the bench's twist against the calibrator before torque-angle loops;
        None skips it.
    empty_run : EmptyRunSettings or None
        Settings of the empty run of both shafts before no-load torque and efficiency, whose
        readings are subtracted; None skips it.
    tare_always : bool
        Whether the empty run is measured even if the measuring chains correct the effects of
        rotation.
    twist_arcmin_per_nm : float or None
        The bench's own twist if known, arcmin/(N·m); it isn't measured then.
    is_short : bool
        Whether the test is short: results are marked short, and a pass is only conditional.
    """

    plans: Mapping[str, Any] = field(
        default_factory=lambda: {test.name: test.work().settings for test in PARTS}
    )
    bench_twist: BenchTwistSettings | None = field(default_factory=BenchTwistSettings)
    empty_run: EmptyRunSettings | None = field(default_factory=EmptyRunSettings)
    tare_always: bool = False
    twist_arcmin_per_nm: float | None = None
    is_short: bool = False

    def repeated(self, name: str) -> RepeatedSettings | None:
        """Return the settings of a test that repeats until its means are certain, or None."""
        plan = self.plans[name]
        return plan if isinstance(plan, RepeatedSettings) else None

    def with_plans(self, changed: Mapping[str, Any]) -> Self:
        """Return the settings with those of some tests replaced, by the tests' names."""
        return replace(self, plans={**self.plans, **changed})

    def longest(self) -> Self:
        """Return the settings with the largest number of repeats that tests may add."""
        repeated = {name: self.repeated(name) for name in self.plans}
        return self.with_plans({name: plan.longest() for name, plan in repeated.items() if plan})

    def with_repeats(self, most: int) -> Self:
        """Return the settings with at most so many repeats of running tests and of the empty run.

        Every change of speed adds a scatter that is the same for small and large torques: only
        repeats average it, in the test and in the empty run.

        Raises
        ------
        InputError
            Less than one repeat.
        """
        if most < 1:
            raise InputError(Message("{most} repeats", most), "at least 1")
        repeated = {name: self.repeated(name) for name in self.plans}
        changed = {name: plan.with_repeats(most) for name, plan in repeated.items() if plan}
        empty = self.empty_run
        return replace(
            self.with_plans(changed),
            empty_run=empty if empty is None else replace(empty, repeats=most),
        )

    def with_loops(self, loops: int | None = None, positions: int | None = None) -> Self:
        """Return the settings with new numbers of loops and positions; None keeps a number."""
        settings = self.plans["hysteresis"]
        if loops is not None:
            settings = replace(settings, loops=loops)
        if positions is not None:
            settings = replace(settings, positions_deg=even_positions(positions))
        return self.with_plans({"hysteresis": settings})

    @classmethod
    def short(cls) -> Self:
        """Return settings of a short test: few points, no warm-up, no empty run."""
        return cls(
            plans={test.name: test.work().short for test in PARTS},
            bench_twist=BenchTwistSettings(cycles=1),
            empty_run=None,
            is_short=True,
        )
