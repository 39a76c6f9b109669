"""Tests of a mounted reducer: rehearsed, measured, evaluated and recorded."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from typing import Any, Unpack

from torquebench import __version__
from torquebench.bench.roles import SIDES, Side
from torquebench.campaign.measuring import RunAbortedError, RunOptions
from torquebench.campaign.reducers.catalogue import TESTS, chosen_tests
from torquebench.campaign.reducers.preparation import preparations
from torquebench.campaign.reducers.results import (
    ReducerTestFailure,
    ReducerTestOutcome,
    ReducerTestRecord,
    ReducerTestRehearsal,
)
from torquebench.campaign.reducers.settings import ReducerTestSettings, reducer_limits
from torquebench.campaign.reducers.specimen import Specimen
from torquebench.errors import ModelMismatchError, TorquebenchError
from torquebench.message import Message
from torquebench.procedures import Rehearsal, rehearse
from torquebench.records.signatures import operator_name
from torquebench.reducers import ReducerDescription
from torquebench.station import Station
from torquebench.units import RPM_PER_RAD_S


def rehearse_reducer_test(
    station: Station,
    name: str,
    reducer: ReducerDescription,
    settings: ReducerTestSettings | None = None,
) -> tuple[ReducerTestRehearsal, ...]:
    """Rehearse the plans of a test.

    Preparatory measurements (twist of the bench, empty run) come first. A test that repeats until
    its means are certain enough is rehearsed with the smallest and the largest number of repeats.

    Raises
    ------
    InputError
        There is no test of this name.
    LimitError, InterlockError
        The limits of the data sheet or the state of the bench don't allow the test.
    ModelMismatchError
        The output would be loaded beyond the calibrated torque of its active model.
    """
    settings, limits = settings or ReducerTestSettings(), reducer_limits(reducer)
    tests, devices = chosen_tests(name), station.devices
    before = preparations(tests, limits, settings, rotating_sides(station))
    parts = [
        _rehearsed(
            preparation.name, preparation.title, rehearse(devices, preparation.plan(devices))
        )
        for preparation in before
    ]
    for test in tests:
        plan, repeated = test.work().plan, settings.repeated(test.name)
        rehearsal = rehearse(devices, plan(devices, limits, settings.plans[test.name]))
        longest_s = warm_up_s = 0.0
        if repeated is not None:
            longest_s = rehearse(devices, plan(devices, limits, repeated.longest())).duration_s
            warm_up_s = repeated.warm_up.longest_s
        part = _rehearsed(test.name, test.title, rehearsal, longest_s, warm_up_s)
        if test.loads_output:
            _check_calibrated(station, part)
        parts.append(part)
    return tuple(parts)


def rotating_sides(station: Station) -> tuple[Side, ...]:
    """Return the sides whose measuring chain corrects the effects of rotation."""
    acquisition = station.devices.context.acquisition
    chains = {side: acquisition.compensation(side) for side in SIDES}
    return tuple(
        side for side, active in chains.items() if active is not None and active.corrects_rotation
    )


def _check_calibrated(station: Station, part: ReducerTestRehearsal) -> None:
    """Refuse a test that loads the output beyond its model's calibrated torque."""
    active = station.devices.context.acquisition.compensation("output")
    if active is None:
        return
    curve, torque = active.chain.curve, part.largest_torque_nm["output"]
    reached = min(-curve.low_nm, curve.high_nm)
    if torque > reached:
        raise ModelMismatchError(
            Message(
                "{title} to {torque:.4g} N·m with model-{model_id}, which was calibrated "
                "up to {reached:.4g} N·m",
                part.title.lower(),
                torque,
                active.model_id,
                reached,
            ),
            "torques in the calibrated range of the active model",
            "calibrate the output to larger torques, or put another model into use",
        )


def _rehearsed(
    name: str,
    title: str,
    rehearsal: Rehearsal[Any],
    longest_s: float = 0.0,
    warm_up_s: float = 0.0,
) -> ReducerTestRehearsal:
    """Return duration, largest values and modes of a rehearsed test."""
    modes: dict[str, list[str]] = {side: [] for side in SIDES}
    for move in rehearsal.moves:
        side, _, what = move.device.partition(" ")
        if what == "mode" and modes[side][-1:] != [str(move.value)]:
            modes[side].append(str(move.value))
    speed = {side: value * RPM_PER_RAD_S for side, value in rehearsal.largest("speed").items()}
    return ReducerTestRehearsal(
        name=name,
        title=title,
        duration_s=rehearsal.duration_s,
        longest_s=max(rehearsal.duration_s, longest_s),
        longest_warm_up_s=warm_up_s,
        points=rehearsal.points,
        largest_torque_nm=rehearsal.largest("torque"),
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
    **options: Unpack[RunOptions],
) -> ReducerTestRecord:
    """Test the reducer; every part is a run of its own, named ``test-NAME``.

    All parts are rehearsed before anything moves. If a part of the full test fails, its failure is
    recorded, and the other parts are run.

    Parameters
    ----------
    name : str
        One of `TESTS`.
    reducer : ReducerDescription
        Its type: ratio, limits, data sheet.
    serial : str
        Of the specimen.
    **options
        See `RunOptions`.

    Raises
    ------
    InputError
        There is no test of this name, or the recording can't be evaluated.
    LimitError, InterlockError, ModelMismatchError
        The run is refused before anything moves.
    RunAbortedError
        A person aborted the run.
    SignalFault, BenchError
        The test failed; the bench is without torque.
    """
    settings, started, began_s = (
        settings or ReducerTestSettings(),
        datetime.now(UTC),
        station.clock.now(),
    )
    rehearse_reducer_test(station, name, reducer, settings)
    specimen = Specimen(station, reducer, settings, serial, options)
    outcomes, failures = _all_parts(specimen, name)
    return ReducerTestRecord(
        name=TESTS[name].name,
        reducer_name=reducer.name,
        serial=serial,
        reducer=reducer.model_dump(mode="json"),
        outcomes=outcomes,
        failures=failures,
        simulated=station.description.simulated,
        started=started,
        bench_name=station.description.name,
        operator=options.get("operator") or operator_name(),
        software_version=__version__,
        bench_seconds=station.clock.now() - began_s,
    )


def _all_parts(
    specimen: Specimen, name: str
) -> tuple[tuple[ReducerTestOutcome, ...], tuple[ReducerTestFailure, ...]]:
    """Run all parts; if one part of several fails, continue with the others."""
    tests, station = chosen_tests(name), specimen.station
    outcomes: list[ReducerTestOutcome] = []
    failures: list[ReducerTestFailure] = []
    limits = reducer_limits(specimen.reducer)
    parts: list[tuple[str, str, Callable[[], ReducerTestOutcome | None]]] = [
        (preparation.name, preparation.title, partial(specimen.prepare, preparation))
        for preparation in preparations(tests, limits, specimen.settings, rotating_sides(station))
    ]
    parts += [(test.name, test.title, partial(specimen.test, test)) for test in tests]
    for part, title, action in parts:
        alarm = station.supervisor.alarm
        if alarm is not None:
            why = Message("not started: an alarm is latched ({found})", alarm.found)
            failures.append(ReducerTestFailure(part, title, why, "acknowledge it and test again"))
            continue
        try:
            outcome = action()
        except RunAbortedError:
            raise
        except TorquebenchError as error:
            if len(tests) == 1:
                raise
            failures.append(ReducerTestFailure(part, title, Message.of(error)))
            continue
        if outcome is not None:
            outcomes.append(outcome)
    return tuple(outcomes), tuple(failures)
