"""Calibrations on the bench: measure, resume, finish, discard; and the display of their results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from torquebench import calibration, campaign, compensation, procedures, records
from torquebench.bench.roles import SIDE_TITLES, Side
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import (
    WHOLE,
    Flag,
    ModelName,
    MountedRequest,
    Name,
    Number,
    Operation,
    Request,
    RunId,
    Values,
    chosen_sides,
    field,
)
from torquebench.operations.place import Place
from torquebench.operations.preview import Preview, joined_previews, loading_preview
from torquebench.operations.result import Integers, Numbers, Result
from torquebench.progress import Progress
from torquebench.reports.page import Block, Diagram, Facts, Page, Section, Table

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription


MOST_STEPS = 5000
"""Largest number of points of a loading sequence; more would take a day and is a typing mistake."""
FIRST_MODELS = ("hybrid", "polynomial-2")

Models = Annotated[
    tuple[ModelName, ...],
    field(
        "Kind of model to fit. The first one is put into use. May be repeated.",
        title="Models",
        choices="models",
        min_length=1,
        max_length=8,
    ),
]
Parameters = Annotated[
    Values,
    field(
        "Parameter of the model, if there is only one: epochs=20000.",
        max_length=20,
    ),
]
Activate = Annotated[
    Flag,
    field(
        "Put the first model into use. Points that contradict each other forbid it.",
        title="Put into use at once",
        role="metrologist",
    ),
]


class CalibrateRequest(MountedRequest):
    """Calibrate modules against the calibrator, fit the compensation and put it into use.

    The bench is zeroed, preloaded and loaded in the profile's steps. A pause takes effect at the
    next point, without torque. Limits and interlocks are checked for the whole sequence before
    anything moves.
    """

    basic = ("side", "profile", "step_percent", "up_to_nm", "activate")

    side: Annotated[
        Literal["input", "output", "both"], field("Which module.", title="Module", argument=True)
    ]
    profile: Annotated[
        Name, field("Calibration profile.", choices="profiles:steps", examples=("rapid-in-situ",))
    ] = "rapid-in-situ"
    step_percent: Annotated[
        Number | None, field("Width of the steps, % of range.", title="Step size", ge=0.1, le=100)
    ] = None
    repeats: Annotated[
        Annotated[int, Field(ge=1, le=50), WHOLE] | None,
        field("How often every series is loaded."),
    ] = None
    up_to_nm: Annotated[
        Number | None,
        field(
            "Largest torque of one module, N·m: the profile's steps and preloads scale with it. "
            "For a reducer that needs a small part of the range.",
            title="Maximum torque",
            gt=0,
            le=1e6,
        ),
    ] = None
    rising_only: Annotated[Flag, field("Load rising series only, as in the source papers.")] = False
    models: Models = FIRST_MODELS
    activate: Activate = True
    points: Annotated[
        Annotated[int, Field(ge=8, le=2000), WHOLE] | None,
        field("Largest number of points of an adaptive calibration."),
    ] = None
    target_percent_fs: Annotated[
        Number | None,
        field(
            "An adaptive calibration ends with this largest U (k = 2) of the model, % FS.",
            title="Target of U",
            ge=1e-6,
            le=100,
        ),
    ] = None
    parameters: Parameters = {}  # noqa: RUF012 - pydantic copies it


class ResumeRequest(MountedRequest):
    """Resume an interrupted calibration at its interrupted series.

    Module and profile are those of the interrupted run.
    """

    run_id: Annotated[
        RunId,
        field(
            "The run: its id, the beginning of the id, or `latest`.",
            title="Run",
            argument=True,
            examples=("latest",),
        ),
    ]
    models: Annotated[
        tuple[ModelName, ...] | None,
        field(
            "Kind of model to fit; without it those of the interrupted run. May be repeated.",
            choices="models",
            max_length=8,
        ),
    ] = None
    activate: Activate = True


class FinishRequest(Request):
    """Finish runs that are measured, after a kill or an error: enter, fit and register them.

    Nothing is measured. An interrupted calibration has to be resumed on its bench instead.
    """

    run_id: Annotated[
        RunId | None,
        field(
            "The run: its id, the beginning of the id, or `latest`; without it every run.",
            title="Run",
            argument=True,
            examples=("latest",),
        ),
    ] = None


class DiscardRequest(Request):
    """Discard an unfinished run and record the decision; the run's folder stays unchanged."""

    run_id: Annotated[
        RunId, field("The run: its id, or the beginning of it.", title="Run", argument=True)
    ]
    reason: Annotated[str, field("Why, for the record.", min_length=1, max_length=200)]


# -- results --------------------------------------------------------------------------------


@dataclass(frozen=True)
class CalibrationPoints:
    """The points of a calibration, in measuring order."""

    reading_nm: Numbers
    standard_nm: Numbers
    branch: Integers
    series: Integers
    time_s: Numbers | None
    loading_error_percent: Numbers | None


@dataclass(frozen=True)
class TrainingCurve:
    """RMS of the residuals of a network's training, by epoch."""

    epoch: Numbers
    rms_nm: Numbers


@dataclass(frozen=True)
class ModelCurve:
    """Additional torque by a model over the reading, on both branches."""

    reading_nm: Numbers
    rising_nm: Numbers
    falling_nm: Numbers


@dataclass(frozen=True)
class CalibratedModel:
    """A fitted model, and its errors at the fitted points.

    Parameters
    ----------
    name : str
        Name by which it was chosen, such as "polynomial-2".
    model_id : int or None
        Number in the registry; None before registration.
    title, kind : str
    torque_nm : array
        Compensated torque at each point, N·m.
    errors : ErrorSummary
    curve : ModelCurve
    parameters : mapping
        Parameters that were specified.
    rising_only : bool
        Whether it was fitted to the rising points only.
    in_use : bool
    """

    name: str
    model_id: int | None
    title: str
    kind: str
    torque_nm: Numbers
    errors: calibration.ErrorSummary
    curve: ModelCurve
    remarks: Sequence[str]
    contradictions: Sequence[calibration.Contradiction]
    parameters: Mapping[str, Any]
    rising_only: bool
    training_curve: TrainingCurve | None
    in_use: bool


@dataclass(frozen=True)
class CalibratedModule:
    """A calibration of one module, with the models that were fitted to it."""

    side: str
    range_nm: float
    calibration_id: int
    run_id: str
    transducer_serial: str
    counter_identity: str
    simulated: bool
    standard_serial: str
    profile: str
    data_sha256: str
    points: CalibrationPoints
    raw: calibration.ErrorSummary
    models: Sequence[CalibratedModel]
    noise: compensation.NoiseFloor | None
    loading_accuracy_percent: float | None
    unsettled: int | None
    placement: calibration.Placement | None
    mounting: Mapping[str, str]

    @property
    def best(self) -> CalibratedModel | None:
        """The model with the least error at its points; None without models."""
        return min(self.models, key=lambda each: each.errors.worst_percent_fs, default=None)

    @property
    def contradicting(self) -> bool:
        """Whether points contradict each other, a model or the previous calibration."""
        return any(model.contradictions for model in self.models)

    def model(self, model_id: int) -> CalibratedModel:
        """Return a model by its number."""
        return next(model for model in self.models if model.model_id == model_id)


@dataclass(frozen=True, kw_only=True)
class CalibrationResult(Result):
    """Calibrated modules."""

    modules: tuple[CalibratedModule, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether points contradict each other."""
        return any(module.contradicting for module in self.modules)

    def page(self) -> Page:
        """Return its description: errors at the fitted points, which aren't a verification."""
        sides = " and ".join(module.side for module in self.modules)
        plural = "s" if len(self.modules) > 1 else ""
        sections = [part for module in self.modules for part in _module_sections(module)]
        title = Message("Calibration of the {side} module{s}", sides, plural)
        return Page(title, "", sections, simulated=self.simulated)


@dataclass(frozen=True, kw_only=True)
class FinishedRuns(CalibrationResult):
    """Finished runs, with the calibrated modules, and runs that remain unfinished."""

    unfinished: tuple[str, ...] = ()

    def page(self) -> Page:
        """Return its description."""
        return super().page() if self.modules else Result.page(self)


def calibration_result(modules: Sequence[CalibratedModule], remarks: Sequence[str]) -> Any:
    """Return the fields that results of calibrations have in common."""
    return {
        "headline": Message.joined(map(_headline, modules), " "),
        "simulated": any(module.simulated for module in modules),
        "run_ids": tuple(module.run_id for module in modules),
        "modules": tuple(modules),
        "remarks": (*(each for module in modules for each in _remarks(module)), *remarks),
    }


def _headline(module: CalibratedModule) -> str:
    judged: str = ""
    if module.contradicting:
        judged = "; the points contradict each other, the model or the last calibration"
    elif module.best is not None:
        judged = Message(
            "; largest residual of {title}: {worst_nm:.3g} N·m",
            module.best.title,
            module.best.errors.worst_nm,
        )
    return Message(
        "{count} points; the raw reading is wrong by up to {worst_nm:.3g} N·m{found}.",
        module.raw.points,
        module.raw.worst_nm,
        judged,
    )


def _remarks(module: CalibratedModule) -> Sequence[str]:
    remarks = [each for model in module.models for each in model.remarks]
    if module.unsettled:
        remarks.append(
            Message(
                "{count} points still drifted at the end of their waiting time", module.unsettled
            )
        )
    if module.contradicting:
        remarks.append(
            Message(
                "find the cause and calibrate again, or activate model-{number} "
                "nevertheless with a name and a reason",
                module.models[0].model_id,
            )
        )
    elif not any(model.in_use for model in module.models):
        remarks.append(
            Message(
                "not in use: a metrologist puts model-{number} into use", module.models[0].model_id
            )
        )
    return remarks


def calibrated_module(finished: campaign.FinishedCalibration) -> CalibratedModule:
    """Describe a calibration that was just registered."""
    registered = finished.registered
    numbers = {name: entry.model_id for name, entry in registered.models.items()}
    in_use = None if finished.active is None else numbers[finished.active]
    return described_module(
        registered.calibration,
        finished.measured,
        [(numbers[item.name], item) for item in finished.fitted],
        in_use,
    )


def described_module(
    entry: records.CalibrationEntry,
    measured: campaign.Measured[procedures.StaircaseResult],
    fitted: Sequence[tuple[int, campaign.FittedModel]],
    in_use: int | None,
) -> CalibratedModule:
    """Describe a registered calibration.

    Parameters
    ----------
    entry : CalibrationEntry
    measured : campaign.Measured
        Its run with the points and the profile, options included.
    fitted : sequence of (int, campaign.FittedModel)
        Registered models with their numbers.
    in_use : int or None
        Number of the model in use.
    """
    from torquebench.bench.mounting_record import MountingRecord, mounting_facts

    data, profile = measured.result.data, measured.profile
    first_s = None if data.time_s is None else data.time_s[0]
    return CalibratedModule(
        side=data.side,
        range_nm=data.range_nm,
        calibration_id=entry.calibration_id,
        run_id=str(entry.run_id),
        transducer_serial=data.transducer_serial,
        counter_identity=data.counter_identity,
        simulated=data.simulated,
        standard_serial=measured.result.standard_serial,
        profile=f"{profile.name} (SHA-256 {profile.sha256[:16]}…)",
        data_sha256=data.sha256(),
        points=CalibrationPoints(
            data.reading_nm,
            data.standard_nm,
            data.branch,
            data.series,
            None if first_s is None else data.time_s - first_s,
            data.loading_error_percent,
        ),
        raw=calibration.summarise_errors(data.reading_nm, data.standard_nm, data.range_nm),
        models=[_described_model(data, number, item, in_use) for number, item in fitted],
        noise=data.noise_floor(),
        loading_accuracy_percent=data.loading_accuracy_percent,
        unsettled=measured.result.unsettled,
        placement=measured.result.placement,
        mounting=dict(mounting_facts(MountingRecord.of_run(measured.record.metadata))),
    )


def _described_model(
    data: calibration.CalibrationData, number: int, item: campaign.FittedModel, in_use: int | None
) -> CalibratedModel:
    torque_nm = item.chain.torque(data.readings()).value_nm
    curve = getattr(item.model, "training_curve_", None)
    return CalibratedModel(
        name=item.name,
        model_id=number,
        title=item.title,
        kind=item.model.kind,
        torque_nm=torque_nm,
        errors=calibration.summarise_errors(torque_nm, data.standard_nm, data.range_nm),
        curve=ModelCurve(*calibration_curve(item.model, data)),
        remarks=item.remarks,
        contradictions=item.contradictions,
        parameters={} if item.choice is None else item.choice.parameters,
        rising_only=item.choice is not None and item.choice.rising_only,
        training_curve=None if curve is None or not curve.size else TrainingCurve(*curve.T),
        in_use=number == in_use,
    )


CURVE_POINTS = 201


def calibration_curve(model: Any, data: calibration.CalibrationData) -> tuple[Any, Any, Any]:
    """Return readings, and a model's additional torque there on each branch."""
    import numpy as np

    low, high = float(np.min(data.reading_nm)), float(np.max(data.reading_nm))
    grid = np.linspace(low, high, CURVE_POINTS)
    columns, curves = model.n_features_in_, []
    for branch in (1.0, -1.0):
        X = compensation.features(
            grid, branch=np.full(grid.size, branch), series=np.zeros(grid.size)
        )
        curves.append(model.additional_torque(X[:, :columns]))
    return grid, curves[0], curves[1]


# -- what a calibration looks like ----------------------------------------------------------


def _module_sections(module: CalibratedModule) -> list[Section]:
    title = Message("{side}, {range_nm:g} N·m", SIDE_TITLES[module.side], module.range_nm)
    blocks: list[Block] = [Facts(_facts(module)), errors_of_models(module)]
    if module.placement is not None:
        blocks.append(_placed(module.placement))
    if contradictions := {each.found: each for m in module.models for each in m.contradictions}:
        rows = [(each.found, each.allowed, each.cause) for each in contradictions.values()]
        header = ("contradiction", "allowed", "possible cause")
        blocks.append(Table(header, rows, words=True))
    text = "" if module.placement is None else module.placement.sentence
    return [
        Section(title, text, blocks),
        Section("Additional torque", "", [additional_torque(module)], detail=True),
        Section("Before and after", "", residuals(module), detail=True),
        *([Section("Training", "", trained, detail=True)] if (trained := training(module)) else []),
        Section("Loading", "", [Facts(_record(module)), *_loading(module)], detail=True),
    ]


def _facts(module: CalibratedModule) -> list[tuple[str, str]]:
    in_use = next((model for model in module.models if model.in_use), None)
    registered = Message.joined(
        Message("model-{number}, {title}", model.model_id, model.title) for model in module.models
    )
    facts: list[tuple[str, str]] = [
        ("Transducer", module.transducer_serial),
        ("Calibration", f"calibration-{module.calibration_id}"),
        ("Registered", registered),
        ("In use", "none" if in_use is None else f"model-{in_use.model_id}"),
        ("Run", module.run_id),
    ]
    if module.loading_accuracy_percent is not None:
        facts.append(
            (
                "Loading accuracy",
                Message(
                    "{percent:.2g} % of range: largest difference of the standard from the target "
                    "torque",
                    module.loading_accuracy_percent,
                ),
            )
        )
    return facts


def _record(module: CalibratedModule) -> list[tuple[str, str]]:
    noise = module.noise
    facts = [
        ("Counter", module.counter_identity),
        ("Profile", module.profile),
        ("Standard", module.standard_serial),
    ]
    if noise is not None:
        facts.append(
            (
                "Scatter of repeated points",
                Message(
                    "{scatter:.3g} N·m ({count} degrees of freedom)",
                    noise.standard_deviation_nm,
                    noise.degrees_of_freedom,
                ),
            )
        )
    return [*facts, *module.mounting.items(), ("Data SHA-256", module.data_sha256)]


def errors_of_models(module: CalibratedModule) -> Table:
    """Return the errors of the raw reading and of each model at the points of the fit."""
    from torquebench.reports.errors_table import errors_table

    rows = [("raw reading", module.raw), *((m.title, m.errors) for m in module.models)]
    in_use = next((row for row, m in enumerate(module.models, start=1) if m.in_use), None)
    caption = Message(
        "Against the standard at {count} points that the models were fitted to: only fresh points "
        "verify a model.",
        module.raw.points,
    )
    return errors_table(rows, caption, in_use)


def _placed(placement: calibration.Placement) -> Table:
    rows = [
        (
            str(each.points),
            f"{each.expanded_percent:.4f}",
            str(each.proposed or ""),
            f"{each.predicted_percent:.4f}" if each.proposed else "",
        )
        for each in placement.rounds
    ]
    header = ("points", "U, % FS", "placed next", "U predicted, % FS")
    return Table(header, rows, "U (k = 2) of the model at its largest.")


def additional_torque(module: CalibratedModule) -> Diagram:
    """Draw the additional torque: standard minus reading at each point, and each model's curve."""
    import numpy as np

    from torquebench.figures import Curve
    from torquebench.reports.curve_figures import Panel

    points = module.points
    additional, branch = points.standard_nm - points.reading_nm, np.asarray(points.branch)
    curves = [
        Curve(word, points.reading_nm[rows], additional[rows], raw=True, style=marker)
        for word, rows, marker in (
            ("measured, rising", branch > 0, "^"),
            ("measured, falling", branch < 0, "v"),
            ("measured", branch == 0, "o"),
        )
        if rows.any()
    ]
    for model in module.models:
        curve = model.curve
        if np.array_equal(curve.rising_nm, curve.falling_nm):
            curves.append(Curve(model.title, curve.reading_nm, curve.rising_nm))
            continue
        for word, values in (("rising", curve.rising_nm), ("falling", curve.falling_nm)):
            label = Message("{title}, {branch}", model.title, word)
            curves.append(Curve(label, curve.reading_nm, values))
    panel = Panel(curves, "reading in N·m", "additional torque in N·m", range_nm=module.range_nm)
    return Diagram([panel], "Additional torque (standard minus reading), and the models' curves.")


LIMIT_FS = 0.001
"""0.1 % of full scale: the accuracy of the published instrument (doi 10.1177/00202940221103308)."""


def residuals(module: CalibratedModule) -> list[Block]:
    """Return the error of the reading, and the residual of each model, over the torque."""
    from torquebench.figures import Curve
    from torquebench.reports.curve_figures import Panel

    points, limit = module.points, LIMIT_FS * module.range_nm
    raw = Curve("raw reading", points.standard_nm, points.reading_nm - points.standard_nm, raw=True)
    after = [
        Curve(model.title, points.standard_nm, model.torque_nm - points.standard_nm)
        for model in module.models
    ]
    axes: dict[str, Any] = {"markers": True, "range_nm": module.range_nm, "side": module.side}
    panels = [
        Panel([raw], "torque in N·m", "error in N·m", **axes),
        Panel(after, "torque in N·m", "residual in N·m", limits=(-limit, limit), **axes),
    ]
    caption = (
        "Error before compensation and residual after it, at the points of the fit. Dashed: 0.1 % "
        "FS."
    )
    return [Diagram(panels, caption, height=2.2)]


def training(module: CalibratedModule) -> list[Block]:
    """Return the training curve of every network."""
    from torquebench.figures import Curve
    from torquebench.reports.curve_figures import Panel

    curves, facts = [], []
    for model in module.models:
        curve = model.training_curve
        if curve is None:
            continue
        curves.append(Curve(model.title, curve.epoch, curve.rms_nm))
        facts.append(
            (
                model.title,
                Message(
                    "{epochs:g} epochs; RMS of the residuals {rms:.3g} N·m",
                    curve.epoch[-1],
                    curve.rms_nm[-1],
                ),
            )
        )
    if not curves:
        return []
    panel = Panel(curves, "epoch", "RMS of residuals in N·m", logarithmic="xy")
    return [Facts(facts), Diagram([panel], "Training of the network.")]


def _loading(module: CalibratedModule) -> list[Block]:
    """Return the staircase as the standard read it, and each step's deviation from its target."""
    import numpy as np

    from torquebench.figures import Curve
    from torquebench.reports.curve_figures import Panel

    points = module.points
    blocks: list[Block] = []
    if points.time_s is not None:
        curve = Curve("", points.time_s, points.standard_nm)
        panel = Panel([curve], "bench time in s", "standard in N·m")
        blocks.append(Diagram([panel], "The steps as the standard read them.", height=2.2))
    if points.loading_error_percent is not None:
        error = np.asarray(points.loading_error_percent)
        steps = Curve("", np.arange(1.0, error.size + 1.0), error)
        limit = 100.0 * LIMIT_FS
        panel = Panel(
            [steps],
            "step",
            "loading error in % of range",
            markers=True,
            limits=(-limit, limit),
        )
        caption = "Standard minus target torque at every step. Dashed: ±0.1 % of range."
        blocks.append(Diagram([panel], caption, height=2.0))
    return blocks


# -- calibrate ------------------------------------------------------------------------------


def model_choices(
    names: Sequence[str], parameters: Mapping[str, Any] | None = None, *, rising_only: bool = False
) -> list[campaign.ModelChoice]:
    """Check and return the models to be fitted.

    Raises
    ------
    InputError
        A kind of model or parameter doesn't exist, or parameters are given for several models.
    """
    names = tuple(dict.fromkeys(names))
    if parameters and len(names) != 1:
        raise InputError(
            Message("parameters ({names}) of several models", ", ".join(parameters)),
            "parameters of one model",
            "name one model only, or leave the parameters out",
        )
    choices = [campaign.ModelChoice(name, dict(parameters or {}), rising_only) for name in names]
    for choice in choices:
        choice.check()
    return choices


def _profile(place: Place, request: CalibrateRequest, side: Side) -> calibration.Profile:
    """Return the profile with the request's options; raise an error if it has too many steps."""
    import numpy as np

    range_nm = place.station.description.module(side).range_nm
    up_to = request.up_to_nm
    if up_to is not None and request.side == "both":
        raise InputError(
            Message("up to {torque_nm:g} N·m at both modules", up_to),
            "input or output",
            "calibrate one module after the other, each up to its own torque",
        )
    profile = place.library.profile(request.profile).with_options(
        rising_only=request.rising_only or None,
        repeats=request.repeats,
        step_percent=request.step_percent,
        up_to_percent=None if up_to is None else 100.0 * up_to / range_nm,
        points=request.points,
        target_percent=request.target_percent_fs,
    )
    calibration.check_steps(profile)
    steps = (request.repeats or 1) * len(profile.loading.percents())
    if steps <= MOST_STEPS:  # more steps would take too long to compute
        steps = len(profile.staircase(range_nm, np.random.default_rng(0)))
    if steps > MOST_STEPS:
        raise InputError(
            Message("a staircase of {steps} steps", steps),
            Message("at most {limit}", MOST_STEPS),
            "wider steps or fewer repeats",
        )
    return profile


def check_calibration(place: Place, request: CalibrateRequest) -> Iterable[str]:
    """Raise an error for an impossible calibration; return doubts."""
    import numpy as np

    from torquebench.bench.interlocks import check_torque_limit

    model_choices(request.models, request.parameters)
    for side in chosen_sides(request.side):
        module = place.station.description.module(side)
        profile = _profile(place, request, side)
        for step in profile.staircase(module.range_nm, np.random.default_rng(0)):
            check_torque_limit(side, step.nominal_nm, module.limits.torque_nm)
    return tuple(campaign.doubts_before(place.station, place.registry, campaign.CALIBRATOR))


def preview_calibration(place: Place, request: CalibrateRequest) -> Preview:
    """Rehearse the plan of the calibration; a mounted calibrator has to read zero at rest."""
    from torquebench.campaign.measuring import standard_at_rest

    station, previews = place.station, []
    for side in chosen_sides(request.side):
        standard_at_rest(station, side, "calibrator")
        profile = _profile(place, request, side)
        rehearsal = procedures.rehearse(
            station.devices, procedures.calibrate(station.devices, side, profile)
        )
        title = Message("Calibrate the {side} module", side)
        previews.append(loading_preview(title, station.description, side, profile, rehearsal))
    return joined_previews(previews, calibrate_title(request))


def run_calibration(
    place: Place, request: CalibrateRequest, progress: Progress
) -> CalibrationResult:
    """Measure, fit and register; put the first model into use."""
    choices = model_choices(request.models, request.parameters)
    active = _active(place, choices, request.activate)
    known = campaign.registers_calibration(choices, active)
    modules = []
    for side in chosen_sides(request.side):
        profile = _profile(place, request, side)
        measured = campaign.measure_calibration(
            place.station,
            side,
            profile,
            **place.run_options(progress, request.mounting, known),
        )
        place.check()
        finished = campaign.CALIBRATION.evaluate_and_register(place.registry, measured, progress)
        modules.append(calibrated_module(finished))
    return CalibrationResult(**calibration_result(modules, ()))


def _active(place: Place, choices: Sequence[campaign.ModelChoice], activate: bool) -> str | None:
    """Return the name of the model to activate; None if the person may not activate models."""
    return choices[0].name if activate and choices and place.may("metrologist") else None


def calibrate_title(request: CalibrateRequest) -> str:
    """Return the title of a request."""
    if request.side == "both":
        return "Calibrate both modules"
    return Message("Calibrate the {side} module", request.side)


# -- resume, finish, discard ----------------------------------------------------------------


def check_resumption(place: Place, request: ResumeRequest) -> Iterable[str]:
    """Raise an error if the run can't be resumed; return remarks about doubtful conditions."""
    model_choices(request.models or ())
    run = campaign.find_interrupted(place.registry, request.run_id)
    if not _measured_completely(place.registry, run):
        campaign.read_interrupted(place.registry, run)
    return tuple(campaign.doubts_before(place.station, place.registry, campaign.CALIBRATOR))


def _measured_completely(registry: records.Registry, run: records.RunSummary) -> bool:
    """Return whether a calibration's points were all measured, but it isn't registered."""
    return run.status == "completed" and registry.calibration_of_run(run.run_id) is None


def run_resumption(place: Place, request: ResumeRequest, progress: Progress) -> CalibrationResult:
    """Resume an interrupted calibration at its interrupted series, then fit and register.

    If all points were measured, the calibration is only registered.
    """
    from torquebench.procedures.staircase import describe_step

    registry = place.registry
    run = campaign.find_interrupted(registry, request.run_id)
    if _measured_completely(registry, run):
        unfinished = campaign.find_unfinished(registry, run.run_id)
        finished = campaign.finish_recorded_run(registry, unfinished, progress).calibration
        assert finished is not None
        remark = Message("all points of {run} were measured already", run.run_id)
        return CalibrationResult(**calibration_result([calibrated_module(finished)], [remark]))
    interrupted = campaign.read_interrupted(registry, run)
    choices, active = interrupted.choices
    if request.models:
        choices = model_choices(request.models)
        active = _active(place, choices, request.activate)
    active = active if request.activate else None
    known = campaign.registers_calibration(choices, active)
    measured = campaign.resume_calibration(
        place.station,
        interrupted,
        **place.run_options(progress, request.mounting, known),
    )
    place.check()
    finished = campaign.CALIBRATION.evaluate_and_register(registry, measured, progress)
    module = calibrated_module(finished)
    remarks = [
        Message(
            "{kept} points of {run} were kept, {count} were measured again from series {series} on",
            len(interrupted.kept),
            interrupted.run_ids[-1],
            interrupted.repeated,
            interrupted.series,
        )
    ]
    if interrupted.damaged:
        steps = Message.joined((describe_step(step) for step in interrupted.damaged), "; ")
        remarks.append(
            Message(
                "the record of these points was damaged, they were measured again: {steps}", steps
            )
        )
    return CalibrationResult(**calibration_result([module], remarks))


def interrupted_bench(registry: records.Registry, request: ResumeRequest) -> BenchDescription:
    """Return the description of the bench on which the interrupted run was measured."""
    from torquebench.bench.description import BenchDescription
    from torquebench.validation import validated

    run = campaign.find_interrupted(registry, request.run_id)
    described = records.RunFolder.open(run.folder).metadata["bench"]
    return validated(BenchDescription, described, Message("the bench of run {run}", run.run_id))


def run_finish(place: Place, request: FinishRequest, progress: Progress) -> FinishedRuns:
    """Register the results of runs as their operations would have done."""
    registry, remaining = place.registry, []
    if request.run_id is None:
        runs = records.unfinished_runs(registry)
        never = (records.RunState.INTERRUPTED, records.RunState.COPY)
        remaining = [run for run in runs if run.state in never]
    else:
        runs = (campaign.find_unfinished(registry, request.run_id),)
    finished = [
        campaign.finish_recorded_run(registry, run, progress)
        for run in runs
        if run not in remaining
    ]
    modules = [
        calibrated_module(each.calibration) for each in finished if each.calibration is not None
    ]
    sentences = [Message("{sentence}.", each.sentence) for each in finished]
    result = calibration_result(
        modules, [Message("{found}: {remedy}", run.found, run.remedy) for run in remaining]
    )
    runs_simulated = (registry.run(each.run_id).simulated for each in finished)
    return FinishedRuns(
        **result
        | {
            "headline": Message.joined(sentences, " ") or _none_to_finish(remaining),
            "simulated": any(runs_simulated),
            "run_ids": tuple(each.run_id for each in finished),
        },
        unfinished=tuple(run.run_id for run in remaining),
    )


def _none_to_finish(remaining: Sequence[records.UnfinishedRun]) -> str:
    return "No run can be finished." if remaining else "Every run is finished."


def run_discard(place: Place, request: DiscardRequest, _progress: Progress) -> Result:
    """Register the discarding of a run with its reason."""
    run = campaign.find_unfinished(place.registry, request.run_id)
    campaign.discard_run(
        place.registry,
        run,
        by=place.operator,
        reason=request.reason,
        signature=place.signature,
    )
    return Result(
        headline=Message("run {run} is discarded.", run.run_id),
        simulated=place.registry.run(run.run_id).simulated,
        run_ids=(run.run_id,),
    )


def check_unfinished(place: Place, request: FinishRequest | DiscardRequest) -> Iterable[str]:
    """Raise an error if the run isn't unfinished."""
    if request.run_id is not None:
        campaign.find_unfinished(place.registry, request.run_id)
    return ()


CALIBRATE = Operation(
    "calibrate",
    CalibrateRequest,
    run_calibration,
    calibrate_title,
    preview_calibration,
    check_calibration,
    where="bench",
    moves=True,
    loads=True,
    can_pause=True,
    activates=True,
)
RESUME = Operation(
    "resume",
    ResumeRequest,
    run_resumption,
    lambda request: Message("Resume {run}", request.run_id),
    check=check_resumption,
    bench=interrupted_bench,
    where="bench",
    moves=True,
    loads=True,
    can_pause=True,
    activates=True,
)
FINISH = Operation(
    "records finish",
    FinishRequest,
    run_finish,
    lambda request: Message("Finish {run_id}", request.run_id or "every run"),
    check=check_unfinished,
    exclusive=True,
    activates=True,
)
DISCARD = Operation(
    "records discard",
    DiscardRequest,
    run_discard,
    lambda request: Message("Discard {run_id}", request.run_id),
    check=check_unfinished,
    exclusive=True,
    role="metrologist",
)
