"""Jobs about compensation: calibrate, compare models, fit another one, verify.

`jobs.details` has the types of their details.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from torquebench.bench.interlocks import check_torque_limit
from torquebench.bench.roles import Side
from torquebench.calibration import (
    Profile,
    check_steps,
)
from torquebench.campaign.bench_chains import recorded_effects
from torquebench.campaign.doubts import CALIBRATOR, VERIFICATION_STANDARD, doubts_before
from torquebench.campaign.external_calibration import KIND as TABLE
from torquebench.campaign.finishing import (
    FinishedCalibration,
    finish_calibration,
)
from torquebench.campaign.fitting import (
    COMPARED_COLUMNS,
    ModelChoice,
    fit_metrics,
    fit_models,
    model_in_use,
    model_title,
    store_model,
)
from torquebench.campaign.measuring import (
    Measured,
    measure_calibration,
    rehearse_calibration,
)
from torquebench.campaign.registering import registers_calibration
from torquebench.campaign.resuming import read_interrupted, resume_calibration
from torquebench.campaign.verifying import verify_on_bench
from torquebench.compensation import RECOMMENDED
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.panel.comparing import compare_points
from torquebench.panel.run_in_process import run_in_process
from torquebench.panel.service.fields import (
    WHOLE,
    Flag,
    Identifier,
    ModelName,
    Number,
    ProfileName,
    RunId,
)
from torquebench.panel.service.jobs.details import ComparedModel, ComparisonDetails
from torquebench.panel.service.jobs.previews import staircase_preview
from torquebench.panel.service.jobs.results import (
    calibration_data,
    calibration_result,
    errors_of,
    fit_details,
    models_of,
    verification_result,
)
from torquebench.panel.service.jobs.runner import (
    JobContext,
    JobKind,
    JobRequest,
    MountedRequest,
    Workplace,
)
from torquebench.panel.service.jobs.values import JobPreview, JobResult
from torquebench.procedures import StaircaseResult, rehearse
from torquebench.procedures import verify as verify_plan
from torquebench.progress import SHARES
from torquebench.records import CalibrationEntry, RunFolder
from torquebench.reports.certificate import run_profile
from torquebench.station import Station

__all__ = [
    "CALIBRATION_KINDS",
    "CalibrateRequest",
    "CompareRequest",
    "FitRequest",
    "ResumeRequest",
    "VerifyRequest",
    "calibration_data",
]

MOST_EPOCHS = 1_000_000
"""Most epochs of one training: a minute of one core, for a hundred points."""
MOST_STEPS = 5000
"""Most points of one loading sequence: more would take a day and is a typing mistake."""

Percent = Annotated[Number, Field(ge=0.1, le=100.0)]


class NetworkParameters(JobRequest):
    """Parameters of the source papers' network; missing ones are the model's defaults.

    `target_error_nm` ends the training when the RMS of the residuals falls below it.
    """

    mapping: Literal["residual", "direct"] | None = None
    start: Literal["nguyen-widrow", "small-uniform"] | None = None
    hidden: Annotated[int, Field(ge=1, le=1000), WHOLE] | None = None
    epochs: Annotated[int, Field(ge=1, le=MOST_EPOCHS), WHOLE] | None = None
    learning_rate: Annotated[Number, Field(gt=0, le=1.0)] | None = None
    target_error_nm: Annotated[Number, Field(gt=0, le=1e6)] | None = None
    random_state: Annotated[int, Field(ge=0, le=2**32 - 1), WHOLE] | None = None

    @property
    def stated(self) -> dict[str, Any]:
        """Those that were given."""
        return self.model_dump(exclude_none=True)


NETWORK = "published-network"
NO_PARAMETERS = NetworkParameters()


class CalibrateRequest(MountedRequest):
    """Calibrate one module against the calibrator and fit models; none is activated.

    `bench_clear` must be true on a real bench: the caller confirms that it may be loaded.
    """

    side: Side
    profile: ProfileName = "rapid-in-situ"
    rising_only: Flag | None = None
    repeats: Annotated[int, Field(ge=1, le=50), WHOLE] | None = None
    step_percent: Percent | None = None
    up_to_nm: Annotated[Number, Field(gt=0, le=1e6)] | None = None
    models: tuple[ModelName, ...] = Field(default=(RECOMMENDED, "polynomial-2"), max_length=8)
    network: NetworkParameters = NO_PARAMETERS
    bench_clear: Flag = False


class ResumeRequest(MountedRequest):
    """Resume an interrupted calibration; what decides its result is that of its run.

    `models` fits other models instead; none of them is activated then.
    """

    run_id: RunId
    models: tuple[ModelName, ...] | None = Field(default=None, max_length=8)
    bench_clear: Flag = False


class CompareRequest(JobRequest):
    """Compare all kinds of model on a calibration by cross-validation."""

    calibration_id: Identifier


class FitRequest(JobRequest):
    """Fit one more model to a calibration and register it.

    `network` is for the model "published-network"; with `rising_only` the model is fitted to the
    rising points alone, as the source papers load.
    """

    calibration_id: Identifier
    model: ModelName
    network: NetworkParameters = NO_PARAMETERS
    rising_only: Flag = False


class VerifyRequest(MountedRequest):
    """Verify the models of a calibration at fresh points against the verification standard."""

    calibration_id: Identifier
    profile: ProfileName = "verification"
    groups: Annotated[int, Field(ge=1, le=50), WHOLE] | None = None
    points: Annotated[int, Field(ge=4, le=1000), WHOLE] | None = None
    seed: Annotated[int, Field(ge=0, le=2**32 - 1), WHOLE] | None = None
    tolerance_percent_fs: Annotated[Number, Field(gt=0, le=100.0)] = 0.1
    bench_clear: Flag = False


# -- calibrate ------------------------------------------------------------------------------


def _calibration_profile(place: Workplace, request: CalibrateRequest) -> Profile:
    range_nm = place.station.description.module(request.side).range_nm
    up_to = request.up_to_nm
    profile = place.settings.profile(request.profile).with_options(
        rising_only=request.rising_only,
        repeats=request.repeats,
        step_percent=request.step_percent,
        up_to_percent=None if up_to is None else 100.0 * up_to / range_nm,
    )
    check_steps(profile)
    _refuse_long(profile, range_nm, request.repeats or 1)
    return profile


def _refuse_long(profile: Profile, range_nm: float, repeats: int) -> None:
    steps = repeats * len(profile.loading.percents())
    if steps <= MOST_STEPS:  # laying out more would take too long
        steps = len(profile.staircase(range_nm, np.random.default_rng(0)))
    if steps > MOST_STEPS:
        raise InputError(
            Message("a staircase of {steps} steps", steps),
            Message("at most {limit}", MOST_STEPS),
            "wider steps or fewer repeats",
        )


def check_calibration(place: Workplace, request: CalibrateRequest) -> None:
    """Refuse requests that the bench or the software can't fulfil."""
    _choices(request.models, request.network)
    module = place.station.description.module(request.side)
    profile = _calibration_profile(place, request)
    for step in profile.staircase(module.range_nm, np.random.default_rng(0)):
        check_torque_limit(request.side, step.nominal_nm, module.limits.torque_nm)


def preview_calibration(place: Workplace, request: CalibrateRequest) -> JobPreview:
    """Rehearse the very plan that would run."""
    station = place.station
    profile = _calibration_profile(place, request)
    rehearsal = rehearse_calibration(station, request.side, profile)
    doubts = tuple(doubts_before(station, CALIBRATOR))
    title = _calibrate_title(request)
    return staircase_preview(request.side, "calibrate", title, rehearsal, doubts)


def run_calibration(context: JobContext, request: CalibrateRequest) -> JobResult:
    """Measure, fit and register; which model is used stays open."""
    station, job = context.station, context.job
    profile = _calibration_profile(context, request)
    choices = _choices(request.models, request.network)
    known = registers_calibration(choices, None)
    measured = measure_calibration(station, request.side, profile, metadata=known, progress=job)
    return _fitted(context, measured, profile, choices)


def run_resumption(context: JobContext, request: ResumeRequest) -> JobResult:
    """Resume an interrupted calibration at its interrupted series, then fit and register."""
    station = context.station
    interrupted = read_interrupted(station.registry, station.registry.run(request.run_id))
    choices, active = interrupted.choices
    if request.models is not None:
        choices, active = _choices(request.models), None
    known = registers_calibration(choices, active)
    measured = resume_calibration(station, interrupted, metadata=known, progress=context.job)
    return _fitted(context, measured, interrupted.profile, choices, active)


def check_resumption(place: Workplace, request: ResumeRequest) -> None:
    """Refuse a run that can't be resumed."""
    station = place.station
    _choices(request.models or ())
    read_interrupted(station.registry, station.registry.run(request.run_id))


def _choices(
    names: Sequence[str],
    network: NetworkParameters = NO_PARAMETERS,
    *,
    rising_only: bool = False,
) -> list[ModelChoice]:
    if network.stated and NETWORK not in names:
        raise InputError(
            Message(
                "parameters of the network ({names}) for another model", ", ".join(network.stated)
            ),
            Message("the model {name}", NETWORK),
            "choose that model, or leave them out",
        )
    choices = [
        ModelChoice(name, network.stated if name == NETWORK else {}, rising_only)
        for name in dict.fromkeys(names)
    ]
    for choice in choices:
        choice.check()
    return choices


def _fitted(
    context: JobContext,
    measured: Measured[StaircaseResult],
    profile: Profile,
    choices: Sequence[ModelChoice],
    active: str | None = None,
) -> JobResult:
    """Fit models to the measured points and register all results."""
    context.check()
    done = finish_calibration(
        context.station.registry,
        measured,
        profile,
        choices,
        active,
        context.job,
        title="Fitting models",
    )
    return calibration_job_result(done)


def calibration_job_result(done: FinishedCalibration) -> JobResult:
    """Return the result of a calibration's job."""
    result, registered = done.measured.result, done.registered
    numbers = {name: entry.model_id for name, entry in registered.models.items()}
    return calibration_result(
        registered.calibration, result.data, done.fitted, numbers, result.unsettled
    )


# -- compare and fit ------------------------------------------------------------------------


def run_comparison(context: JobContext, request: CompareRequest) -> JobResult:
    """Compare in a separate process, so that the bench's threads aren't delayed."""
    entry, data = calibration_data(context.station, request.calibration_id)
    job = context.job
    job.start("Comparing models", SHARES)
    comparison = run_in_process(
        compare_points,
        data.features(COMPARED_COLUMNS),
        data.standard_nm,
        data.range_nm,
        progress=job,
        cancelled=job.cancelled.is_set,
    )
    good = np.delete(np.arange(len(data)), [point.row for point in comparison.outliers])
    title = model_title(comparison.best)
    sentence = Message("Least error at points left out: {model}.", title)
    return JobResult(
        headline=sentence,
        simulated=data.simulated,
        run_ids=(str(entry.run_id),),
        calibration_id=entry.calibration_id,
        details=ComparisonDetails(
            scores=[
                ComparedModel(**vars(score), title=model_title(score.name))
                for score in comparison.scores
            ],
            best=comparison.best,
            sentence=sentence,
            refused=comparison.refused,
            noise=data.subset(good).noise_floor(),
            steps=comparison.steps,
            folds=comparison.folds,
        ),
    )


def check_fit(place: Workplace, request: FitRequest) -> None:
    """Refuse a model or a calibration that doesn't exist."""
    _choices([request.model], request.network, rising_only=request.rising_only)
    calibration_data(place.station, request.calibration_id)


def run_fit(context: JobContext, request: FitRequest) -> JobResult:
    """Fit one more model to the points of a calibration and register it."""
    station = context.station
    (choice,) = _choices([request.model], request.network, rising_only=request.rising_only)
    entry, data = calibration_data(station, request.calibration_id)
    run = RunFolder(station.registry.run(str(entry.run_id)).folder)
    (item,) = fit_models(
        data,
        [choice],
        context.job,
        title="Fitting",
        effects=recorded_effects(run.metadata, data),
        limits=None if run.metadata.get("kind") == TABLE else run_profile(run).plausibility,
        before=model_in_use(station.registry, data),
    )
    metrics = fit_metrics(item, data)
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
    path = station.data_dir / "models" / f"{entry.run_id}-{item.name}-{stamp}.json"
    store_model(path, item.model, data, metrics, item.effects, item.contradictions, private=True)
    model = station.registry.add_model(
        entry,
        kind=item.model.kind,
        file=path,
        side=data.side,
        metrics=metrics,
        contradictions=item.contradictions,
    )
    return JobResult(
        headline=Message(
            "{title}: largest residual {worst_nm:.3g} N·m.",
            item.title,
            errors_of(item, data).worst_nm,
        ),
        simulated=data.simulated,
        run_ids=(str(entry.run_id),),
        calibration_id=entry.calibration_id,
        model_ids={item.name: model.model_id},
        details=fit_details(data, [item], {item.name: model.model_id}),
    )


# -- verify ---------------------------------------------------------------------------------


def _verification_profile(place: Workplace, request: VerifyRequest) -> Profile:
    """Return the profile, limited to the calibrated range."""
    profile = place.settings.profile(request.profile).with_options(
        groups=request.groups, points=request.points
    )
    if profile.loading.pattern != "random":
        raise InputError(
            Message("profile {name} for a verification", profile.name), "a profile of random points"
        )
    entry, data = calibration_data(place.station, request.calibration_id)
    return profile.within(100.0 * float(np.max(np.abs(data.standard_nm))) / entry.range_nm)


def _side_of(station: Station, entry: CalibrationEntry) -> Side:
    for side in ("input", "output"):
        transducer = station.description.module(side).transducer.serial
        if transducer == entry.transducer_serial:
            return side
    raise InputError(
        Message(
            "calibration {number} is of transducer {serial}",
            entry.calibration_id,
            entry.transducer_serial,
        ),
        "one of this bench's transducers",
    )


def check_verification(place: Workplace, request: VerifyRequest) -> None:
    """Refuse records that don't exist, or aren't this bench's."""
    station = place.station
    entry = station.registry.calibration(request.calibration_id)
    _side_of(station, entry)
    _verification_profile(place, request)
    if not models_of(station, entry):
        raise RecordError(
            Message("calibration {number} has no model", entry.calibration_id), "a fitted model"
        )


def preview_verification(place: Workplace, request: VerifyRequest) -> JobPreview:
    """Rehearse a verification with some seed."""
    station = place.station
    side = _side_of(station, station.registry.calibration(request.calibration_id))
    profile = _verification_profile(place, request)
    steps = profile.staircase(
        station.description.module(side).range_nm, np.random.default_rng(request.seed or 0)
    )
    rehearsal = rehearse(station.devices, verify_plan(station.devices, side, profile, steps))
    title = Message("Verify the {side} module", side)
    doubts = tuple(doubts_before(station, VERIFICATION_STANDARD))
    return staircase_preview(side, "verify", title, rehearsal, doubts)


def run_verification(context: JobContext, request: VerifyRequest) -> JobResult:
    """Measure fresh points, judge every model of the calibration and register the outcome."""
    station = context.station
    entry = station.registry.calibration(request.calibration_id)
    side = _side_of(station, entry)
    verified = verify_on_bench(
        station,
        side,
        _verification_profile(context, request),
        models_of(station, entry),
        request.seed,
        progress=context.job,
    )
    record = verified.measured.record
    return verification_result(
        record.metadata,
        entry,
        verified.chains,
        verified.measured.result.data,
        verified.result,
        run_id=record.run_id,
        tolerance_percent_fs=request.tolerance_percent_fs,
        seed=verified.seed,
    )


def _calibrate_title(request: CalibrateRequest) -> str:
    return Message("Calibrate the {side} module", request.side)


CALIBRATION_KINDS: tuple[JobKind, ...] = (
    JobKind(
        "calibrate",
        _calibrate_title,
        CalibrateRequest,
        run_calibration,
        preview_calibration,
        check_calibration,
    ),
    JobKind(
        "resume-calibration",
        lambda asked: Message("Go on with {run}", asked.run_id),
        ResumeRequest,
        run_resumption,
        check=check_resumption,
    ),
    JobKind(
        "compare-models",
        lambda asked: Message("Compare models of calibration {number}", asked.calibration_id),
        CompareRequest,
        run_comparison,
        check=lambda place, asked: calibration_data(place.station, asked.calibration_id),
        moves=False,
        can_pause=False,
    ),
    JobKind(
        "fit",
        lambda asked: Message(
            "Fit {model} to calibration {number}", asked.model, asked.calibration_id
        ),
        FitRequest,
        run_fit,
        check=check_fit,
        role="metrologist",
        moves=False,
        can_pause=False,
    ),
    JobKind(
        "verify",
        lambda asked: Message("Verify calibration {number}", asked.calibration_id),
        VerifyRequest,
        run_verification,
        preview_verification,
        check_verification,
    ),
)
