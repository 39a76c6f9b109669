"""Test a mounted reducer, and check the bench with a standard reducer."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as data_field
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from torquebench import campaign, chain, procedures, records, reducers
from torquebench.bench.roles import SIDES, Side
from torquebench.campaign.reducers.catalogue import TESTS, TestName
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import (
    WHOLE,
    Flag,
    MountedRequest,
    Name,
    Number,
    Operation,
    Request,
    RunId,
    Tolerance,
    field,
)
from torquebench.operations.place import Place
from torquebench.operations.preview import Preview, TestPart, limits_of
from torquebench.operations.records import find_run
from torquebench.operations.result import HIDDEN, Numbers, Result
from torquebench.progress import Progress
from torquebench.reports.page import Page
from torquebench.units import ARCMIN
from torquebench.validation import ConflictError

LOOP_ROWS = 400
"""Largest number of points of a torque-angle loop in a result."""


class CompensatedRequest(MountedRequest):
    """Base of requests whose readings are compensated by the models in use."""

    accept_counter: Annotated[
        str | None,
        field(
            "Also use models that were made with this counter (serial/clock), with more "
            "uncertainty.",
            max_length=200,
        ),
    ] = None
    clock_tolerance_ppm: Annotated[
        Number,
        field(
            "Largest difference of the two counters' clocks, ppm.",
            ge=0.001,
            le=1000,
        ),
    ] = 100.0

    def accepted(self) -> chain.Timebase | None:
        """Return the other counter whose models are accepted, None if none is named."""
        if not self.accept_counter:
            return None
        return chain.Timebase("accepted by its name", self.accept_counter, self.clock_tolerance_ppm)


Count = Annotated[int, Field(ge=1, le=100), WHOLE]


class ReducerTestRequest(CompensatedRequest):
    """Test a mounted reducer, with uncertainties and a verdict against its data sheet.

    TESTS

    Torques are compensated by the models in use; without one, the result says so. Every part is a
    separate run. The exit code of the command is 1 if a limit of the data sheet is exceeded, data
    forbid a verdict or a part failed.
    """

    basic = ("test", "reducer", "serial", "short")

    test: Annotated[
        TestName,
        field(
            "Which test.",
            argument=True,
            titles={name: test.title for name, test in TESTS.items()},
        ),
    ]
    reducer: Annotated[
        Name | None,
        field(
            "The mounted reducer: by default that of the simulated bench.",
            choices="reducers",
            examples=("standard", "rv-40e"),
        ),
    ] = None
    serial: Annotated[str, field("Serial number of the specimen.", max_length=64)] = ""
    short: Annotated[Flag, field("Short test: few points, no warming up, no verdict.")] = False
    repeats: Annotated[
        Annotated[int, Field(ge=1, le=1000), WHOLE] | None,
        field(
            "Largest number of repeats of no-load torque and efficiency, and of the empty run; by "
            "default 12 and 8. Repeating ends when the means are known well enough.",
        ),
    ] = None
    loops: Annotated[
        Count | None,
        field(
            "Torque-angle loops at each output position; by default 3, of a short test 2.",
        ),
    ] = None
    positions: Annotated[
        Count | None,
        field(
            "Output positions of the loops, over one turn; by default 5, of a short test 1.",
        ),
    ] = None
    subtract_twist: Annotated[Flag, field("Subtract the bench's own twist from the loops.")] = True
    twist_arcmin_per_nm: Annotated[
        Number | None,
        field(
            "The bench's own twist, arcmin/(N·m); then it isn't measured.",
            title="Known twist",
            ge=0,
        ),
    ] = None
    tare: Annotated[
        Flag | None,
        field(
            "Measure an empty run (nothing mounted) before no-load torque and efficiency, and "
            "subtract it. By default only if the measuring chains don't correct rotation; not in a "
            "short test.",
        ),
    ] = None

    @model_validator(mode="after")
    def _contradictions(self) -> Self:
        """Raise an error for contradictory options."""
        if self.short and self.repeats is not None:
            found = Message("{count} in a short test", self.repeats)
            raise ConflictError("repeats", found, "one of both: a short test has no repeats")
        if self.twist_arcmin_per_nm is not None and not self.subtract_twist:
            found = Message("{twist:g}, not to be subtracted", self.twist_arcmin_per_nm)
            raise ConflictError("twist_arcmin_per_nm", found, "a twist that is subtracted")
        return self


ReducerTestRequest.__doc__ = (ReducerTestRequest.__doc__ or "").replace(
    "    TESTS\n", "".join(f"    - {name}: {test.about}\n" for name, test in TESTS.items())
)


class StandardReducerRequest(CompensatedRequest):
    """Measure a standard reducer's certified friction: error and repeatability with a verdict.

    The input is driven in steps of speed up to 1200 rpm, output free. The input module is
    compensated by its model in use; without one, the result says so.
    """

    basic = ("reducer", "tolerance_percent_fs", "repeats", "both_directions")

    reducer: Annotated[
        Name | None,
        field(
            "A reducer with certified friction: by default that of the simulated bench.",
            choices="reducers:certified",
        ),
    ] = None
    tolerance_percent_fs: Tolerance = 0.1
    repeats: Annotated[int, field("Number of sweeps.", ge=2, le=100), WHOLE] = 3
    both_directions: Annotated[Flag, field("Counter-clockwise as well.")] = False


# -- results --------------------------------------------------------------------------------


@dataclass(frozen=True)
class LoopKeyPoint:
    """A point of a torque-angle loop on which its evaluation is based."""

    label: str
    torque_nm: float
    angle_arcmin: float


@dataclass(frozen=True)
class TorqueAngleLoop:
    """The first loop: output angle about its middle as a function of torque, on both branches."""

    torque_nm: Numbers
    rising_arcmin: Numbers
    falling_arcmin: Numbers
    points: Sequence[LoopKeyPoint]


@dataclass(frozen=True)
class TestedPart:
    """Result of one part of a test."""

    name: str
    title: str
    verdict: str
    run_id: str
    quantities: Sequence[campaign.ReducerTestQuantity]
    findings: Sequence[reducers.Finding]
    remarks: Sequence[str]
    loop: TorqueAngleLoop | None


@dataclass(frozen=True)
class FailedPart:
    """A part of a full test that has no result."""

    name: str
    title: str
    message: str
    remedy: str


@dataclass(frozen=True, kw_only=True)
class ReducerTestResult(Result):
    """Tests of a mounted reducer against its data sheet."""

    test: str
    short: bool
    reducer: str
    serial: str
    compensation: Mapping[str, str]
    not_in_u: Mapping[str, Sequence[str]]
    parts: Sequence[TestedPart]
    failures: Sequence[FailedPart]
    record: Any = data_field(metadata=HIDDEN)
    """The `ReducerTestRecord` with all measured data, for the report."""

    @property
    def failed(self) -> bool:
        """Whether a limit is exceeded, a finding forbids a verdict, or a part has no result."""
        return bool(self.record.failed)

    def page(self) -> Page:
        """Return its description."""
        from torquebench.reports.reducers.report import reducer_page

        return reducer_page(self.record)


@dataclass(frozen=True, kw_only=True)
class StandardReducerResult(Result):
    """A standard reducer's certified friction against measured friction."""

    reducer: str
    certificate: str
    compensation: str
    not_in_u: Sequence[str]
    check: reducers.FrictionCheck

    def page(self) -> Page:
        """Return its description."""
        from torquebench.reports.reducers.standard import standard_reducer_page

        return standard_reducer_page(
            self.check,
            name=self.reducer,
            certificate=self.certificate,
            compensation=self.compensation,
            run_id=self.run_ids[0],
            simulated=self.simulated,
        )


# -- tests ----------------------------------------------------------------------------------


def _settings(request: ReducerTestRequest) -> campaign.ReducerTestSettings:

    settings = (
        campaign.ReducerTestSettings.short() if request.short else campaign.ReducerTestSettings()
    )
    if request.repeats is not None:
        settings = settings.with_repeats(request.repeats)
    if request.tare is not None:
        changed = {"tare_always": True} if request.tare else {"empty_run": None}
        settings = replace(settings, **changed)
    if request.twist_arcmin_per_nm is not None:
        settings = replace(settings, twist_arcmin_per_nm=request.twist_arcmin_per_nm)
    if not request.subtract_twist:
        settings = replace(settings, bench_twist=None)
    return settings.with_loops(request.loops, request.positions)


def _mounted(place: Place, name: str | None) -> reducers.ReducerDescription:
    """Return the type of the mounted reducer.

    Raises
    ------
    InputError
        No reducer is named on a real bench, or its ratio differs from the bench description's.
    """
    description = place.station.description
    if name is None:
        if not description.simulated:
            raise InputError(
                Message("no reducer for {name}", description.name),
                "a reducer's description",
                "name the mounted reducer",
            )
        name = str(description.driver.get("reducer", "standard"))
    reducer = place.library.reducer(name)
    expected = description.bench.reducer_ratio
    if not description.simulated and abs(reducer.ratio / expected - 1.0) > 1e-6:
        raise InputError(
            Message("{name}: a ratio of {ratio:g}", name, reducer.ratio),
            Message(
                "{expected:g}, the ratio of what is mounted on {name}", expected, description.name
            ),
            "correct the reducer's description, or reducer_ratio of the bench",
        )
    return reducer


def _check_encoders(place: Place) -> None:
    """Refuse a test on a bench without both encoders: every test of a reducer turns it."""
    for side in SIDES:
        place.station.description.needed_encoder(side)


def check_test(place: Place, request: ReducerTestRequest) -> Iterable[str]:
    """Raise an error for impossible tests."""
    _settings(request)
    _check_encoders(place)
    _mounted(place, request.reducer)
    return ()


def preview_test(place: Place, request: ReducerTestRequest) -> Preview:
    """Rehearse every part of the test."""
    reducer = _mounted(place, request.reducer)
    parts = campaign.rehearse_reducer_test(place.station, request.test, reducer, _settings(request))
    allowed = Message(
        "Allowed at the reducer: {torque:g} N·m, {speed:g} rpm.",
        reducer.acceleration_torque_nm,
        reducer.max_input_speed_rpm,
    )
    torque_nm, speed_rpm = limits_of(place.station.description)
    return Preview(
        title=test_title(request),
        duration_s=sum(part.duration_s for part in parts),
        points=sum(part.points for part in parts),
        largest_torque_nm=_largest(parts, "largest_torque_nm"),
        limit_torque_nm=torque_nm,
        largest_speed_rpm=_largest(parts, "largest_speed_rpm"),
        limit_speed_rpm=speed_rpm,
        mounts=("reducer",),
        parts=tuple(
            TestPart(
                part.title,
                part.duration_s,
                part.longest_s,
                part.longest_warm_up_s,
                part.points,
                part.largest_torque_nm,
                part.largest_speed_rpm,
            )
            for part in parts
        ),
        remarks=(allowed,),
    )


def _largest(parts: Sequence[campaign.ReducerTestRehearsal], name: str) -> dict[str, float]:
    return {side: max(getattr(part, name).get(side, 0.0) for part in parts) for side in SIDES}


def run_test(place: Place, request: ReducerTestRequest, progress: Progress) -> ReducerTestResult:
    """Measure, evaluate and register the tests."""
    station, reducer = place.station, _mounted(place, request.reducer)
    compensation, missing = _compensation(place, request, SIDES)
    if station.drivers.hold is not None:
        station.drivers.hold(reducer, request.serial)
    record = campaign.run_reducer_test(
        station,
        request.test,
        reducer,
        _settings(request),
        serial=request.serial,
        **place.run_options(progress, request.mounting),
    )
    result = ReducerTestResult(
        headline=_headline(record),
        verdict=record.verdict.value,
        simulated=record.simulated,
        run_ids=tuple(outcome.run.run_id for outcome in record.outcomes),
        test=record.name,
        short=record.short,
        reducer=record.reducer_name,
        serial=record.serial,
        compensation=compensation,
        not_in_u=missing,
        parts=[_part(outcome) for outcome in record.outcomes],
        failures=[
            FailedPart(each.name, each.title, each.message, each.remedy) for each in record.failures
        ],
        record=record,
    )
    _write_report(place.registry, result, progress)
    return result


def report_path(registry: records.Registry, run_id: str) -> Path:
    """Return the path of a run's report in the data directory."""
    return registry.root / "reports" / f"{run_id}.pdf"


def _write_report(
    registry: records.Registry, result: ReducerTestResult, progress: Progress
) -> None:
    """Write the report as PDF into the data directory."""
    if not result.run_ids:
        return
    from torquebench.atomic_write import atomic_write, private_folder
    from torquebench.reports.page_pdf import page_pdf

    progress.start("Writing the report", 1)
    path = report_path(registry, result.run_ids[0])
    with contextlib.suppress(InputError, OSError):  # results stay valid without it
        content = page_pdf(result.page())
        private_folder(path.parent)
        atomic_write(path, content, private=True)
    progress.finish()


def _compensation(
    place: Place, request: CompensatedRequest, sides: Sequence[Side]
) -> tuple[dict[str, str], dict[str, list[str]]]:
    """Activate the sides' compensations; return their names, and the influences missing in U."""
    from torquebench.errors import ModelMismatchError

    station, accepted = place.station, request.accepted()
    words: dict[str, str] = {}
    missing: dict[str, list[str]] = {}
    for side in sides:
        active = None if accepted else station.acquisition.compensation(side)
        try:
            active = active or station.activate_compensation(side, accepted)
        except ModelMismatchError as error:
            words[side] = Message("not compensated, {found}", error.found)
            missing[side] = []
            continue
        words[side] = Message("compensated by model-{number}", active.model_id)
        if active.accepted is not None:
            words[side] = Message(
                "{compensated}, made with {counter}: {tolerance:g} ppm added",
                words[side],
                active.accepted.identity,
                active.accepted.tolerance_ppm,
            )
        missing[side] = list(active.chain.missing())
    return words, missing


def _headline(record: campaign.ReducerTestRecord) -> str:

    quantities = [quantity for outcome in record.outcomes for quantity in outcome.quantities]
    judged = [quantity for quantity in quantities if quantity.verdict]
    kept = sum(not quantity.verdict.failed for quantity in judged)
    return Message(
        "{reducer_name}: {count} quantities found{limits}{short}.",
        record.reducer_name,
        len(quantities),
        Message("; {kept} of {count} limits of the data sheet met", kept, len(judged))
        if judged
        else "",
        Message(" ({short})", campaign.SHORT_TEST) if record.short else "",
    )


def _part(outcome: campaign.ReducerTestOutcome) -> TestedPart:

    result = outcome.result
    return TestedPart(
        name=outcome.name,
        title=outcome.title,
        verdict=outcome.verdict.value,
        run_id=outcome.run.run_id,
        quantities=outcome.quantities,
        findings=outcome.findings,
        remarks=outcome.remarks,
        loop=_loop(result) if isinstance(result, reducers.HysteresisResult) else None,
    )


def _loop(result: reducers.HysteresisResult) -> TorqueAngleLoop:
    """Return the first torque-angle loop, in arc minutes about its middle."""
    import numpy as np

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


def test_title(request: ReducerTestRequest) -> str:
    """Return the title of a request."""
    title = TESTS[request.test].title
    return title if request.reducer is None else Message("{test} of {name}", title, request.reducer)


# -- standard reducer -----------------------------------------------------------------------


def _standard(place: Place, request: StandardReducerRequest) -> campaign.StandardReducer:

    named, station = request.reducer, place.station
    kind = None if named is None else place.library.reducer(named)
    return campaign.certified_reducer(
        kind, station.description, station.drivers.reducer_certificate
    )


def check_standard(place: Place, request: StandardReducerRequest) -> Iterable[str]:
    """Raise an error if the reducer has no certificate, or a module no encoder."""
    _check_encoders(place)
    _standard(place, request)
    return ()


def preview_standard(place: Place, request: StandardReducerRequest) -> Preview:
    """Rehearse the sweep."""
    station = place.station
    mounted = _standard(place, request)
    settings = mounted.settings(request.repeats, both_directions=request.both_directions)
    rehearsal = procedures.rehearse(
        station.devices, procedures.friction_sweep(station.devices, settings)
    )
    torque_nm, speed_rpm = limits_of(station.description)
    return Preview(
        title=STANDARD_TITLE,
        duration_s=rehearsal.duration_s,
        points=rehearsal.points,
        largest_speed_rpm={"input": settings.speeds_rpm[-1]},
        limit_torque_nm=torque_nm,
        limit_speed_rpm=speed_rpm,
        mounts=("reducer",),
    )


def run_standard(
    place: Place, request: StandardReducerRequest, progress: Progress
) -> StandardReducerResult:
    """Measure the friction and compare it with the certificate."""
    station, mounted = place.station, _standard(place, request)
    words, missing = _compensation(place, request, ("input",))
    if station.drivers.hold is not None:
        named = request.reducer
        station.drivers.hold(None if named is None else place.library.reducer(named), "")
    friction = campaign.check_standard_reducer(
        station,
        mounted,
        mounted.settings(request.repeats, both_directions=request.both_directions),
        tolerance_percent=request.tolerance_percent_fs,
        **place.run_options(progress, request.mounting),
    )
    check = friction.check
    assert check is not None
    return StandardReducerResult(
        headline=campaign.FRICTION.describe(friction),
        verdict="pass" if check.kept else "fail",
        simulated=station.description.simulated,
        run_ids=(friction.run_id,),
        reducer=mounted.name,
        certificate=mounted.certificate,
        compensation=words["input"],
        not_in_u=missing["input"],
        check=check,
    )


# -- compare --------------------------------------------------------------------------------


class CompareTestsRequest(Request):
    """Compare tests of several specimens of one type, or of one specimen before and after.

    Errors common to two runs on one bench with the same models cancel in a change.
    """

    runs: Annotated[
        tuple[RunId, ...],
        field(
            "Runs of one test: ids or their beginnings, or `latest`.",
            argument=True,
            min_length=1,
            max_length=100,
        ),
    ]
    change: Annotated[Flag, field("Two runs of one specimen: before and after.")] = False


@dataclass(frozen=True)
class ComparedQuantity:
    """One quantity of several specimens: the change of one, or the mean of many."""

    key: str
    title: str
    unit: str
    value: float
    expanded_uncertainty: float
    specimens: Sequence[float]
    significant: bool | None
    spread: float | None
    outliers: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class ComparedTests(Result):
    """Comparison of specimens of one type, or of one specimen before and after."""

    reducer: str
    test: str
    serials: Sequence[str]
    quantities: Sequence[ComparedQuantity]
    comparison: Any = data_field(metadata=HIDDEN)
    """The `ReducerComparison`, for the report."""

    def page(self) -> Page:
        """Return its description."""
        from torquebench.reports.reducers.comparison import comparison_page

        return comparison_page(self.comparison)


def run_comparison(
    place: Place, request: CompareTestsRequest, _progress: Progress
) -> ComparedTests:
    """Read the runs and compare their quantities."""
    from torquebench.campaign.reducers.comparison import compared, tested_specimen

    runs = [find_run(place.registry, name) for name in request.runs]
    found = compared([tested_specimen(run) for run in runs], change=request.change)
    first = found.specimens[0]
    estimates: dict[str, tuple[Any, bool | None, float | None, Sequence[str]]] = {
        key: (each.change, each.significant, None, ()) for key, each in found.changes.items()
    } or {key: (each.mean, None, each.spread, each.outliers) for key, each in found.values.items()}
    return ComparedTests(
        headline=Message(
            "{count} tests of {reducer} compared in {quantities} quantities{left_out}.",
            len(found.specimens),
            first.reducer,
            len(estimates),
            Message("; {count} values aren't in every run", found.left_out)
            if found.left_out
            else "",
        ),
        simulated=found.simulated,
        run_ids=tuple(each.run_id for each in found.specimens),
        reducer=first.reducer,
        test=first.test,
        serials=[each.serial for each in found.specimens],
        quantities=[
            ComparedQuantity(
                key=key,
                title=found.title(key),
                unit=estimate.unit,
                value=estimate.value,
                expanded_uncertainty=estimate.expanded_uncertainty(),
                specimens=[each.quantities[key].estimate.value for each in found.specimens],
                significant=significant,
                spread=spread,
                outliers=outliers,
            )
            for key, (estimate, significant, spread, outliers) in estimates.items()
        ],
        comparison=found,
    )


STANDARD_TITLE = "Check the bench with a standard reducer"
TEST = Operation(
    "test",
    ReducerTestRequest,
    run_test,
    test_title,
    preview_test,
    check_test,
    where="bench",
    moves=True,
    loads=True,
    can_pause=True,
    activates=True,
)
STANDARD_REDUCER = Operation(
    "standard-reducer",
    StandardReducerRequest,
    run_standard,
    lambda _request: STANDARD_TITLE,
    preview_standard,
    check_standard,
    where="bench",
    moves=True,
    loads=True,
    can_pause=True,
)
COMPARE_TESTS = Operation(
    "records compare-tests",
    CompareTestsRequest,
    run_comparison,
    lambda request: Message("Compare {count} tests", len(request.runs)),
    quick=True,
)
