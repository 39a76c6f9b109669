"""The tests that a reducer can be put to: what each is about, and its plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from torquebench.bench.devices import BenchDevices
from torquebench.campaign.reducers.results import TestName
from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.errors import InputError
from torquebench.procedures import Plan
from torquebench.procedures.reducers.first_motion import breakaway
from torquebench.procedures.reducers.loop import hysteresis_loops
from torquebench.procedures.reducers.running import efficiency_map, no_load_running
from torquebench.procedures.reducers.setup import ReducerLimits
from torquebench.procedures.reducers.turning import transmission_error

__all__ = ["TESTS", "ReducerTest", "chosen_tests", "plan_of"]

MakePlan = Callable[[BenchDevices, ReducerLimits, ReducerTestSettings], Plan[Any]]


@dataclass(frozen=True)
class ReducerTest:
    """One test that a reducer can be put to.

    Parameters
    ----------
    name, title : str
    about : str
        What is driven, what is held, what is found, in one sentence.
    plan : callable or None
        Makes its plan; None for the test that runs all others.
    warm_up : callable
        Returns the longest warm-up of the test, s.
    repeats_on : bool
        Whether it repeats until its means are known well enough.
    """

    name: TestName
    title: str
    about: str
    plan: MakePlan | None
    warm_up: Callable[[ReducerTestSettings], float] = lambda _settings: 0.0
    repeats_on: bool = False


def _no_load(devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings) -> Plan[Any]:
    return no_load_running(devices, limits, of.no_load.within(limits))


def _starting(devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings) -> Plan[Any]:
    return breakaway(devices, limits, "input", of.starting)


def _back_driving(
    devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings
) -> Plan[Any]:
    return breakaway(devices, limits, "output", of.back_driving)


def _hysteresis(devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings) -> Plan[Any]:
    limits.check_modules(devices)
    return hysteresis_loops(devices, limits, of.hysteresis)


def _turning(devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings) -> Plan[Any]:
    return transmission_error(devices, limits, of.transmission)


def _efficiency(devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings) -> Plan[Any]:
    limits.check_modules(devices)
    return efficiency_map(devices, limits, of.efficiency.within(limits))


TESTS: Mapping[str, ReducerTest] = MappingProxyType(
    {
        test.name: test
        for test in (
            ReducerTest(
                "starting",
                "Starting torque",
                "Input torque rises slowly, output free, until the input turns.",
                _starting,
            ),
            ReducerTest(
                "back-driving",
                "Back-driving torque",
                "Output torque rises slowly, input free, until the output turns.",
                _back_driving,
            ),
            ReducerTest(
                "transmission-error",
                "Transmission error",
                "Both angles over full output revolutions, without load, in both directions.",
                _turning,
            ),
            ReducerTest(
                "hysteresis",
                "Torque-angle loop",
                "Input locked, output loaded: stiffness, backlash, lost motion, loop energy.",
                _hysteresis,
            ),
            ReducerTest(
                "no-load",
                "No-load running torque",
                "Input driven in steps of speed, output free, warm: friction against speed.",
                _no_load,
                lambda settings: settings.no_load.warm_up.longest_s,
                repeats_on=True,
            ),
            ReducerTest(
                "efficiency",
                "Efficiency",
                "Input driven, output braking, warm: efficiency over torque and speed.",
                _efficiency,
                lambda settings: settings.efficiency.warm_up.longest_s,
                repeats_on=True,
            ),
            ReducerTest("full", "Full test", "All tests, cold ones first, in one report.", None),
        )
    }
)
"""Tests by name, in the order of the full test: what doesn't heat the reducer comes first."""


def chosen_tests(name: str) -> list[ReducerTest]:
    """Return the tests of a name; of the full test all parts.

    Raises
    ------
    InputError
        There is no test of this name.
    """
    if name not in TESTS:
        raise InputError(f"a reducer test {name!r}", f"one of {', '.join(TESTS)}")
    return [test for test in TESTS.values() if test.plan] if name == "full" else [TESTS[name]]


def plan_of(
    test: ReducerTest, devices: BenchDevices, limits: ReducerLimits, settings: ReducerTestSettings
) -> Plan[Any]:
    """Make the plan of a test that isn't the full one."""
    if test.plan is None:
        raise InputError("the plan of a full test", "one of its parts")
    return test.plan(devices, limits, settings)
