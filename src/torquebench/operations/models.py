"""Models of registered calibrations: compare kinds of model, fit another one, activate one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Annotated, Any

from torquebench import campaign, chain, compensation, procedures, records
from torquebench.bench.roles import Side
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.operations.calibrating import (
    CalibratedModule,
    CalibrationResult,
    calibration_result,
    described_module,
    model_choices,
)
from torquebench.operations.operation import (
    CalibrationNumber,
    Flag,
    ModelName,
    ModelNumber,
    Operation,
    Request,
    Values,
    field,
)
from torquebench.operations.place import Place
from torquebench.operations.result import Decision, Result
from torquebench.progress import SHARES, Progress
from torquebench.records.signatures import how
from torquebench.reports.page import Block, Facts, Page, Section, Table

Calibration = Annotated[
    CalibrationNumber, field("A registered calibration.", title="Calibration", argument=True)
]


class CompareModelsRequest(Request):
    """Compare all kinds of model on a registered calibration by cross-validation."""

    calibration: Calibration


class FitModelRequest(Request):
    """Fit another model to a registered calibration and register it."""

    calibration: Calibration
    model: Annotated[
        ModelName, field("Kind of model.", choices="models", examples=("polynomial-3",))
    ] = "hybrid"
    rising_only: Annotated[
        Flag, field("Fit it to the rising points alone, as the source papers load.")
    ] = False
    parameters: Annotated[
        Values, field("Parameter of the model: epochs=20000.", max_length=20)
    ] = {}  # noqa: RUF012 - pydantic copies it


class UseRequest(Request):
    """Put a model into use for its transducer and counter.

    A model whose calibration contradicts itself is used only if a person decides so, with a reason.
    """

    model: Annotated[ModelNumber, field("The model.", argument=True)]
    reason: Annotated[str, field("Why, for the record.", max_length=500)] = ""
    despite_contradictions: Annotated[
        Flag, field("Use it although its calibration contradicts itself.", decision=True)
    ] = False


class DeactivateRequest(Request):
    """Take the compensation of a module out of use."""

    side: Annotated[Side, field("Which module.", title="Module", argument=True)]
    reason: Annotated[str, field("Why, for the record.", max_length=500)] = ""


# -- points and models of the records -------------------------------------------------------


def calibration_points(
    registry: records.Registry, number: int
) -> tuple[records.CalibrationEntry, campaign.Measured[procedures.StaircaseResult]]:
    """Return a bench's calibration, and the measured result from its folder.

    Raises
    ------
    RecordError
        The calibration isn't registered, has no run, or its run was changed.
    """
    entry = registry.calibration(number)
    if entry.run_id is None:
        raise RecordError(
            Message("calibration {number} comes from a table", number),
            "a calibration of this bench",
        )
    measured = campaign.read_measured(records.RunFolder(registry.run(entry.run_id).folder))
    if measured.result.data.sha256() != entry.data_sha256:
        raise RecordError(
            Message("the points of calibration {number} were changed", number), "as recorded"
        )
    return entry, measured


def stored_module(registry: records.Registry, number: int) -> CalibratedModule:
    """Return a registered calibration with its points and all of its models.

    Raises
    ------
    RecordError
        As in `calibration_points`, or a model's file is missing or was changed.
    """
    entry, measured = calibration_points(registry, number)
    points = measured.result.data
    remarks = campaign.remarks_on(points)
    fitted: list[tuple[int, campaign.FittedModel]] = []
    for model in reversed(registry.models(entry.transducer_serial, calibration_id=number)):
        stored = chain.load_chain(model.check_file())
        few = () if fitted else campaign.few_points(stored.model, len(points))
        fitted.append((model.model_id, _fitted(stored, model, (*remarks, *few))))
    active = registry.active_model(entry.transducer_serial, entry.counter_identity)
    in_use = None if active is None else active.model_id
    return described_module(entry, measured, fitted, in_use)


def _fitted(
    stored: chain.MeasuringChain, entry: records.ModelEntry, remarks: tuple[str, ...]
) -> campaign.FittedModel:
    """Return a stored model as a fitted one, with the parameters that aren't defaults."""
    model = stored.model
    name = model.name
    usual = compensation.make_model(name).kind_parameters
    parameters = {
        key: value
        for key, value in model.kind_parameters.items()
        if key not in ("degree", *campaign.CHOSEN_ELSEWHERE) and value != usual.get(key)
    }
    return campaign.FittedModel(
        name=name,
        title=campaign.model_title(model.kind, model.kind_parameters),
        model=model,
        seconds=0.0,
        remarks=remarks,
        effects=stored.stored,
        contradictions=entry.contradictions,
        choice=campaign.ModelChoice(name, parameters),
    )


# -- compare --------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ComparedModels(Result):
    """Comparison of all kinds of model at points that they weren't fitted to."""

    calibration_id: int
    scores: Sequence[compensation.ModelScore]
    best: str
    refused: Mapping[str, str]
    noise: compensation.NoiseFloor | None
    steps: int
    folds: int

    def page(self) -> Page:
        """Return its description."""
        scores = sorted(self.scores, key=lambda score: score.worst_nm)
        blocks: list[Block] = [comparison_table(scores, self.best, self.folds, self.steps)]
        if self.refused:
            blocks.append(Facts(list(self.refused.items())))
        title = Message("Models of calibration-{number}", self.calibration_id)
        return Page(title, "", [Section("", "", blocks)], simulated=self.simulated)


def comparison_table(
    scores: Sequence[compensation.ModelScore], marked: str, folds: int, steps: int
) -> Table:
    """Return a table of each model's errors at steps that it wasn't fitted to."""
    from torquebench.reports.errors_table import number

    rows = [
        (
            campaign.model_title(score.name),
            number(score.worst_nm),
            number(score.rms_nm),
            number(score.worst_percent_fs),
            number(score.rms_percent_fs),
            f"{score.effective_parameters:.1f}",
        )
        for score in scores
    ]
    header = (
        "model",
        "worst, N·m",
        "RMS, N·m",
        "worst, % FS",
        "RMS, % FS",
        "effective parameters",
    )
    caption = Message(
        "Errors at steps left out ({folds} folds, {steps} steps). The outermost steps always stay "
        "in, since a model never has to extrapolate.",
        folds,
        steps,
    )
    best = next((row for row, score in enumerate(scores) if score.name == marked), None)
    return Table(header, rows, caption, best)


def compare_points(X: Any, y: Any, range_nm: float, progress: Progress) -> compensation.Comparison:
    """Compare all kinds of model on some points; return the result without the fitted models."""
    comparison = compensation.compare(X, y, range_nm=range_nm, progress=progress)
    return replace(comparison, models={})


def check_calibration_points(
    place: Place, request: CompareModelsRequest | FitModelRequest
) -> Iterable[str]:
    """Raise an error if the calibration has no points."""
    calibration_points(place.registry, request.calibration)
    return ()


def run_comparison(
    place: Place, request: CompareModelsRequest, progress: Progress
) -> ComparedModels:
    """Compare the models, on an open bench in a separate process that doesn't delay its threads."""
    import numpy as np

    entry, measured = calibration_points(place.registry, request.calibration)
    data = measured.result.data
    progress.start("Comparing models", SHARES)
    comparison = place.compute(
        compare_points,
        data.features(campaign.COMPARED_COLUMNS),
        data.standard_nm,
        data.range_nm,
        progress=progress,
    )
    good = np.delete(np.arange(len(data)), [point.row for point in comparison.outliers])
    return ComparedModels(
        headline=Message(
            "Least error at points left out: {model}.", campaign.model_title(comparison.best)
        ),
        simulated=data.simulated,
        run_ids=(str(entry.run_id),),
        calibration_id=entry.calibration_id,
        scores=comparison.scores,
        best=comparison.best,
        refused=comparison.refused,
        noise=data.subset(good).noise_floor(),
        steps=comparison.steps,
        folds=comparison.folds,
    )


# -- fit ------------------------------------------------------------------------------------


def check_fit(place: Place, request: FitModelRequest) -> Iterable[str]:
    """Raise an error for an unknown kind of model or calibration."""
    model_choices([request.model], request.parameters, rising_only=request.rising_only)
    return check_calibration_points(place, request)


def run_fit(place: Place, request: FitModelRequest, progress: Progress) -> CalibrationResult:
    """Fit another model to the points of a calibration and register it."""
    from torquebench.campaign.external_calibration import KIND as TABLE

    registry = place.registry
    choices = model_choices([request.model], request.parameters, rising_only=request.rising_only)
    entry, measured = calibration_points(registry, request.calibration)
    data, metadata = measured.result.data, measured.record.metadata
    (item,) = campaign.fit_models(
        data,
        choices,
        progress,
        title="Fitting",
        effects=campaign.recorded_effects(metadata, data),
        limits=None if metadata.get("kind") == TABLE else measured.profile.plausibility,
        before=campaign.model_in_use(registry, data),
    )
    metrics = campaign.fit_metrics(item, data)
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
    path = registry.root / "models" / f"{entry.run_id}-{item.name}-{stamp}.json"
    campaign.store_model(
        path, item.model, data, metrics, item.effects, item.contradictions, private=True
    )
    model = registry.add_model(
        entry,
        kind=item.model.kind,
        file=path,
        side=data.side,
        metrics=metrics,
        contradictions=item.contradictions,
    )
    module = described_module(entry, measured, [(model.model_id, item)], None)
    return CalibrationResult(**calibration_result([module], ()))


# -- use ------------------------------------------------------------------------------------


def run_use(place: Place, request: UseRequest, _progress: Progress) -> Decision:
    """Activate a model, with a name and a reason."""
    registry = place.registry
    entry = registry.model(request.model)
    entry.check_file()
    if request.despite_contradictions and not request.reason.strip():
        raise InputError(
            Message(
                "model-{number} in use despite contradictions, without a reason", request.model
            ),
            "a reason",
            "state why",
        )
    registry.activate(
        entry.model_id,
        operator=place.operator,
        reason=request.reason,
        despite_contradictions=request.despite_contradictions,
        signature=place.signature,
    )
    return Decision(
        headline=Message(
            "In use: model-{number} of calibration-{calibration}, by {who}.",
            entry.model_id,
            entry.calibration_id,
            place.operator,
        ),
        simulated=entry.simulated,
        remarks=tuple(str(each) for each in entry.contradictions),
        signature=how(place.signature),
    )


def run_deactivate(place: Place, request: DeactivateRequest, _progress: Progress) -> Decision:
    """Take the compensation of a module out of use."""
    description = place.station.description
    serial = description.module(request.side).transducer.serial
    counter = place.station.drivers.counter.clock_identity
    place.registry.deactivate(
        serial,
        counter,
        operator=place.operator,
        reason=request.reason,
        signature=place.signature,
    )
    return Decision(
        headline=Message("The {side} module isn't compensated any more.", request.side),
        simulated=description.simulated,
        signature=how(place.signature),
    )


COMPARE_MODELS = Operation(
    "records compare-models",
    CompareModelsRequest,
    run_comparison,
    lambda request: Message("Compare models of calibration-{number}", request.calibration),
    check=check_calibration_points,
)
FIT_MODEL = Operation(
    "records fit-model",
    FitModelRequest,
    run_fit,
    lambda request: Message(
        "Fit {model} to calibration-{number}", request.model, request.calibration
    ),
    check=check_fit,
    role="metrologist",
)
USE = Operation(
    "records use",
    UseRequest,
    run_use,
    lambda request: Message("Use model-{number}", request.model),
    role="metrologist",
    quick=True,
    commands=True,
    activates=True,
)
DEACTIVATE = Operation(
    "records deactivate",
    DeactivateRequest,
    run_deactivate,
    lambda request: Message("Take the compensation of the {side} module out of use", request.side),
    where="bench",
    role="metrologist",
    quick=True,
    commands=True,
    activates=True,
)
