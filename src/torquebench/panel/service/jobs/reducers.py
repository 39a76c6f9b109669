"""Tests of a mounted reducer as jobs.

Details of the result, as JSON: `name`, `short`, `reducer_name`, `serial` and `outcomes`; each
outcome has `name`, `title`, `verdict`, `remarks`, `run_id` and `quantities` (`key`, `title`,
`value`, `expanded_uncertainty`, `unit`, `limit`, `verdict`, `rule`, `truth`).
"""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any

from pydantic import Field

from torquebench.campaign.reducers.catalogue import TestName
from torquebench.campaign.reducers.results import (
    SHORT_TEST,
    ReducerTestOutcome,
    ReducerTestRehearsal,
)
from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.campaign.reducers.tests import TESTS, rehearse_reducer_test, run_reducer_test
from torquebench.panel.service.fields import WHOLE, Flag, ProfileName
from torquebench.panel.service.jobs.previews import confirm_clear, limits
from torquebench.panel.service.jobs.results import as_details
from torquebench.panel.service.jobs.runner import JobContext, JobKind, JobRequest, Workplace
from torquebench.panel.service.jobs.values import JobPreview, JobResult

__all__ = ["REDUCER_KINDS", "ReducerTestRequest"]


class ReducerTestRequest(JobRequest):
    """Put the mounted reducer to a test, or with "full" to all of them.

    `quick` takes fewer points: a look, no verdict for a data sheet. `repeats` is how often running
    tests repeat at most, and how often the empty run does.
    """

    test: TestName
    reducer: ProfileName
    serial: Annotated[str, Field(max_length=64)] = ""
    quick: Flag = False
    repeats: Annotated[int, Field(ge=1, le=1000), WHOLE] | None = None
    bench_clear: Flag = False


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
    torque_limit, speed_limit = limits(place.station.description)
    warm_up_s = max(part.longest_warm_up_s for part in parts)
    remarks = [f"{part.title}: {part.points} points in {part.duration_s:.0f} s" for part in parts]
    repeats_s = sum(part.longest_s - part.duration_s for part in parts)
    if repeats_s > 0.0:
        remarks.append(f"Repeats until means are known may take {repeats_s / 60:.0f} min more.")
    if warm_up_s > 0.0:
        remarks.append(f"Warming up may take {warm_up_s / 60:.0f} min more.")
    return JobPreview(
        kind="reducer-test",
        title=_title(request),
        duration_s=sum(part.duration_s for part in parts),
        points=sum(part.points for part in parts),
        largest_torque_nm=_largest(parts, "largest_torque_nm"),
        limit_torque_nm=torque_limit,
        largest_speed_rpm=_largest(parts, "largest_speed_rpm"),
        limit_speed_rpm=speed_limit,
        remarks=tuple(remarks),
    )


def _largest(parts: tuple[ReducerTestRehearsal, ...], name: str) -> dict[str, float]:
    sides = {side for part in parts for side in getattr(part, name)}
    return {side: max(getattr(part, name).get(side, 0.0) for part in parts) for side in sides}


def run_test(context: JobContext, request: ReducerTestRequest) -> JobResult:
    """Test, evaluate, judge and record."""
    confirm_clear(context.station.description, request.bench_clear)
    record = run_reducer_test(
        context.station,
        request.test,
        context.settings.reducer(request.reducer),
        _settings(request),
        serial=request.serial,
        progress=context.job,
    )
    found = [quantity for outcome in record.outcomes for quantity in outcome.quantities]
    judged = [each for each in found if each.verdict]
    kept = sum(not each.verdict.failed for each in judged)
    short = f" ({SHORT_TEST})" if record.short else ""
    said = f"; {kept} of {len(judged)} limits of the data sheet kept" if judged else ""
    return JobResult(
        headline=f"{record.reducer_name}: {len(found)} quantities found{said}{short}.",
        verdict=record.verdict,
        simulated=record.simulated,
        run_ids=tuple(outcome.run.run_id for outcome in record.outcomes),
        details=as_details(
            {
                "name": record.name,
                "short": record.short,
                "reducer_name": record.reducer_name,
                "serial": record.serial,
                "outcomes": [_outcome(outcome) for outcome in record.outcomes],
            }
        ),
    )


def _outcome(outcome: ReducerTestOutcome) -> dict[str, Any]:
    """Return what is shown of an outcome: no arrays, no folder."""
    return {
        "name": outcome.name,
        "title": outcome.title,
        "verdict": outcome.verdict,
        "remarks": (*outcome.remarks, *map(str, outcome.findings)),
        "run_id": outcome.run.run_id,
        "quantities": [
            {each.name: getattr(quantity, each.name) for each in fields(quantity)}
            for quantity in outcome.quantities
        ],
    }


def _title(request: ReducerTestRequest) -> str:
    return f"{TESTS[request.test].title} of {request.reducer}"


REDUCER_KINDS: tuple[JobKind, ...] = (
    JobKind("reducer-test", _title, ReducerTestRequest, run_test, preview_test),
)
