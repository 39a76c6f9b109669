"""Load a sequence of steps, and measure a steady value at each recorded step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from torquebench.bench.devices import BenchDevices, Point, SteadySettings
from torquebench.bench.roles import Seating
from torquebench.calibration import Step
from torquebench.message import Message
from torquebench.procedures.messages import (
    again_after_pause,
    move,
    prepare,
    progress,
    sleep,
    take,
)
from torquebench.procedures.setup import Plan, Setup, power_on, reseat
from torquebench.procedures.standard_check import StandardCheck, TakenStep
from torquebench.procedures.zeroing import zero

Row = Mapping[str, Any]
"""Values of one event by field, without device names."""

SETTLE_SHARE = 0.4
"""Share of a step's duration for settling; the rest is averaged."""


def steady_settings(step: Step) -> SteadySettings:
    """Return the settings for the steady value of a step.

    Examples
    --------
    >>> step = Step(kind="point", series=1, index=0, nominal_nm=40.0, branch=1, duration_s=0.5)
    >>> steady_settings(step)
    SteadySettings(settle_s=0.2, window_s=0.3, limit_s=0.0, period_s=None, reference=True)
    """
    settle_s = SETTLE_SHARE * step.duration_s
    return SteadySettings(
        settle_s=settle_s,
        window_s=step.duration_s - settle_s,
        limit_s=step.settle_limit_s,
        reference=True,
    )


def describe_step(step: Step) -> str:
    """Return a description of a step for progress lines.

    Examples
    --------
    >>> describe_step(Step(kind="point", series=2, index=4, nominal_nm=-40.0, branch=-1,
    ...                    duration_s=0.5))
    'series 2, point 5: -40 N·m, down'
    """
    if step.kind == "zero":
        return Message("series {series}, zero", step.series) if step.series else "zero"
    if not step.recorded:
        return Message("{kind}: {nominal_nm:g} N·m", step.kind, step.nominal_nm)
    branch = "up" if step.branch > 0 else "down"
    return Message(
        "series {series}, point {point}: {torque:g} N·m, {branch}",
        step.series,
        step.index + 1,
        step.nominal_nm,
        branch,
    )


@dataclass
class _Loader:
    """Loads the steps of one module in turn."""

    devices: BenchDevices
    setup: Setup
    steps: Sequence[Step]
    check: StandardCheck | None = None
    settings: SteadySettings | None = None

    def load(self, step: Step, on_row: Callable[[Step, Row], None]) -> Plan[None]:
        """Load one step: seat again if it says so, then zero, record or hold."""
        if step.change != "none":
            seating = Seating(step.change, step.position_deg)
            yield from reseat(self.devices, self.setup, seating)
            yield from power_on(self.devices, self.setup.side)
        if step.kind == "zero":
            yield from self._zero(step)
        elif step.recorded:
            wanted = steady_settings(step)
            if wanted != self.settings:
                yield from prepare(self._module.steady, wanted, wait=True)
                self.settings = wanted
            yield from self._stamp(step)
            yield from move(self._module.drive.torque, step.nominal_nm)
            row = yield from take(self._module.steady, self.devices.point, stream="points")
            yield from self._checked(TakenStep(step, row))
            on_row(step, row)
        else:
            yield from move(self._module.drive.torque, step.nominal_nm)
            yield from sleep(step.duration_s)
            yield from self._checked(TakenStep(step))

    def _zero(self, step: Step) -> Plan[None]:
        """Take the zero of reading and standard, as a step of its own."""
        yield from self._stamp(step)
        side = self.setup.side
        zeroed = yield from zero(self.devices, side, duration_s=step.duration_s, standard=True)
        yield from self._checked(TakenStep(step, standard_zero=zeroed.standard_signal))
        self.settings = None  # zeros are recorded separately

    def _stamp(self, step: Step) -> Plan[None]:
        """State a step's place in the profile in the next document."""
        point = Point(
            series=step.series,
            step=step.index,
            branch=step.branch,
            nominal_nm=step.nominal_nm,
            position_deg=step.position_deg,
            group=step.series,
        )
        yield from move(self.devices.point, point)

    def _checked(self, taken: TakenStep) -> Plan[None]:
        """Compare the standard with the module after a step."""
        if self.check is not None:
            yield from move(self.check, taken)

    def return_to_branch(self, number: int) -> Plan[None]:
        """Restore the chain's hysteresis after a pause at zero torque.

        A rising branch from zero is the same as before the pause; a falling branch needs the
        turning point of its series again.
        """
        step = self.steps[number]
        if step.kind == "point" and step.branch < 0:
            yield from move(self._module.drive.torque, self.turning_point(number))
            yield from sleep(step.duration_s)

    def turning_point(self, number: int) -> float:
        """Return the torque at which the falling branch of a step began."""
        target = 0.0
        for step in reversed(self.steps[: number + 1]):
            if step.kind == "zero" or step.nominal_nm * target < 0.0:
                break
            if abs(step.nominal_nm) >= abs(target):
                target = step.nominal_nm
        return target

    @property
    def _module(self) -> Any:
        return self.devices.module(self.setup.side)


def load_staircase(
    devices: BenchDevices,
    setup: Setup,
    steps: Sequence[Step],
    on_row: Callable[[Step, Row], None],
    *,
    done: int = 0,
    total: int | None = None,
    check: StandardCheck | None = None,
) -> Plan[None]:
    """Load the steps of a sequence, with a checkpoint before each.

    A run must be open; points go to its stream "points", zeros to a separate one. After a pause,
    which removes the load, the present branch is approached again as in its series.

    Parameters
    ----------
    setup : Setup
        Setup of the run; used again for steps that re-seat the standard.
    steps : sequence of Step
        Steps from `Profile.staircase`.
    on_row : callable
        Called with every recorded step and its steady value by field.
    done, total : int
        For the progress, if these steps are part of a run: number of earlier steps, and of all.
    check : StandardCheck, optional
        Compares the standard with the module before and at the first steps.
    """
    loader = _Loader(devices, setup, steps, check)
    total = total or done + len(steps)
    # From here on the standard is monitored, also during preloads.
    steady = devices.module(setup.side).steady
    yield from prepare(steady, SteadySettings(reference=True), wait=True)
    yield from power_on(devices, setup.side)
    for number, step in enumerate(steps):
        yield from progress(done + number, total, describe_step(step))
        yield from again_after_pause(
            partial(loader.load, step, on_row), partial(loader.return_to_branch, number)
        )
    yield from progress(done + len(steps), total, "done")
