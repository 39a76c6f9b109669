"""How each reducer test is driven: defaults by the reducer's size, and a short form."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

from torquebench.errors import InputError
from torquebench.procedures.reducers.empty_run import EmptyRunSettings
from torquebench.procedures.reducers.first_motion import BreakawaySettings
from torquebench.procedures.reducers.friction import FrictionSettings
from torquebench.procedures.reducers.loop import (
    BenchTwistSettings,
    HysteresisSettings,
    even_positions,
)
from torquebench.procedures.reducers.running import EfficiencySettings, NoLoadSettings
from torquebench.procedures.reducers.setup import ReducerLimits, WarmUp
from torquebench.procedures.reducers.turning import TransmissionSettings
from torquebench.reducers import ReducerDescription

__all__ = ["ReducerTestSettings", "reducer_limits"]


def reducer_limits(reducer: ReducerDescription) -> ReducerLimits:
    """Return what a plan must keep to, from a reducer's data sheet."""
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
    no_load, starting, back_driving, hysteresis, transmission, efficiency
        Of each test's plan.
    bench_twist : BenchTwistSettings or None
        How the bench's own twist is measured against the calibrator before torque-angle loops;
        None leaves it out.
    empty_run : EmptyRunSettings or None
        How both shafts are turned alone before no-load torque and efficiency, so that what they
        read then is taken off; None leaves it out.
    twist_arcmin_per_nm : float or None
        The bench's own twist where it is known already, arcmin/(N·m); then it isn't measured.
    is_short : bool
        Whether this is a first look: results are marked short, and no limit counts as kept
        without condition.
    """

    no_load: NoLoadSettings = field(default_factory=NoLoadSettings)
    starting: BreakawaySettings = field(default_factory=BreakawaySettings)
    back_driving: BreakawaySettings = field(default_factory=BreakawaySettings)
    hysteresis: HysteresisSettings = field(default_factory=HysteresisSettings)
    transmission: TransmissionSettings = field(default_factory=TransmissionSettings)
    efficiency: EfficiencySettings = field(default_factory=EfficiencySettings)
    bench_twist: BenchTwistSettings | None = field(default_factory=BenchTwistSettings)
    empty_run: EmptyRunSettings | None = field(default_factory=EmptyRunSettings)
    twist_arcmin_per_nm: float | None = None
    is_short: bool = False

    def longest(self) -> Self:
        """Return the settings with all repeats that tests may add."""
        return replace(self, no_load=self.no_load.longest(), efficiency=self.efficiency.longest())

    def with_repeats(self, most: int) -> Self:
        """Return the settings with so many repeats of running tests at most, and of the empty run.

        Small torques scatter with every change of speed as larger ones do: only repeats average
        that, in the test and in what is taken off.

        Raises
        ------
        InputError
            Less than one repeat.
        """
        if most < 1:
            raise InputError(f"{most} repeats", "at least 1")
        sweep = replace(self.no_load.sweep, repeats=min(self.no_load.sweep.repeats, most))
        empty = self.empty_run
        return replace(
            self,
            no_load=replace(self.no_load, sweep=sweep, most_repeats=most),
            efficiency=replace(
                self.efficiency, repeats=min(self.efficiency.repeats, most), most_repeats=most
            ),
            empty_run=empty if empty is None else replace(empty, repeats=most),
        )

    def with_loops(self, loops: int | None = None, positions: int | None = None) -> Self:
        """Return the settings with other numbers of loops and output positions; None keeps one."""
        settings = self.hysteresis
        if loops is not None:
            settings = replace(settings, loops=loops)
        if positions is not None:
            settings = replace(settings, positions_deg=even_positions(positions))
        return replace(self, hysteresis=settings)

    @classmethod
    def short(cls) -> Self:
        """Return settings for a first look: few points, no warming up, no empty run."""
        cold = WarmUp(longest_s=0.0)
        sweep = FrictionSettings(speeds_rpm=(100.0, 200.0, 300.0, 500.0, 700.0, 1000.0), repeats=2)
        return cls(
            no_load=NoLoadSettings(sweep, cold, target_percent=None),
            starting=BreakawaySettings(positions=2),
            back_driving=BreakawaySettings(positions=2),
            hysteresis=HysteresisSettings(loops=2, positions_deg=(0.0,), loop_s=20.0),
            transmission=TransmissionSettings(output_rpm=4.0),
            efficiency=EfficiencySettings(
                torque_shares=(0.25, 0.5, 1.0),
                speeds_rpm=(300.0, 900.0),
                counter_clockwise=False,
                repeats=1,
                target_points=None,
                warm_up=cold,
            ),
            bench_twist=BenchTwistSettings(cycles=1),
            empty_run=None,
            is_short=True,
        )
