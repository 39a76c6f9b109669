"""Zero, the daily check, and the verification of models at fresh points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from torquebench import calibration, campaign, chain, procedures, records
from torquebench.bench.roles import SIDE_TITLES, SIDES, Side
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.operations.operation import (
    WHOLE,
    CalibrationNumber,
    Flag,
    ModelNumber,
    MountedRequest,
    Name,
    Operation,
    Request,
    Tolerance,
    field,
)
from torquebench.operations.place import Place
from torquebench.operations.preview import Preview, loading_preview
from torquebench.operations.result import Integers, Numbers, Result
from torquebench.progress import Progress
from torquebench.reports.page import Block, Diagram, Facts, Page, Section, Table

RAW = "raw"
DEFAULT_TOLERANCE = 0.1
"""Tolerance of records without a stated one, % of full scale."""


class ZeroRequest(Request):
    """Measure the zeros of the unloaded bench."""

    sides: Annotated[
        tuple[Side, ...],
        field("Which modules.", title="Modules", argument=True, min_length=1, max_length=2),
    ] = SIDES


class CheckRequest(Request):
    """Check a module against the check standard: zero, a few steps, verdict with guard band.

    The verdict is registered and enters the control chart of the module's drift.
    """

    side: Annotated[Side, field("Which module.", title="Module", argument=True)]
    tolerance_percent_fs: Tolerance = 0.1
    profile: Annotated[
        Name, field("Steps to check.", choices="profiles:steps", examples=("check",))
    ] = "check"


class VerificationRequest(MountedRequest):
    """Verify models of a module at fresh points against the verification standard, in groups.

    Every group loads up and down in both directions, between the steps of the calibration. Several
    models are compared on the same readings; the verdict is that of the first.
    """

    basic = ("side", "models", "calibration", "groups", "points", "tolerance_percent_fs")

    side: Annotated[Side, field("Which module.", title="Module", argument=True)]
    models: Annotated[
        tuple[ModelNumber, ...],
        field("A registered model; without it the one in use. May be repeated.", max_length=20),
    ] = ()
    calibration: Annotated[
        CalibrationNumber | None, field("All models of this calibration, instead.")
    ] = None
    groups: Annotated[int, field("How many groups.", ge=1, le=1000), WHOLE] = 10
    points: Annotated[int, field("Points of each group.", ge=4, le=10_000), WHOLE] = 50
    tolerance_percent_fs: Tolerance = 0.1
    same_points: Annotated[Flag, field("The same torques in every group.")] = False
    seed: Annotated[
        Annotated[int, Field(ge=0, le=2**32 - 1), WHOLE] | None,
        field("Seed of the random points; without it, new points each time."),
    ] = None
    profile: Annotated[Name, field("Profile of random points.", choices="profiles:random")] = (
        "verification"
    )


# -- zero -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class ZeroOfSide:
    """The zero of one side in the unit of its signal, and its deviation from the nominal zero."""

    signal: float
    unit: str
    zero_nm: float


@dataclass(frozen=True, kw_only=True)
class ZeroResult(Result):
    """The measured zeros; null for a side that wasn't requested."""

    input: ZeroOfSide | None
    output: ZeroOfSide | None

    def page(self) -> Page:
        """Return its description."""
        sides = (("input", self.input), ("output", self.output))
        rows = [
            (side, f"{zero.signal:.8g} {zero.unit}", f"{zero.zero_nm:+.4g}")
            for side, zero in sides
            if zero is not None
        ]
        table = Table(("module", "signal", "difference from the nominal zero, N·m"), rows)
        run = Facts([("Run", self.run_ids[0])])
        return Page("Zero", "", [Section("", "", [table, run])], simulated=self.simulated)


def run_zero(place: Place, request: ZeroRequest, progress: Progress) -> ZeroResult:
    """Zero the modules, and register the zeros for the control charts of drift."""
    station = place.station
    sides = tuple(dict.fromkeys(request.sides))
    record = campaign.measure(
        station,
        lambda: procedures.zero_modules(station.devices, sides),
        kind="zero",
        title="Zeroing",
        **place.run_options(progress),
    ).record
    zeros: dict[Side, ZeroOfSide] = {}
    for side in sides:
        transducer = station.description.module(side).transducer
        signal, scale = record.result[side].signal, transducer.scale()
        away_nm = (signal - scale.nominal_zero) / transducer.nominal_sensitivity
        zeros[side] = ZeroOfSide(signal, scale.unit, away_nm)
    words = Message.joined(
        Message("{side} {zero_nm:+.3g} N·m", side, zeros[side].zero_nm) for side in sides
    )
    return ZeroResult(
        headline=Message("Zero measured; difference from the nominal zero: {sides}.", words),
        simulated=station.description.simulated,
        run_ids=(record.run_id,),
        input=zeros.get("input"),
        output=zeros.get("output"),
    )


# -- check ----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class CheckedModule(Result):
    """Result of a check against the check standard: each point with its verdict."""

    side: Side
    range_nm: float
    transducer_serial: str
    model_id: int | None
    tolerance_percent_fs: float
    worst_percent_fs: float
    standard_nm: Numbers
    error_nm: Numbers
    expanded_uncertainty_nm: Numbers
    verdicts: Sequence[str]
    not_in_u: Sequence[str]

    def page(self) -> Page:
        """Return its description."""
        from torquebench.uncertainty import Verdict

        model = "without compensation" if self.model_id is None else f"model-{self.model_id}"
        rows = [
            (
                f"{standard:.2f}",
                f"{error:+.4f}",
                f"{100 * error / self.range_nm:+.4f}",
                f"{expanded:.4f}",
                Verdict(verdict).label,
            )
            for standard, error, expanded, verdict in zip(
                self.standard_nm,
                self.error_nm,
                self.expanded_uncertainty_nm,
                self.verdicts,
                strict=True,
            )
        ]
        header = ("standard, N·m", "error, N·m", "% FS", "U, N·m", "verdict")
        caption = "U of an error: U of the torque by its measuring chain, and the check standard."
        facts = [
            ("Transducer", self.transducer_serial),
            ("Compensation", model),
            ("Run", self.run_ids[0]),
        ]
        blocks: list[Block] = [Facts(facts), Table(header, rows, caption)]
        heading = Message("{side}, {range_nm:g} N·m", SIDE_TITLES[self.side], self.range_nm)
        section = Section(heading, chain.not_in_u(self.not_in_u) or "", blocks)
        return Page("Check", "", [section], simulated=self.simulated)


def check_check(place: Place, request: CheckRequest) -> Iterable[str]:
    """Raise an error if the profile doesn't exist; return doubts."""
    place.library.profile(request.profile)
    return tuple(
        campaign.doubts_before(place.station, place.registry, campaign.VERIFICATION_STANDARD)
    )


def preview_check(place: Place, request: CheckRequest) -> Preview:
    """Rehearse a daily check."""
    station, profile = place.station, place.library.profile(request.profile)
    steps = profile.staircase(station.description.module(request.side).range_nm)
    plan = procedures.verify(station.devices, request.side, profile, steps)
    rehearsal = procedures.rehearse(station.devices, plan)
    title = check_title(request)
    return loading_preview(title, station.description, request.side, profile, rehearsal)


def run_check(place: Place, request: CheckRequest, progress: Progress) -> CheckedModule:
    """Load a few steps against the check standard, and register the verdict."""
    check = campaign.check_module(
        place.station,
        request.side,
        place.library.profile(request.profile),
        request.tolerance_percent_fs,
        **place.run_options(progress),
    )
    return CheckedModule(
        headline=Message(
            "worst {value:+.3g} % FS, tolerance ±{tolerance:g} % FS, guard band w = U.",
            check.worst_percent_fs,
            request.tolerance_percent_fs,
        ),
        verdict=check.verdict.value,
        simulated=check.data.simulated,
        run_ids=(check.run_id,),
        side=request.side,
        range_nm=check.data.range_nm,
        transducer_serial=check.data.transducer_serial,
        model_id=None if check.model is None else check.model.model_id,
        tolerance_percent_fs=request.tolerance_percent_fs,
        worst_percent_fs=check.worst_percent_fs,
        standard_nm=check.data.standard_nm,
        error_nm=check.error_nm,
        expanded_uncertainty_nm=check.expanded_uncertainty_nm,
        verdicts=[decision.verdict.value for decision in check.judged.decisions],
        not_in_u=check.judged.missing,
    )


def check_title(request: CheckRequest) -> str:
    """Return the title of a request."""
    return Message("Check the {side} module", request.side)


# -- verification ---------------------------------------------------------------------------


@dataclass(frozen=True)
class VerifiedModel:
    """Errors of a model, or of the raw reading, at fresh points.

    Parameters
    ----------
    model_id : int or None
        Number of the model; None for the raw reading.
    title : str
    verdict : str
        The worst verdict of all points, with the guard band w = U.
    errors : ModelVerification
    torque_nm, expanded_uncertainty_nm : array
        Torque and U at each point, in N·m; U contains the standard's.
    not_in_u : sequence of str
        Influences that U doesn't contain.
    """

    model_id: int | None
    title: str
    verdict: str
    errors: calibration.ModelVerification
    torque_nm: Numbers
    expanded_uncertainty_nm: Numbers
    not_in_u: Sequence[str]

    @property
    def name(self) -> str:
        """Number and kind, for tables and legends."""
        if self.model_id is None:
            return self.title
        return Message("model-{number}: {title}", self.model_id, self.title)


@dataclass(frozen=True, kw_only=True)
class VerifiedModule(Result):
    """Models at fresh points: first the raw reading, then the model that determines the verdict."""

    side: str
    range_nm: float
    transducer_serial: str
    tolerance_percent_fs: float
    groups: int
    same_points: bool
    seed: int | None
    standard_nm: Numbers
    group: Integers
    models: tuple[VerifiedModel, ...]
    repeatability_met: bool | None

    @property
    def failed(self) -> bool:
        """Whether the first model's error or repeatability exceeds the tolerance."""
        return super().failed or self.repeatability_met is False

    @property
    def best(self) -> VerifiedModel:
        """The model with the smallest error."""
        return min(self.models[1:], key=lambda each: each.errors.against_standard.worst_nm)

    def page(self) -> Page:
        """Return its description."""
        words = Message("{count} readings in {groups} groups", len(self.standard_nm), self.groups)
        facts = [
            ("Transducer", self.transducer_serial),
            ("Points", words),
            (
                "Torques of the points",
                "the same in every group" if self.same_points else "new in every group",
            ),
            ("Run", self.run_ids[0]),
        ]
        heading = Message("{side}, {range_nm:g} N·m", SIDE_TITLES[self.side], self.range_nm)
        missing = chain.not_in_u(self.models[1].not_in_u) or ""
        return Page(
            Message("Verification of the {side} module", self.side),
            "",
            [
                Section(
                    heading, missing, [Facts(facts), *_errors(self, ERRORS[:1]), _verdicts(self)]
                ),
                Section(
                    "Errors", "", [errors_diagram(self), *_errors(self, ERRORS[1:])], detail=True
                ),
                Section("Groups", "", [_groups(self), _group_diagram(self)], detail=True),
            ],
            simulated=self.simulated,
        )


ERRORS = (
    ("Single readings against the standard.", "against_standard"),
    ("Single readings against the true torque.", "against_truth"),
    ("Averaged over the groups.", "averaged"),
)


def _errors(result: VerifiedModule, kinds: Sequence[tuple[str, str]]) -> list[Block]:
    from torquebench.reports.errors_table import errors_table

    tables: list[Block] = []
    for words, name in kinds:
        rows = [(each.name, getattr(each.errors, name)) for each in result.models]
        if all(summary is not None for _, summary in rows):
            tables.append(errors_table(rows, words, 1))
    return tables


def _verdicts(result: VerifiedModule) -> Table:
    from torquebench.reports.errors_table import number
    from torquebench.uncertainty import Verdict

    limit = result.tolerance_percent_fs
    rows = []
    for each in result.models:
        spread = each.errors.repeatability
        percent = None if spread is None else spread.worst_percent_fs
        rows.append(
            (
                each.name,
                Verdict(each.verdict).label,
                number(None if spread is None else spread.worst_nm),
                number(percent),
                "–" if percent is None else "yes" if percent <= limit else "no",
            )
        )
    header = ("", "verdict", "repeatability, N·m", "% FS", "kept")
    rule = next((each.errors.repeatability.rule for each in result.models
                 if each.errors.repeatability is not None), "")  # fmt: skip
    caption = Message(
        "Tolerance {limit:g} % FS of error, with guard band w = U, and of repeatability{rule}.",
        limit,
        Message(": {rule}", rule) if rule else "",
    )
    return Table(header, rows, caption, 1)


def _groups(result: VerifiedModule) -> Table:
    from torquebench.reports.errors_table import number

    models = result.models
    rows = [
        (str(number_ + 1), *(number(each.errors.groups[number_].worst_nm) for each in models))
        for number_ in range(result.groups)
    ]
    header = ("group", *(Message("{name}, N·m", each.name) for each in models))
    return Table(header, rows, "Worst single reading of each group.")


def errors_diagram(result: VerifiedModule) -> Diagram:
    """Return the errors of the raw reading and of each model over the torque."""
    from torquebench.figures import Curve
    from torquebench.reports.curve_figures import Panel

    limit = result.tolerance_percent_fs / 100.0 * result.range_nm
    curves = [
        Curve(
            each.name,
            result.standard_nm,
            each.torque_nm - result.standard_nm,
            raw=each.model_id is None,
        )
        for each in result.models
    ]
    axes: dict[str, Any] = {"markers": True, "range_nm": result.range_nm, "side": result.side}
    panels = [
        Panel(curves[:1], "torque in N·m", "error in N·m", **axes),
        Panel(curves[1:], "torque in N·m", "error in N·m", limits=(-limit, limit), **axes),
    ]
    caption = Message(
        "Errors of the fresh readings before and after compensation, against the standard. "
        "Dashed: ±{limit:g} % FS.",
        result.tolerance_percent_fs,
    )
    return Diagram(panels, caption, height=2.2)


def _group_diagram(result: VerifiedModule) -> Diagram:
    import numpy as np

    from torquebench.figures import Curve
    from torquebench.reports.curve_figures import Panel

    numbers = np.arange(1.0, result.groups + 1.0)
    curves = [
        Curve(each.name, numbers, np.array([group.worst_nm for group in each.errors.groups]))
        for each in result.models[1:]
    ]
    limit = result.tolerance_percent_fs / 100.0 * result.range_nm
    panel = Panel(curves, "group", "worst error in N·m", limits=(limit,), range_nm=result.range_nm)
    return Diagram([panel], "Worst single reading of each group.")


def models_of(
    registry: records.Registry, entry: records.CalibrationEntry
) -> dict[str, records.ModelEntry]:
    """Return the registered models of a calibration by name."""
    found = registry.models(entry.transducer_serial, calibration_id=entry.calibration_id)
    return {f"model-{model.model_id}": model for model in reversed(found)}


def _entries(place: Place, request: VerificationRequest) -> dict[str, records.ModelEntry]:
    """Return the models to be verified, by name; each must belong to this module."""
    registry, description = place.registry, place.station.description
    transducer = description.module(request.side).transducer.serial
    if request.calibration is not None:
        entries = models_of(registry, registry.calibration(request.calibration))
        if not entries:
            raise RecordError(
                Message("calibration {number} has no model", request.calibration), "a fitted model"
            )
    elif request.models:
        entries = {f"model-{number}": registry.model(number) for number in request.models}
    else:
        counter = place.station.drivers.counter.clock_identity
        active = registry.active_model(transducer, counter)
        if active is None:
            raise InputError(
                Message(
                    "no model in use of transducer {transducer} with counter {counter}",
                    transducer,
                    counter,
                ),
                "a calibrated module",
                Message("calibrate the {side} module, or name a model", request.side),
            )
        entries = {f"model-{active.model_id}": active}
    for name, entry in entries.items():
        if entry.transducer_serial != transducer:
            raise InputError(
                Message("{name} of transducer {transducer}", name, entry.transducer_serial),
                Message("models of transducer {transducer}", transducer),
                "choose its module",
            )
    return entries


def _verification_profile(
    place: Place, request: VerificationRequest, entries: Mapping[str, records.ModelEntry]
) -> calibration.Profile:
    """Return the profile, limited to the calibrated torque."""
    profile = place.library.profile(request.profile).with_options(
        groups=request.groups, points=request.points, same_points=request.same_points or None
    )
    if profile.loading.pattern != "random":
        raise InputError(
            Message("profile {name} for a verification", profile.name), "a profile of random points"
        )
    calibrated = min(chain.load_chain(e.check_file()).model.calibrated_nm for e in entries.values())
    range_nm = place.station.description.module(request.side).range_nm
    return profile.within(100.0 * calibrated / range_nm)


def check_verification(place: Place, request: VerificationRequest) -> Iterable[str]:
    """Raise an error for unknown models or models of another module; return remarks."""
    _verification_profile(place, request, _entries(place, request))
    return tuple(
        campaign.doubts_before(place.station, place.registry, campaign.VERIFICATION_STANDARD)
    )


def preview_verification(place: Place, request: VerificationRequest) -> Preview:
    """Rehearse a verification; an arbitrary seed draws the points."""
    import numpy as np

    station, side = place.station, request.side
    profile = _verification_profile(place, request, _entries(place, request))
    range_nm = station.description.module(side).range_nm
    steps = profile.staircase(range_nm, np.random.default_rng(request.seed or 0))
    rehearsal = procedures.rehearse(
        station.devices, procedures.verify(station.devices, side, profile, steps)
    )
    title = verification_title(request)
    return loading_preview(title, station.description, side, profile, rehearsal, steps)


def run_verification(
    place: Place, request: VerificationRequest, progress: Progress
) -> VerifiedModule:
    """Measure fresh points, evaluate every model and register the results."""
    entries = _entries(place, request)
    verified = campaign.verify_on_bench(
        place.station,
        request.side,
        _verification_profile(place, request, entries),
        entries,
        request.seed,
        **place.run_options(
            progress,
            request.mounting,
            {
                "tolerance_percent_fs": request.tolerance_percent_fs,
                "same_points": request.same_points,
            },
        ),
    )
    record = verified.measured.record
    return verified_module(
        record.metadata,
        verified.chains,
        verified.measured.result.data,
        verified.result,
        run_id=record.run_id,
    )


def stored_verification(registry: records.Registry, number: int) -> VerifiedModule | None:
    """Return the last verification of a calibration's models; None before the first.

    Raises
    ------
    RecordError
        The calibration isn't registered, or its records were changed.
    """
    entries = models_of(registry, registry.calibration(number))
    verifications = [
        (verification, name)
        for name, entry in entries.items()
        for verification in registry.verifications(entry.model_id)
        if verification.run_id is not None
    ]
    if not verifications:
        return None
    run_id = str(max((each for each, _ in verifications), key=lambda each: each.performed).run_id)
    folder = records.RunFolder(registry.run(run_id).folder)
    data, metadata = campaign.run_data(folder), folder.metadata
    chains = {
        name: campaign.used_chain(entries[name], metadata, data)
        for verification, name in verifications
        if verification.run_id == run_id
    }
    return verified_module(
        metadata,
        chains,
        data,
        calibration.verify(data, chains),
        run_id=run_id,
    )


def verified_module(
    metadata: Mapping[str, Any],
    chains: Mapping[str, chain.MeasuringChain],
    data: calibration.CalibrationData,
    result: calibration.VerificationResult,
    *,
    run_id: str,
) -> VerifiedModule:
    """Evaluate every model at the points of a verification, with the metadata of its run.

    Parameters
    ----------
    metadata : mapping
        Metadata of the run.
    chains : mapping of str to MeasuringChain
        Chains by "model-N"; the verdict is that of the first.
    data : CalibrationData
        The fresh points.
    result : VerificationResult
    """
    tolerance_percent_fs = float(metadata.get("tolerance_percent_fs", DEFAULT_TOLERANCE))
    standard = campaign.check_standard(metadata, data)
    models = []
    for name in (RAW, *chains):
        used = chains.get(name)
        judged = campaign.judge_check(
            data, used, standard=standard, tolerance_percent_fs=tolerance_percent_fs
        )
        curve = None if used is None else used.model
        title = RAW if curve is None else curve.kind
        models.append(
            VerifiedModel(
                model_id=None if used is None else int(name.removeprefix("model-")),
                title=campaign.model_title(title, {} if curve is None else curve.kind_parameters),
                verdict=judged.verdict.value,
                errors=result.of(name),
                torque_nm=judged.torque.value_nm,
                expanded_uncertainty_nm=judged.torque.expanded_uncertainty_nm,
                not_in_u=judged.missing,
            )
        )
    first = models[1]
    spread, worst = first.errors.repeatability, first.errors.against_standard
    met = None if spread is None else spread.worst_percent_fs <= tolerance_percent_fs
    return VerifiedModule(
        headline=Message(
            "{count} fresh points: {title} is within {worst_nm:.3g} N·m "
            "({worst_percent_fs:.3g} % FS){repeatability}.",
            len(data),
            first.title,
            worst.worst_nm,
            worst.worst_percent_fs,
            "; its repeatability exceeds the tolerance" if met is False else "",
        ),
        verdict=first.verdict,
        simulated=data.simulated,
        run_ids=(run_id,),
        side=data.side,
        range_nm=data.range_nm,
        transducer_serial=data.transducer_serial,
        tolerance_percent_fs=tolerance_percent_fs,
        groups=result.groups,
        same_points=bool(metadata.get("same_points")),
        seed=metadata.get("seed"),
        standard_nm=data.standard_nm,
        group=data.series,
        models=tuple(models),
        repeatability_met=met,
    )


def verification_title(request: VerificationRequest) -> str:
    """Return the title of a request."""
    return Message("Verify the {side} module", request.side)


ZERO = Operation(
    "zero", ZeroRequest, run_zero, lambda _request: "Zeroing", where="bench", moves=True
)
CHECK = Operation(
    "check",
    CheckRequest,
    run_check,
    check_title,
    preview_check,
    check_check,
    where="bench",
    moves=True,
    loads=True,
    can_pause=True,
)
VERIFICATION = Operation(
    "verification",
    VerificationRequest,
    run_verification,
    verification_title,
    preview_verification,
    check_verification,
    where="bench",
    moves=True,
    loads=True,
    can_pause=True,
)
