"""Tests of a mounted reducer: rehearsed, measured, evaluated, judged, recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any

import numpy as np

from torquebench import __version__
from torquebench.bench.devices import BenchDevices, RampTo
from torquebench.bench.roles import SIDES
from torquebench.campaign.measuring import OnPause, measure, operator_name
from torquebench.campaign.progress import NO_PROGRESS, Progress
from torquebench.campaign.reducer_evaluation import (
    EVALUATIONS,
    Bench,
    Evaluated,
    TwistCompliance,
    twist_compliance,
)
from torquebench.campaign.reducer_results import (
    ReducerTestRecord,
    TestName,
    TestOutcome,
    TestQuantity,
    TestRehearsal,
    plain_budget,
    worst_verdict,
)
from torquebench.campaign.reducer_settings import ReducerTestSettings, reducer_limits
from torquebench.errors import InputError
from torquebench.procedures import Plan, Rehearsal, rehearse
from torquebench.procedures.reducer_breakaway import breakaway
from torquebench.procedures.reducer_loop import bench_twist, hysteresis_loops
from torquebench.procedures.reducer_running import efficiency_map, no_load_running
from torquebench.procedures.reducer_setup import ReducerLimits
from torquebench.procedures.reducer_turning import transmission_error
from torquebench.reducers import AnyResult, QuantityVerdict, ReducerDescription, verdicts
from torquebench.station import RunRecord, Station

__all__ = ["TESTS", "ReducerTest", "rehearse_reducer_test", "run_reducer_test"]

RPM_PER_RAD_S = 30.0 / np.pi
ARCMIN = np.pi / 180.0 / 60.0

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
    """

    name: TestName
    title: str
    about: str
    plan: MakePlan | None
    warm_up: Callable[[ReducerTestSettings], float] = lambda _settings: 0.0


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
            ),
            ReducerTest(
                "efficiency",
                "Efficiency",
                "Input driven, output braking, warm: efficiency over torque and speed.",
                _efficiency,
                lambda settings: settings.efficiency.warm_up.longest_s,
            ),
            ReducerTest("full", "Full test", "All tests, cold ones first, in one report.", None),
        )
    }
)
"""Tests by name, in the order of the full test: what doesn't heat the reducer comes first."""


def _chosen(name: str) -> list[ReducerTest]:
    if name not in TESTS:
        raise InputError(f"a reducer test {name!r}", f"one of {', '.join(TESTS)}")
    return [test for test in TESTS.values() if test.plan] if name == "full" else [TESTS[name]]


def rehearse_reducer_test(
    station: Station,
    name: str,
    reducer: ReducerDescription,
    settings: ReducerTestSettings | None = None,
) -> tuple[TestRehearsal, ...]:
    """Go through the plans of a test without moving anything.

    Raises
    ------
    InputError
        There is no test of this name.
    LimitError, InterlockError
        The data sheet or the bench doesn't allow it.
    """
    settings, limits = settings or ReducerTestSettings(), reducer_limits(reducer)
    return tuple(
        _rehearsed(
            test,
            rehearse(station.devices, _plan(test, station.devices, limits, settings)),
            test.warm_up(settings),
        )
        for test in _chosen(name)
    )


def _plan(
    test: ReducerTest, devices: BenchDevices, limits: ReducerLimits, settings: ReducerTestSettings
) -> Plan[Any]:
    if test.plan is None:
        raise InputError("the plan of a full test", "one of its parts")
    return test.plan(devices, limits, settings)


def _rehearsed(test: ReducerTest, found: Rehearsal[Any], warm_up_s: float) -> TestRehearsal:
    torque: dict[str, float] = dict.fromkeys(SIDES, 0.0)
    speed: dict[str, float] = dict.fromkeys(SIDES, 0.0)
    modes: dict[str, list[str]] = {side: [] for side in SIDES}
    for move in found.moves:
        side, _, what = move.device.partition(" ")
        if side not in modes:
            continue
        if what == "mode" and modes[side][-1:] != [str(move.value)]:
            modes[side].append(str(move.value))
        elif what == "speed":
            value = abs(float(move.value)) * RPM_PER_RAD_S  # type: ignore[arg-type]
            speed[side] = max(speed[side], value)
        elif what in ("torque", "ramp"):
            target = move.value.torque_nm if isinstance(move.value, RampTo) else move.value
            torque[side] = max(torque[side], abs(float(target)))  # type: ignore[arg-type]
    return TestRehearsal(
        name=test.name,
        title=test.title,
        duration_s=found.duration_s,
        longest_warm_up_s=warm_up_s,
        points=found.points,
        largest_torque_nm=torque,
        largest_speed_rpm=speed,
        modes={side: tuple(seen) for side, seen in modes.items()},
    )


def run_reducer_test(
    station: Station,
    name: str,
    reducer: ReducerDescription,
    settings: ReducerTestSettings | None = None,
    *,
    serial: str = "",
    progress: Progress = NO_PROGRESS,
    on_pause: OnPause | None = None,
) -> ReducerTestRecord:
    """Put the reducer to a test; every part is a run of its own, named ``test-NAME``.

    All parts are rehearsed before the first of them moves anything.

    Parameters
    ----------
    station : Station
    name : str
        One of `TESTS`.
    reducer : ReducerDescription
        Its type: ratio, limits, data sheet.
    settings : ReducerTestSettings, optional
    serial : str
        Of the specimen.
    progress, on_pause
        As in `measure_calibration`.

    Raises
    ------
    InputError
        There is no test of this name, or what was recorded can't be evaluated.
    LimitError, InterlockError
        Before anything moves.
    RunAbortedError
        Somebody ended the run.
    SignalFault, BenchError
        Something failed meanwhile; the bench is without torque.
    """
    settings, started, began_s = (
        settings or ReducerTestSettings(),
        datetime.now(UTC),
        station.clock.now(),
    )
    rehearse_reducer_test(station, name, reducer, settings)
    specimen = _Specimen(station, reducer, settings, serial, progress, on_pause)
    outcomes = tuple(specimen.test(test) for test in _chosen(name))
    return ReducerTestRecord(
        name=TESTS[name].name,
        reducer_name=reducer.name,
        serial=serial,
        reducer=reducer.model_dump(mode="json"),
        outcomes=outcomes,
        simulated=station.description.simulated,
        started=started,
        bench_name=station.description.name,
        operator=operator_name(),
        software_version=__version__,
        bench_seconds=station.clock.now() - began_s,
    )


@dataclass
class _Specimen:
    """One reducer on one bench, tested once or several times."""

    station: Station
    reducer: ReducerDescription
    settings: ReducerTestSettings
    serial: str
    progress: Progress
    on_pause: OnPause | None

    def test(self, test: ReducerTest) -> TestOutcome:
        bench = Bench(self.station.description, self._twist(test))
        evaluation = EVALUATIONS[test.name]
        limits = reducer_limits(self.reducer)
        kept: list[tuple[Any, Evaluated, tuple[QuantityVerdict, ...]]] = []

        def evaluated() -> Plan[Any]:
            recording = yield from _plan(test, self.station.devices, limits, self.settings)
            found = evaluation(bench, self.reducer, recording)
            judged = verdicts(found.result, self.reducer)
            kept.append((recording, found, judged))
            return self._results(test, found, judged)

        run = self._run(f"test-{test.name}", test.title, evaluated, test)
        recording, found, judged = kept[-1]
        quantities = _quantities(found.result, judged)
        findings = getattr(found.result, "findings", ())
        return TestOutcome(
            name=test.name,
            title=test.title,
            quantities=quantities,
            verdict=worst_verdict(each.verdict for each in quantities),
            remarks=(*found.remarks, *(str(each) for each in findings)),
            recording=recording,
            result=found.result,
            run=run,
        )

    def _run(
        self, kind: str, title: str, plan: Callable[[], Plan[Any]], test: ReducerTest | None
    ) -> RunRecord:
        rehearsed = plan
        if test is not None:  # what a rehearsal records can't be evaluated
            limits = reducer_limits(self.reducer)

            def rehearsed() -> Plan[Any]:
                return _plan(test, self.station.devices, limits, self.settings)

        return measure(
            self.station,
            plan,
            rehearsed=rehearsed,
            kind=kind,
            title=title,
            metadata={
                "side": "output",
                "reducer_name": self.reducer.name,
                "serial": self.serial,
                "profile_name": self.reducer.name,
                "operator": operator_name(),
            },
            progress=self.progress,
            on_pause=self.on_pause,
        ).record

    def _twist(self, test: ReducerTest) -> TwistCompliance:
        """Return the bench's own twist; measured where that was asked for and matters."""
        known = self.settings.twist_arcmin_per_nm
        if known is not None:
            return TwistCompliance(known * ARCMIN, 0.02 * abs(known) * ARCMIN, "as stated, ± 2 %")
        twist = self.settings.bench_twist
        if test.name != "hysteresis" or twist is None:
            return TwistCompliance()
        record = self._run(
            "bench-twist",
            "Twist of the bench itself",
            lambda: bench_twist(self.station.devices, twist, ("output",)),
            None,
        )
        return twist_compliance(record.result)

    def _results(
        self, test: ReducerTest, found: Evaluated, judged: tuple[QuantityVerdict, ...]
    ) -> dict[str, Any]:
        """Return what stands in the run's ``results.json``."""
        budgets = {each.key: plain_budget(each.estimate) for each in found.result.quantities()}
        return {
            "test": test.name,
            "reducer": self.reducer.model_dump(mode="json"),
            "serial": self.serial,
            "simulated": self.station.description.simulated,
            "software_version": __version__,
            "quantities": [
                {**vars(each), "budget": budgets[each.key]}
                for each in _quantities(found.result, judged)
            ],
            "findings": list(getattr(found.result, "findings", ())),
            "remarks": list(found.remarks),
            "evaluation": found.result,
        }


def _quantities(result: AnyResult, judged: tuple[QuantityVerdict, ...]) -> tuple[TestQuantity, ...]:
    limits = {each.key: each for each in judged}
    rows = []
    for each in result.quantities():
        verdict = limits.get(each.key)
        rows.append(
            TestQuantity(
                key=each.key,
                title=each.title,
                value=each.estimate.value,
                expanded_uncertainty=each.estimate.expanded_uncertainty(),
                unit=each.estimate.unit,
                limit="" if verdict is None else verdict.limit,
                verdict="" if verdict is None else verdict.decision.verdict.value,
                rule=each.rule,
            )
        )
    return tuple(rows)
