"""Tests of a mounted reducer, and of the bench by a standard reducer, as jobs.

`jobs.details` has the types of their details.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from torquebench.atomic_write import atomic_write, private_folder
from torquebench.campaign.reducers.catalogue import TestName
from torquebench.campaign.reducers.results import (
    SHORT_TEST,
    ReducerTestOutcome,
    ReducerTestRecord,
    ReducerTestRehearsal,
)
from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.campaign.reducers.tests import TESTS, rehearse_reducer_test, run_reducer_test
from torquebench.campaign.standard_reducer import (
    StandardReducer,
    check_standard_reducer,
    standard_reducer,
)
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.panel.service.fields import WHOLE, Flag, Number, ProfileName
from torquebench.panel.service.jobs.details import (
    LoopKeyPoint,
    ReducerOutcome,
    ReducerTestDetails,
    StandardReducerDetails,
    TorqueAngleLoop,
)
from torquebench.panel.service.jobs.runner import JobContext, JobKind, MountedRequest, Workplace
from torquebench.panel.service.jobs.values import JobPreview, JobResult
from torquebench.panel.service.records.queries import report_path
from torquebench.procedures import friction_sweep, rehearse
from torquebench.reducers import HysteresisResult
from torquebench.reports.page_pdf import page_pdf
from torquebench.reports.reducers.report import reducer_page
from torquebench.units import ARCMIN, MINUTE

__all__ = ["REDUCER_KINDS", "ReducerTestRequest", "StandardReducerRequest"]


LOOP_ROWS = 400
"""Most points of a loop on a page."""


class ReducerTestRequest(MountedRequest):
    """Put the mounted reducer to a test, or with "full" to all of them.

    `quick` takes fewer points: an overview without verdicts. `repeats` is how often running tests
    repeat at most, and how often the empty run does.
    """

    test: TestName
    reducer: ProfileName
    serial: Annotated[str, Field(max_length=64)] = ""
    quick: Flag = False
    repeats: Annotated[int, Field(ge=1, le=1000), WHOLE] | None = None
    bench_clear: Flag = False


class StandardReducerRequest(MountedRequest):
    """Check the bench from end to end: a standard reducer's certified friction against measured.

    Input driven in steps of speed, output free. `reducer` names a description with certified
    friction; without it, the simulated bench's own. The largest error and the largest difference
    between repeats are evaluated by `tolerance_percent_fs`.
    """

    reducer: ProfileName | None = None
    tolerance_percent_fs: Annotated[Number, Field(gt=0, le=100.0)] = 0.1
    repeats: Annotated[int, Field(ge=2, le=100), WHOLE] = 3
    both_directions: Flag = False
    bench_clear: Flag = False


def _standard(place: Workplace, request: StandardReducerRequest) -> StandardReducer:
    named, station = request.reducer, place.station
    kind = None if named is None else place.settings.reducer(named)
    return standard_reducer(kind, station.description, station.drivers.reducer_certificate)


def preview_standard(place: Workplace, request: StandardReducerRequest) -> JobPreview:
    """Rehearse the sweep."""
    station = place.station
    settings = _standard(place, request).settings(
        request.repeats, both_directions=request.both_directions
    )
    rehearsal = rehearse(station.devices, friction_sweep(station.devices, settings))
    return JobPreview(
        kind="standard-reducer",
        title=STANDARD_TITLE,
        duration_s=rehearsal.duration_s,
        points=rehearsal.points,
        largest_speed_rpm={"input": settings.speeds_rpm[-1]},
        mounts=("reducer",),
    )


def run_standard(context: JobContext, request: StandardReducerRequest) -> JobResult:
    """Measure the friction and judge it."""
    station = context.station
    mounted = _standard(context, request)
    if station.drivers.hold is not None:
        named = request.reducer
        station.drivers.hold(None if named is None else context.settings.reducer(named), "")
    active = station.devices.context.acquisition.compensation("input")
    record = check_standard_reducer(
        station,
        mounted,
        mounted.settings(request.repeats, both_directions=request.both_directions),
        tolerance_percent=request.tolerance_percent_fs,
        compensation="not compensated"
        if active is None
        else Message("compensated by model-{model_id}", active.model_id),
        progress=context.job,
    )
    check = record.check
    return JobResult(
        headline=Message(
            "Standard reducer: error {error:.3g} % FS, repeatability {spread:.3g} % "
            "FS, tolerance {limit:g} % FS.",
            check.error_percent,
            check.repeatability_percent,
            check.tolerance_percent,
        ),
        verdict="pass" if check.kept else "fail",
        simulated=record.simulated,
        run_ids=(record.run_id,),
        details=StandardReducerDetails(
            reducer=record.reducer.name,
            certificate=record.reducer.certificate,
            compensation=record.compensation,
            tolerance_percent_fs=check.tolerance_percent,
            error_percent_fs=check.error_percent,
            repeatability_percent_fs=check.repeatability_percent,
            points=check.points,
        ),
    )


def _settings(request: ReducerTestRequest) -> ReducerTestSettings:
    if request.quick:
        return ReducerTestSettings.short()
    settings = ReducerTestSettings()
    return settings if request.repeats is None else settings.with_repeats(request.repeats)


def preview_test(place: Workplace, request: ReducerTestRequest) -> JobPreview:
    """Rehearse every part of the test."""
    parts = rehearse_reducer_test(
        place.station, request.test, place.settings.reducer(request.reducer), _settings(request)
    )
    warm_up_s = max(part.longest_warm_up_s for part in parts)
    remarks = [
        Message(
            "{title}: {points} points in {seconds:.0f} s", part.title, part.points, part.duration_s
        )
        for part in parts
    ]
    repeats_s = sum(part.longest_s - part.duration_s for part in parts)
    if repeats_s > 0.0:
        remarks.append(
            Message(
                "Repeats until means are known may take {minutes:.0f} min more.", repeats_s / MINUTE
            )
        )
    if warm_up_s > 0.0:
        remarks.append(Message("Warming up may take {minutes:.0f} min more.", warm_up_s / MINUTE))
    return JobPreview(
        kind="reducer-test",
        title=_title(request),
        duration_s=sum(part.duration_s for part in parts),
        points=sum(part.points for part in parts),
        largest_torque_nm=_largest(parts, "largest_torque_nm"),
        largest_speed_rpm=_largest(parts, "largest_speed_rpm"),
        remarks=tuple(remarks),
    )


def _largest(parts: tuple[ReducerTestRehearsal, ...], name: str) -> dict[str, float]:
    sides = {side for part in parts for side in getattr(part, name)}
    return {side: max(getattr(part, name).get(side, 0.0) for part in parts) for side in sides}


def run_test(context: JobContext, request: ReducerTestRequest) -> JobResult:
    """Test, evaluate, judge and record."""
    station, reducer = context.station, context.settings.reducer(request.reducer)
    if station.drivers.hold is not None:
        station.drivers.hold(reducer, request.serial)
    record = run_reducer_test(
        station,
        request.test,
        reducer,
        _settings(request),
        serial=request.serial,
        progress=context.job,
    )
    quantities = [quantity for outcome in record.outcomes for quantity in outcome.quantities]
    judged = [quantity for quantity in quantities if quantity.verdict]
    kept = sum(not quantity.verdict.failed for quantity in judged)
    short = f" ({SHORT_TEST})" if record.short else ""
    said = (
        Message("; {kept} of {count} limits of the data sheet kept", kept, len(judged))
        if judged
        else ""
    )
    return JobResult(
        headline=Message(
            "{reducer_name}: {count} quantities found{said}{short}.",
            record.reducer_name,
            len(quantities),
            said,
            short,
        ),
        verdict=record.verdict,
        simulated=record.simulated,
        run_ids=tuple(outcome.run.run_id for outcome in record.outcomes),
        details=ReducerTestDetails(
            name=record.name,
            short=record.short,
            reducer_name=record.reducer_name,
            serial=record.serial,
            report=_report(context, record),
            outcomes=[_outcome(outcome) for outcome in record.outcomes],
        ),
    )


def _report(context: JobContext, record: ReducerTestRecord) -> str:
    """Store the report as PDF beside the records; return its run."""
    if not record.outcomes:
        return ""
    context.job.start("Writing the report", 1)
    run_id = record.outcomes[0].run.run_id
    path = report_path(context.station.registry, run_id)
    try:
        content = page_pdf(reducer_page(record))
        private_folder(path.parent)
        atomic_write(path, content, private=True)
    except (InputError, OSError):  # missing font or full disk: results stay valid
        return ""
    return run_id


def _loop(result: HysteresisResult) -> TorqueAngleLoop:
    """Return the first torque-angle loop, in arc minutes about its middle."""
    curve = result.loops[0].curve
    rows = slice(None, None, max(1, curve.torque_nm.size // LOOP_ROWS))
    middle = 0.5 * sum(
        float(np.interp(0.0, curve.torque_nm, branch))
        for branch in (curve.rising_rad, curve.falling_rad)
    )
    return TorqueAngleLoop(
        torque_nm=curve.torque_nm[rows],
        rising_arcmin=(curve.rising_rad[rows] - middle) / ARCMIN,
        falling_arcmin=(curve.falling_rad[rows] - middle) / ARCMIN,
        points=[
            LoopKeyPoint(point.label, point.torque_nm, (point.angle_rad - middle) / ARCMIN)
            for point in result.key_points
        ],
    )


def _outcome(outcome: ReducerTestOutcome) -> ReducerOutcome:
    return ReducerOutcome(
        name=outcome.name,
        title=outcome.title,
        verdict=outcome.verdict,
        remarks=(*outcome.remarks, *map(str, outcome.findings)),
        run_id=outcome.run.run_id,
        quantities=outcome.quantities,
        loop=_loop(outcome.result) if isinstance(outcome.result, HysteresisResult) else None,
    )


def _title(request: ReducerTestRequest) -> str:
    return Message("{test} of {reducer}", TESTS[request.test].title, request.reducer)


STANDARD_TITLE = "Check the bench with a standard reducer"
REDUCER_KINDS: tuple[JobKind, ...] = (
    JobKind(
        "standard-reducer",
        lambda _asked: STANDARD_TITLE,
        StandardReducerRequest,
        run_standard,
        preview_standard,
        _standard,
    ),
    JobKind(
        "reducer-test",
        _title,
        ReducerTestRequest,
        run_test,
        preview_test,
        lambda place, asked: place.settings.reducer(asked.reducer),
    ),
)
