"""The tests of a reducer: each is one entry with its plan, its evaluation and what it needs.

The entries import nothing of the bench until they are used, so that help can list them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from torquebench.errors import InputError

if TYPE_CHECKING:
    from torquebench.bench.devices import BenchDevices
    from torquebench.campaign.reducers.evaluation import Evaluated
    from torquebench.campaign.reducers.sampling import Unsampled
    from torquebench.campaign.reducers.settings import ReducerTestSettings
    from torquebench.campaign.reducers.uncertainty import Bench
    from torquebench.procedures import Plan
    from torquebench.procedures.reducers.setup import ReducerLimits
    from torquebench.reducers import ReducerDescription

    MakePlan = Callable[[BenchDevices, ReducerLimits, ReducerTestSettings], Plan[Any]]
    Evaluate = Callable[[Bench, ReducerDescription, Any], Evaluated]

__all__ = ["TESTS", "ReducerTest", "TestName", "chosen_tests"]

TestName = Literal[
    "starting", "back-driving", "transmission-error", "hysteresis", "no-load", "efficiency", "full"
]


@dataclass(frozen=True)
class ReducerTest:
    """One test of a reducer.

    Parameters
    ----------
    name, title : str
    about : str
        What is driven, what is held, what is measured, in one sentence.
    axes : tuple of str
        Live signals of its chart: across and up.
    make_plan : callable or None
        Makes its plan; None for the test that runs all others.
    evaluate : callable or None
        Turns what the plan recorded into a result.
    warm_up_s : callable
        Returns the longest warm-up of the test, s.
    until_known : bool
        Whether it repeats until its means are known well enough.
    loads_output : bool
        Whether it loads the output as far as its plan says.
    bench_twist, empty_run : bool
        What the bench has to measure of itself before.
    unsampled : callable
        Returns the influences that the test leaves out by its settings.
    """

    name: TestName
    title: str
    about: str
    axes: tuple[str, str] = ("", "")
    make_plan: MakePlan | None = None
    evaluate: Evaluate | None = None
    warm_up_s: Callable[[ReducerTestSettings], float] = lambda _settings: 0.0
    until_known: bool = False
    loads_output: bool = False
    bench_twist: bool = False
    empty_run: bool = False
    unsampled: Callable[[ReducerTestSettings], tuple[Unsampled, ...]] = lambda _settings: ()

    def plan(
        self, devices: BenchDevices, limits: ReducerLimits, settings: ReducerTestSettings
    ) -> Plan[Any]:
        """Make the plan of a test that isn't the full one.

        Raises
        ------
        InputError
            It is the full test.
        """
        if self.make_plan is None:
            raise InputError(f"the plan of the test {self.name!r}", "one of its parts")
        return self.make_plan(devices, limits, settings)


def _starting(devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings) -> Plan[Any]:
    from torquebench.procedures.reducers.first_motion import breakaway

    return breakaway(devices, limits, "input", of.starting)


def _back_driving(
    devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings
) -> Plan[Any]:
    from torquebench.procedures.reducers.first_motion import breakaway

    return breakaway(devices, limits, "output", of.back_driving)


def _ramps(bench: Bench, reducer: ReducerDescription, recording: Any) -> Evaluated:
    from torquebench.campaign.reducers.evaluation import evaluate_ramps

    return evaluate_ramps(bench, reducer, recording)


def _turning(devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings) -> Plan[Any]:
    from torquebench.procedures.reducers.turning import transmission_error

    return transmission_error(devices, limits, of.transmission)


def _angles(bench: Bench, reducer: ReducerDescription, recording: Any) -> Evaluated:
    from torquebench.campaign.reducers.evaluation import evaluate_angles

    return evaluate_angles(bench, reducer, recording)


def _hysteresis(devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings) -> Plan[Any]:
    from torquebench.procedures.reducers.loop import hysteresis_loops

    limits.check_modules(devices)
    return hysteresis_loops(devices, limits, of.hysteresis)


def _loops(bench: Bench, reducer: ReducerDescription, recording: Any) -> Evaluated:
    from torquebench.campaign.reducers.evaluation import evaluate_loops

    return evaluate_loops(bench, reducer, recording)


def _no_load(devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings) -> Plan[Any]:
    from torquebench.procedures.reducers.running import no_load_running

    return no_load_running(devices, limits, of.no_load.within(limits))


def _running(bench: Bench, reducer: ReducerDescription, recording: Any) -> Evaluated:
    from torquebench.campaign.reducers.evaluation import evaluate_running

    return evaluate_running(bench, reducer, recording)


def _efficiency(devices: BenchDevices, limits: ReducerLimits, of: ReducerTestSettings) -> Plan[Any]:
    from torquebench.procedures.reducers.running import efficiency_map

    limits.check_modules(devices)
    return efficiency_map(devices, limits, of.efficiency.within(limits))


def _grid(bench: Bench, reducer: ReducerDescription, recording: Any) -> Evaluated:
    from torquebench.campaign.reducers.evaluation import evaluate_grid

    return evaluate_grid(bench, reducer, recording)


def _few_ramps(settings: ReducerTestSettings) -> tuple[Unsampled, ...]:
    from torquebench.campaign.reducers.sampling import few_positions

    return few_positions(settings.starting.positions)


def _few_back_driving_ramps(settings: ReducerTestSettings) -> tuple[Unsampled, ...]:
    from torquebench.campaign.reducers.sampling import few_positions

    return few_positions(settings.back_driving.positions)


def _few_loops(settings: ReducerTestSettings) -> tuple[Unsampled, ...]:
    from torquebench.campaign.reducers.sampling import few_positions

    return few_positions(len(settings.hysteresis.positions_deg))


def _cold_running(settings: ReducerTestSettings) -> tuple[Unsampled, ...]:
    from torquebench.campaign.reducers.sampling import cold_friction

    return cold_friction(settings.no_load.warm_up.longest_s)


def _cold_map(settings: ReducerTestSettings) -> tuple[Unsampled, ...]:
    from torquebench.campaign.reducers.sampling import cold_efficiency

    return cold_efficiency(settings.efficiency.warm_up.longest_s)


TESTS: Mapping[str, ReducerTest] = MappingProxyType(
    {
        test.name: test
        for test in (
            ReducerTest(
                name="starting",
                title="Starting torque",
                about="Input torque rises slowly, output free, until the input turns.",
                axes=("input_angle_deg", "input_torque_nm"),
                make_plan=_starting,
                evaluate=_ramps,
                unsampled=_few_ramps,
            ),
            ReducerTest(
                name="back-driving",
                title="Back-driving torque",
                about="Output torque rises slowly, input free, until the output turns.",
                axes=("output_angle_deg", "output_torque_nm"),
                make_plan=_back_driving,
                evaluate=_ramps,
                unsampled=_few_back_driving_ramps,
            ),
            ReducerTest(
                name="transmission-error",
                title="Transmission error",
                about="Both angles over full output revolutions, without load, in both directions.",
                axes=("input_angle_deg", "output_angle_deg"),
                make_plan=_turning,
                evaluate=_angles,
            ),
            ReducerTest(
                name="hysteresis",
                title="Torque-angle loop",
                about="Input locked, output loaded: stiffness, backlash, lost motion, loop energy.",
                axes=("output_angle_deg", "output_torque_nm"),
                make_plan=_hysteresis,
                evaluate=_loops,
                unsampled=_few_loops,
                loads_output=True,
                bench_twist=True,
            ),
            ReducerTest(
                name="no-load",
                title="No-load running torque",
                about="Input driven in steps of speed, output free, warm: friction against speed.",
                axes=("input_speed_rpm", "input_torque_nm"),
                make_plan=_no_load,
                evaluate=_running,
                unsampled=_cold_running,
                warm_up_s=lambda settings: settings.no_load.warm_up.longest_s,
                until_known=True,
                empty_run=True,
            ),
            ReducerTest(
                name="efficiency",
                title="Efficiency",
                about="Input driven, output braking, warm: efficiency over torque and speed.",
                axes=("output_torque_nm", "input_torque_nm"),
                make_plan=_efficiency,
                evaluate=_grid,
                unsampled=_cold_map,
                warm_up_s=lambda settings: settings.efficiency.warm_up.longest_s,
                until_known=True,
                loads_output=True,
                empty_run=True,
            ),
            ReducerTest("full", "Full test", "All tests, cold ones first, in one report."),
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
    return [test for test in TESTS.values() if test.make_plan] if name == "full" else [TESTS[name]]
