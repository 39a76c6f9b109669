"""Fit compensation models to a calibration, and describe each of them."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from torquebench import __version__
from torquebench.atomic_write import private_folder
from torquebench.calibration import (
    CalibrationData,
    Contradiction,
    Examination,
    Plausibility,
    examine_table,
    find_contradictions,
    rows_in_words,
    summarise_errors,
    tare,
)
from torquebench.calibration.plausibility import contradiction_of
from torquebench.campaign.chains import mounting_effect, step_noise
from torquebench.campaign.results import FitResult
from torquebench.chain import Effect, MeasuringChain
from torquebench.compensation import (
    CANDIDATES,
    FEATURES,
    RECOMMENDED,
    Comparison,
    CompensationModel,
    Provenance,
    StoredModel,
    compare,
    load_model,
    make_model,
    save_model,
    worse_than_raw,
)
from torquebench.compensation.kinds import NETWORKS
from torquebench.errors import InputError, ModelMismatchError, RecordError, TorquebenchError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, SHARES, Part, Progress

if TYPE_CHECKING:
    from torquebench.records import ModelEntry, Registry

__all__ = [
    "CHOSEN_ELSEWHERE",
    "FittedModel",
    "ModelChoice",
    "described_model",
    "entry_in_use",
    "feature_columns",
    "few_points",
    "fit_metrics",
    "fit_models",
    "fit_table",
    "model_in_use",
    "model_title",
    "remarks_on",
    "store_model",
    "table_metrics",
]

_TITLES = {
    "bayesian-network": "network, Bayesian",
    "hybrid": "physics + Gaussian process",
    "polynomial": "polynomial, degree {degree}",
    "published-network": "network, gradient descent",
    "radial-basis": "radial basis functions",
    "raw": "raw reading",
}

CHOSEN_ELSEWHERE = ("range_nm", "range_margin", "outliers", "zeroed")
"""Parameters that are estimated from the data, or have command options of their own."""


def model_title(kind: str, parameters: Mapping[str, Any] | None = None) -> str:
    """Return a short title for a kind of model in tables and legends; for others its name.

    Examples
    --------
    >>> model_title("polynomial", {"degree": 2}), model_title("polynomial-3")
    ('polynomial, degree 2', 'polynomial, degree 3')
    >>> model_title("raw"), model_title("polynomial"), model_title("of-a-plugin")
    ('raw reading', 'polynomial', 'of-a-plugin')
    """
    stem, _, degree = kind.rpartition("-")
    if stem == "polynomial" and degree.isdigit():
        kind, parameters = stem, {"degree": degree}
    if kind == "network" and parameters:
        kind = next(
            name for name, training in NETWORKS.items() if training == parameters["training"]
        )
    title = _TITLES.get(kind, kind)
    if kind != "polynomial":
        return title
    stated = (parameters or {}).get("degree")
    return kind if stated is None else Message(title, stated)


@dataclass(frozen=True)
class ModelChoice:
    """A model to be fitted: its kind and parameters.

    Parameters
    ----------
    name : str
        Name of the kind for `make_model` and in results ("polynomial-2").
    parameters : mapping
        Parameters except the range, which comes from the data.
    rising_only : bool
        Whether to fit to the rising points only, as in the source papers.
    """

    name: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    rising_only: bool = False

    @property
    def specification(self) -> dict[str, Any]:
        """Fields for a run's record; `ModelChoice(**specification)` restores the choice."""
        return {
            "name": self.name,
            "parameters": dict(self.parameters),
            "rising_only": self.rising_only,
        }

    def check(self) -> None:
        """Raise InputError for an unknown kind, an unknown parameter or a value that isn't allowed.

        Examples
        --------
        >>> ModelChoice("published-network", {"hidden": 0}).check()
        Traceback (most recent call last):
        ...
        torquebench.errors.InputError: hidden = 0 of NetworkModel; allowed: an int in ...
        """
        for name in CHOSEN_ELSEWHERE:
            if name in self.parameters:
                raise InputError(Message("parameter {name}", name), "parameters of the model alone")
        make_model(self.name, **self.parameters).check_parameters()

    def points(self, data: CalibrationData) -> CalibrationData:
        """Return the points of a calibration that the model is fitted to."""
        return data.subset(data.branch > 0) if self.rising_only else data


@dataclass(frozen=True)
class FittedModel:
    """A model fitted to all points of a calibration.

    Parameters
    ----------
    name, title : str
        Name of the choice, and the kind in words.
    model : CompensationModel
        Fitted.
    seconds : float
        Duration of the fit, s.
    remarks : tuple of str
        Warnings of the fit: outliers, averaged points.
    effects : tuple of Effect
        Other effects of the measuring chain.
    contradictions : tuple of Contradiction
        Contradictions of the points, because of which the model must not be used; empty if
        plausible.
    choice : ModelChoice or None
        The request.
    calibrated_on : datetime.date or None
        Day of the calibration.
    """

    name: str
    title: str
    model: CompensationModel
    seconds: float
    remarks: tuple[str, ...]
    effects: tuple[Effect, ...] = ()
    contradictions: tuple[Contradiction, ...] = ()
    choice: ModelChoice | None = None
    calibrated_on: date | None = None

    @cached_property
    def chain(self) -> MeasuringChain:
        """The measuring chain with this model."""
        return MeasuringChain(self.model, self.effects, self.calibrated_on)


def feature_columns(model: CompensationModel) -> int:
    """Return the number of leading columns of `FEATURES` that a model uses.

    A model is fitted to these only, so that readings don't need unused columns.

    Examples
    --------
    >>> feature_columns(make_model("polynomial"))
    1
    """
    return 1 + max(FEATURES.index(name) for name in model.used_features)


def fit_models(
    data: CalibrationData,
    choices: Sequence[ModelChoice],
    progress: Progress = NO_PROGRESS,
    title: str = "Fitting models",
    effects: tuple[Effect, ...] = (),
    *,
    limits: Plausibility | None = None,
    before: ModelInUse | None = None,
) -> list[FittedModel]:
    """Fit every chosen model to a calibration, and find the contradictions of the points.

    A single row that disagrees with all others is left out. If parts of the table contradict each
    other, all points are kept, because it isn't known which of them are wrong.

    Parameters
    ----------
    progress : Progress
        Receives a stage of 100 steps for each model.
    title : str
        Title of that stage.
    effects : tuple of Effect
        Other effects of the measuring chain; that of its mounting follows from the points.
    limits : Plausibility, optional
        Plausibility limits of the calibration profile.
    before : ModelInUse, optional
        See `model_in_use`.

    Returns
    -------
    list of FittedModel
        In the order of the choices.

    Raises
    ------
    InputError
        An unknown kind or parameter, or points that a model refuses.
    """
    progress.start(title, SHARES * len(choices))
    fitted: list[FittedModel] = []
    effects = step_noise(data, (*effects, *mounting_effect(data)))
    data, examination = _examined(data)
    kept = _kept(data, examination, "downweight")
    before = before or ModelInUse()
    unread = (before.unreadable,) if before.unreadable else ()
    for choice in choices:
        settings = {"zeroed": data.tared, **choice.parameters, "outliers": "keep"}
        model = make_model(choice.name, range_nm=data.range_nm, **settings)
        words = model_title(model.kind, model.kind_parameters)
        part = Part(progress, SHARES * len(fitted))
        started = time.perf_counter()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            points = choice.points(kept)
            columns = points.features(feature_columns(model))
            model.fit(columns, points.standard_nm, progress=part)
        part.reach(SHARES)
        warned = (f"{words}: {entry.message}" for entry in caught)
        few = () if fitted else few_points(model, len(data))
        remarks = (*_remarks(data, kept, examination), *unread, *dict.fromkeys(warned), *few)
        seconds = time.perf_counter() - started
        fitted.append(
            FittedModel(
                choice.name,
                words,
                model,
                seconds,
                remarks,
                effects,
                _contradictions(data, examination, model, limits, before.model),
                choice,
                data.measured_on,
            )
        )
    progress.finish()
    return fitted


def entry_in_use(registry: Registry, serial: str, counter: str) -> ModelEntry | None:
    """Return a chain's active model, for comparison with a new calibration.

    None if no model is in use, or if the transducer was adjusted since its calibration.
    """
    try:
        entry = registry.active_model(serial, counter)
    except ModelMismatchError:
        return None
    if entry is None:
        return None
    performed = registry.calibration(entry.calibration_id).performed
    adjusted = any(adjustment.performed > performed for adjustment in registry.adjustments(serial))
    return None if adjusted else entry


@dataclass(frozen=True)
class ModelInUse:
    """A chain's model in use, for comparison with a new calibration.

    `unreadable` is the reason why a model that is in use can't be read.
    """

    model: CompensationModel | None = None
    unreadable: str = ""


def model_in_use(registry: Registry, data: CalibrationData) -> ModelInUse:
    """Return the model of `entry_in_use`, or the reason why its file can't be read."""
    entry = entry_in_use(registry, data.transducer_serial, data.counter_identity)
    if entry is None:
        return ModelInUse()
    try:
        return ModelInUse(load_model(entry.check_file()).model)
    except (InputError, RecordError) as error:
        return ModelInUse(unreadable=not_compared(error))


def not_compared(error: TorquebenchError) -> Message:
    """Return the remark that the model in use can't be read for a comparison."""
    return Message("not compared with the model in use, which can't be read: {reason}", error.found)


def _examined(data: CalibrationData) -> tuple[CalibrationData, Examination]:
    """Return the points to be fitted, tared if they agree only then, and their examination."""
    examination = examine_table(data)
    return (tare(data).data if examination.from_zeros else data), examination


def _kept(data: CalibrationData, examination: Examination, outliers: str) -> CalibrationData:
    """Return the points without single wrong rows; all points if parts contradict each other.

    A wrong row is an error if outliers are refused.
    """
    wrong = [] if examination.disagreements else examination.wrong_rows
    if not wrong or outliers == "keep":
        return data
    if outliers == "refuse":
        raise InputError(
            Message.joined(
                [_wrong_row(data, outlier.point, outlier.residual_nm) for outlier in wrong], "; "
            ),
            "rows that agree with the others",
            "measure the point again, leave it out, or choose `--outliers downweight`",
        )
    return data.subset(np.setdiff1d(np.arange(len(data)), [outlier.point for outlier in wrong]))


def _wrong_row(data: CalibrationData, point: int, residual_nm: float) -> Message:
    """Return a sentence about a row that the other rows don't predict."""
    return Message(
        "{row}: reading {reading:.6g} N·m, standard {standard:.6g} N·m, "
        "{residual:+.3g} N·m from the value that the other rows predict",
        rows_in_words(data, point),
        data.reading_nm[point],
        data.standard_nm[point],
        residual_nm,
    )


def remarks_on(data: CalibrationData) -> tuple[str, ...]:
    """Return the remarks of `fit_models` on a calibration's points, which hold for every model."""
    data, examination = _examined(data)
    return tuple(_remarks(data, _kept(data, examination, "downweight"), examination))


def _remarks(
    data: CalibrationData, points: CalibrationData, examination: Examination
) -> Iterator[str]:
    """Yield remarks on rows that were left out, and on doubtful rows."""
    if len(points) < len(data):
        for wrong_row in examination.wrong_rows:
            row = _wrong_row(data, wrong_row.point, wrong_row.residual_nm)
            yield Message("outlier, left out: {row}", row)
    if examination.from_zeros:
        yield Message(
            "the zero of each series was subtracted: only then do the points agree, "
            "and the model needs tared readings"
        )
    for part in examination.doubts:
        yield Message(
            "{found}; about one healthy table in ten shows such a part: check these rows",
            contradiction_of(data, part, examination).found,
        )


def few_points(model: CompensationModel, count: int) -> Iterator[str]:
    """Yield a remark if the points are too few to show noise that grows with the torque.

    The scatter of the inner and of the outer half of the points differ by chance up to the square
    root of Fisher's F for half of the degrees of freedom each (95 %): doubled noise doesn't show.
    """
    from scipy.special import fdtri  # imported late: a server at rest doesn't need SciPy

    half = max(0.5 * model.scatter_freedom, 1.0)
    factor = float(np.sqrt(fdtri(half, half, 0.975)))
    if factor > 2.0:
        yield Message(
            "{count} points can't tell whether noise grows with the torque: a factor of "
            "{factor:.2g} between small and large torque may not show, and U is then too small at "
            "full scale",
            count,
            factor,
        )


def _untared(data: CalibrationData, examination: Examination) -> Iterator[str]:
    """Yield a remark if a table wasn't tared, because the model then corrects the zero as well."""
    zero = max(tare(data).zeros_nm, key=abs, default=0.0)
    if zero and not abs(zero) <= 2.0 * examination.expanded_nm:
        yield Message(
            "without load the reading is {zero:+.4g} N·m: the model subtracts this "
            "zero, so it needs readings that aren't tared",
            zero,
        )


def _contradictions(
    data: CalibrationData,
    examination: Examination,
    model: CompensationModel,
    limits: Plausibility | None,
    before: CompensationModel | None,
) -> tuple[Contradiction, ...]:
    """Return what contradicts a fitted model: its data, plausibility and the model before."""
    torque = earlier = None
    if before is not None and feature_columns(before) <= COMPARED_COLUMNS:
        torque = np.full(len(data), np.nan)
        earlier = np.full(len(data), np.nan)
        for compared_model, values in ((model, torque), (before, earlier)):
            inside = (data.reading_nm >= compared_model.reading_low_nm_) & (
                data.reading_nm <= compared_model.reading_high_nm_
            )
            if np.any(inside):
                values[inside] = compared_model.predict(
                    data.features(compared_model.n_features_in_)[inside]
                )
    return find_contradictions(
        data, limits, examination=examination, torque_nm=torque, before_nm=earlier
    )


def fit_table(
    data: CalibrationData,
    source: str,
    name: str = RECOMMENDED,
    progress: Progress = NO_PROGRESS,
    outliers: str = "downweight",
    *,
    compared: bool = False,
    limits: Plausibility | None = None,
    parameters: Mapping[str, Any] | None = None,
) -> FitResult:
    """Fit a model to a table, with a comparison of all kinds if requested.

    Parameters
    ----------
    source : str
        Name of the table, for reports.
    name : str, optional
        Name of the model, as in `make_model`.
    progress : Progress
        Receives one stage, and a second one for the comparison.
    outliers : {"downweight", "refuse", "keep"}
        Treatment of single wrong rows: left out, refused, or kept. All are kept if parts of the
        table contradict each other.
    compared : bool, default False
        Whether to compare all kinds by cross-validation as well; that takes many fits.
    limits : Plausibility, optional
        Limits of size that a profile states.
    parameters : mapping, optional
        Of the model.

    Raises
    ------
    InputError
        An unknown model, points that it doesn't take, or an outlier that is to be refused.
    """
    data, examination = _examined(data)
    points = _kept(data, examination, outliers)
    settings = {"zeroed": data.tared, **(parameters or {})}
    model = make_model(name, **{**settings, "range_nm": data.range_nm, "outliers": "keep"})
    X = points.features(feature_columns(model))
    progress.start("Fitting the model", SHARES)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(X, points.standard_nm, progress=progress)
    progress.finish()
    comparison = _compared(points, name, progress) if compared else None
    behind: list[str] = []
    if comparison is not None:
        behind = [comparison.behind_raw(score.name) for score in comparison.scores]
    elif model.doubtful:
        progress.start("Leaving out steps", SHARES)
        behind = [worse_than_raw(name, model, X, points.standard_nm, progress=progress)]
        progress.finish()
    return FitResult(
        source=source,
        data=data,
        comparison=comparison,
        noise=points.noise_floor(),
        name=name,
        title=model_title(model.kind, model.kind_parameters),
        model=model,
        raw=summarise_errors(points.reading_nm, points.standard_nm, points.range_nm),
        fitted=summarise_errors(model.predict(X), points.standard_nm, points.range_nm),
        remarks=(
            *_remarks(data, points, examination),
            *_untared(data, examination),
            *few_points(model, len(points)),
            *filter(None, behind),
            *([comparison.caution] if comparison is not None and comparison.caution else []),
            *data.notes(),
            *dict.fromkeys(str(entry.message) for entry in caught),
        ),
        contradictions=_contradictions(data, examination, model, limits, None),
    )


def _compared(data: CalibrationData, name: str, progress: Progress) -> Comparison:
    """Compare the candidates and the named model at held-out points."""
    progress.start("Comparing models", SHARES)
    comparison = compare(
        data.features(COMPARED_COLUMNS),
        data.standard_nm,
        list(dict.fromkeys([*CANDIDATES, name])),
        range_nm=data.range_nm,
        outliers="keep",
        progress=progress,
    )
    progress.finish()
    return comparison


COMPARED_COLUMNS = 2
"""Number of columns (reading and branch) that every table has."""


def fit_metrics(fitted: FittedModel, data: CalibrationData) -> dict[str, float]:
    """Return the errors of a fit on its own points; names with their unit."""
    torque = fitted.model.predict(data.features(feature_columns(fitted.model)))
    errors = summarise_errors(torque, data.standard_nm, data.range_nm)
    return {
        "fit_worst_percent_fs": errors.worst_percent_fs,
        "fit_rms_percent_fs": errors.rms_percent_fs,
        "noise_nm": fitted.model.scatter_nm,
        "effective_parameters": float(fitted.model.effective_parameters_),
        "fit_seconds": fitted.seconds,
    }


def described_model(
    model: CompensationModel,
    data: CalibrationData,
    metrics: Mapping[str, float],
    effects: Sequence[Effect] = (),
    contradictions: Sequence[Contradiction] = (),
    accepted: str = "",
) -> StoredModel:
    """Return a model with its provenance: chain, points and software version.

    It contains contradictions of the calibration, and who accepted them.
    """
    return StoredModel(
        model,
        Provenance(
            range_nm=data.range_nm,
            side=data.side,
            transducer_serial=data.transducer_serial,
            counter_identity=data.counter_identity,
            training_data_sha256=data.sha256(),
            metrics=dict(metrics),
            software_version=__version__,
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            calibrated_on="" if data.measured_on is None else data.measured_on.isoformat(),
            reading_scale="" if data.scale is None else data.scale.text,
            effects=tuple(effect.specification() for effect in step_noise(data, effects)),
            contradictions=tuple(str(contradiction) for contradiction in contradictions),
            accepted=accepted,
        ),
    )


def store_model(
    path: Path,
    model: CompensationModel,
    data: CalibrationData,
    metrics: Mapping[str, float],
    effects: Sequence[Effect] = (),
    contradictions: Sequence[Contradiction] = (),
    accepted: str = "",
    *,
    private: bool = False,
) -> StoredModel:
    """Write the model file of `described_model`; if `private`, only its owner may read it."""
    if private:
        private_folder(path.parent)
    path.parent.mkdir(parents=True, exist_ok=True)
    stored = described_model(model, data, metrics, effects, contradictions, accepted)
    save_model(path, stored, private=private)
    return stored


def table_metrics(result: FitResult) -> dict[str, float]:
    """Return the errors of a fit to a table for its model file; names with their unit."""
    return {
        "fit_worst_percent_fs": result.fitted.worst_percent_fs,
        "fit_rms_percent_fs": result.fitted.rms_percent_fs,
        **result.cross_validated,
        "noise_nm": result.model.scatter_nm,
    }
