"""Comparison of models by their errors at held-out points."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from torquebench.compensation.base import CompensationModel
from torquebench.compensation.checks import (
    CalibrationPoints,
    Outlier,
    OutlierWarning,
    PointsReducedWarning,
    check_points,
    point_weights,
)
from torquebench.compensation.columns import FloatArray, by_names
from torquebench.compensation.discrepancy import discrepancy_of, fit_posterior
from torquebench.compensation.factory import make_model
from torquebench.compensation.repeats import (
    IntArray,
    repeat_groups,
    spread_folds,
)
from torquebench.errors import InputError
from torquebench.html_table import html_table
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, SHARES, Part, Progress

CANDIDATES = (
    "polynomial-1",
    "polynomial-2",
    "polynomial-3",
    "published-network",
    "bayesian-network",
    "radial-basis",
    "hybrid",
)
"""Default models of `compare`."""

_PERCENT_OF_READING_FROM = 0.05  # of full scale; smaller torques get no error in % of reading
_ALIKE_SHARE_OF_RANGE = 1e-6
"""Root mean square errors closer than this share of full scale, a table's error, count as equal.
"""
_FEW_STEPS = 8


@dataclass(frozen=True)
class ModelScore:
    """Errors of one model at held-out points, with its cost.

    Attributes
    ----------
    name : str
        Name of the candidate.
    worst_nm, rms_nm : float
        Largest and root mean square error of single held-out points, in N·m.
    worst_averaged_nm : float
        Largest error of the mean of a step's points, in N·m, which contains less noise.
    worst_percent_fs, rms_percent_fs : float
        The same errors as the first two in % of full scale.
    worst_percent_reading : float
        Largest error in % of the torque, where that is at least 5 % of full scale.
    effective_parameters : float
        Parameters that all points together determine.
    fit_time_s : float
        Time of the fit to all points.
    complexity : int
        Rank of the kind: lower is simpler.
    reason : str
        Comparison with the best model, in words.
    """

    name: str
    worst_nm: float
    rms_nm: float
    worst_averaged_nm: float
    worst_percent_fs: float
    rms_percent_fs: float
    worst_percent_reading: float
    effective_parameters: float
    fit_time_s: float
    complexity: int
    reason: str = ""


@dataclass(frozen=True)
class LeftOut:
    """Errors at points left out.

    Parameters
    ----------
    worst_nm, rms_nm : float
        Largest and root mean square error, N·m.
    """

    worst_nm: float
    rms_nm: float

    @classmethod
    def of(cls, error_nm: FloatArray) -> LeftOut:
        """Summarise errors."""
        return cls(float(np.max(np.abs(error_nm))), float(np.sqrt(np.mean(error_nm**2))))


def behind_raw(
    name: str, model: CompensationModel, left_out: LeftOut, raw: LeftOut, full_scale_nm: float
) -> str:
    """Return a sentence that a model is worse than the raw reading at held-out points, and why.

    Parameters
    ----------
    name : str
        Of the model.
    model : CompensationModel
        Fitted to all points.
    left_out, raw : LeftOut
        Errors of the model and of the raw reading at the same points.

    Returns
    -------
    sentence : str
        Verdict in words; empty where the model is better in both the worst and the RMS error.
    """
    if left_out.worst_nm <= raw.worst_nm and left_out.rms_nm <= raw.rms_nm:
        return ""
    percent = 100.0 / full_scale_nm
    why = model.shortcoming(left_out.rms_nm)
    message = Message(
        "{name} is worse than the raw reading at steps that it wasn't fitted to: "
        "{worst:.3g} % FS at worst and {rms:.3g} % FS RMS; the raw "
        "reading's errors are {raw_worst:.3g} and {raw_rms:.3g} % FS",
        name,
        percent * left_out.worst_nm,
        percent * left_out.rms_nm,
        percent * raw.worst_nm,
        percent * raw.rms_nm,
    )
    return Message.joined((message, why), "; ") if why else message


def worse_than_raw(
    name: str,
    model: CompensationModel,
    X: ArrayLike,
    y: ArrayLike,
    progress: Progress = NO_PROGRESS,
) -> str:
    """Test by cross-validation in four folds whether a fitted model is worse than the raw reading.

    Parameters
    ----------
    model : CompensationModel
        Fitted to all points.
    X : array of shape (n, k)
        Feature columns.
    y : array of shape (n,)
        Torque of the standard in N·m.
    progress : Progress, optional
        Receives the fraction done, in steps of `SHARES`.

    Returns
    -------
    sentence : str
        Verdict in words; empty where the model is better.
    """
    features, torque = _checked(X, y)
    fold_of_point, count = spread_folds(repeat_groups(features[:, 0]), 4)
    scored = fold_of_point >= 0
    scored[[point.row for point in model.outliers_]] = False
    errors = _left_out_errors(model, features, torque, fold_of_point, count, progress)
    return behind_raw(
        name,
        model,
        LeftOut.of(errors[scored]),
        LeftOut.of((features[:, 0] - torque)[scored]),
        model.full_scale_nm_,
    )


@dataclass(frozen=True, repr=False)
class Comparison:
    """Table of models by their errors at held-out points.

    Attributes
    ----------
    scores : tuple of ModelScore
        From the simplest model to the most complex.
    best : str
        Name of the candidate with the least root mean square error.
    models : mapping of str to CompensationModel
        Every candidate, fitted to all points.
    refused : mapping of str to str
        Candidates that refused the data, with their messages.
    folds, steps, points : int
        Number of folds, of steps (groups of points) and of points that were scored.
    outliers : tuple of Outlier
        Outliers; they aren't scored.
    raw : LeftOut
        Errors of the raw reading at the same points.
    """

    scores: tuple[ModelScore, ...]
    best: str
    models: Mapping[str, CompensationModel]
    refused: Mapping[str, str]
    full_scale_nm: float
    folds: int
    steps: int
    points: int
    outliers: tuple[Outlier, ...]
    raw: LeftOut

    @property
    def caution(self) -> str:
        """Reason why the comparison can't distinguish models; empty if there is none."""
        scored = self.steps - 2
        if scored >= _FEW_STEPS:
            return ""
        return Message(
            "only {scored} steps could be left out: with so few, differences between "
            "models are mostly random",
            scored,
        )

    def behind_raw(self, name: str) -> str:
        """Explain that a candidate is worse than the raw reading; empty if it isn't."""
        score = self.score(name)
        left_out = LeftOut(score.worst_nm, score.rms_nm)
        return behind_raw(name, self.models[name], left_out, self.raw, self.full_scale_nm)

    def __repr__(self) -> str:
        return Message(
            "Comparison({count} models, {points} points in {steps} steps, best: {best})",
            len(self.scores),
            self.points,
            self.steps,
            self.best,
        )

    def _repr_html_(self) -> str:
        return html_table(repr(self), *self._cells())

    def _cells(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Return the comparison's header and rows as texts; the raw reading last."""
        percent = 100.0 / self.full_scale_nm
        rows = [
            (each.name, f"{each.worst_percent_fs:.3g}", f"{each.rms_percent_fs:.3g}", each.reason)
            for each in self.scores
        ]
        raw = (f"{percent * self.raw.worst_nm:.3g}", f"{percent * self.raw.rms_nm:.3g}")
        header = ("model", "worst, % FS", "RMS, % FS", "")
        return header, [*rows, ("raw reading", *raw, "")]

    def score(self, name: str) -> ModelScore:
        """Return the scores of one candidate."""
        return next(score for score in self.scores if score.name == name)


def compare(
    X: ArrayLike,
    y: ArrayLike,
    models: Sequence[str] | Mapping[str, CompensationModel] | None = None,
    *,
    range_nm: float | None = None,
    groups: ArrayLike | None = None,
    folds: int = 10,
    outliers: str = "downweight",
    progress: Progress = NO_PROGRESS,
) -> Comparison:
    """Compare models by cross-validation.

    Points of one step (repeats, both branches) are always held out together. A fold holds every
    k-th step, so neighbours on both sides stay in; the outermost steps always stay in and aren't
    scored, so that a model never has to extrapolate. A model's own choices (regularisation,
    smoothing) are repeated in every fold.

    Parameters
    ----------
    X : array of shape (n, k)
        Feature columns, see `features`.
    y : array of shape (n,)
        Torque of the standard in N·m.
    models : sequence of names, or mapping of names to unfitted models, optional
        Candidates; `CANDIDATES` when None.
    range_nm : float, optional
        Full scale in N·m; largest reading when None.
    groups : array of shape (n,), optional
        Step of each point; by default from `repeat_groups`.
    folds : int, default 10
        Number of folds; one for every step where there are fewer than twice as many steps.
    outliers : {"downweight", "refuse", "keep"}, default "downweight"
        Treatment of outliers, as in `CompensationModel`; candidates given as models keep their own.
        Kept points are scored like all others.
    progress : callable, optional
        Called with the fraction done and a sentence.

    Raises
    ------
    InputError
        When there are too few steps, a column is constant, points contradict each other, one is
        an outlier (with ``outliers="refuse"``), or no candidate accepts the data.

    Notes
    -----
    The least error of many is partly luck, so every other candidate's excess is stated in standard
    errors of the difference over the steps. A standard error of few steps is itself uncertain and
    widened by Student's factor. Errors that differ by less than a millionth of full scale count as
    equal, so that without noise rounding doesn't decide.

    Examples
    --------
    >>> generator = np.random.default_rng(1)
    >>> reading = np.tile(np.linspace(-2000.0, 2000.0, 21), 2)
    >>> standard = reading + 1e-3 * reading + 1e-6 * reading**2
    >>> standard += generator.normal(0.0, 0.2, reading.size)
    >>> comparison = compare(reading[:, None], standard, ["polynomial-1", "polynomial-2"])
    >>> [score.name for score in comparison.scores if "worse" not in score.reason]
    ['polynomial-2']
    """
    features, torque = _checked(X, y)
    full_scale = float(np.max(np.abs(features[:, 0]))) if range_nm is None else float(range_nm)
    points = CalibrationPoints(features, torque, np.arange(torque.size)).sorted()
    check_points(points, 1, 1, model="a comparison")
    step = repeat_groups(features[:, 0]) if groups is None else _consecutive(groups, torque.size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OutlierWarning)  # the result names the models that refused
        outlying = point_weights(points, outliers)[1]
    outlying_rows = [point.row for point in outlying]
    fold_of_point, fold_count = spread_folds(step, folds)
    scored = fold_of_point >= 0
    scored[outlying_rows] = False
    candidates = {
        name: model.with_range(full_scale) for name, model in _candidates(models, outliers).items()
    }
    trials, refused = _try_all(candidates, features, torque, fold_of_point, fold_count, progress)
    fitted = {name: trial.model for name, trial in trials.items()}
    left_out = {name: trial.errors[scored] for name, trial in trials.items()}
    alike = (_ALIKE_SHARE_OF_RANGE * full_scale) ** 2
    tally = _Tally(left_out, step[scored], fitted, alike)
    best, _ = tally.differences()
    scores = [
        _score(name, left_out[name], torque[scored], step[scored], full_scale, fitted[name])
        for name in tally.order
    ]
    scores = [replace(score, fit_time_s=trials[score.name].fit_time_s) for score in scores]
    return Comparison(
        scores=tally.explained(scores, best),
        best=best,
        models=fitted,
        refused=refused,
        full_scale_nm=full_scale,
        folds=fold_count,
        steps=int(step.max()) + 1,
        points=int(np.count_nonzero(scored)),
        outliers=tuple(outlying),
        raw=LeftOut.of((features[:, 0] - torque)[scored]),
    )


class _Tally:
    """Errors of all candidates at the same points.

    Mean squares that differ by less than `alike` count as equal.
    """

    def __init__(
        self,
        errors: Mapping[str, FloatArray],
        step: IntArray,
        fitted: Mapping[str, CompensationModel],
        alike: float,
    ) -> None:
        self.errors, self.step, self.alike = errors, step, alike
        self.order = sorted(
            errors, key=lambda name: (fitted[name].complexity, fitted[name].effective_parameters_)
        )

    def differences(self) -> tuple[str, dict[str, tuple[float, float]]]:
        """Return the best candidate, and the others' excess of mean square with its error."""
        squares = {name: error**2 for name, error in self.errors.items()}
        best = min(self.order, key=lambda name: float(np.mean(squares[name])))
        groups = np.unique(self.step, return_inverse=True)[1]
        count = int(groups.max()) + 1
        result = {}
        for name in self.order:
            sums = np.bincount(groups, squares[name] - squares[best])
            # Sums over steps are independent; their spread gives the standard error of the overall
            # mean.
            spread = float(np.std(sums, ddof=1)) if count > 1 else 0.0
            total = groups.size
            error = max(_one_error(count) * spread * float(np.sqrt(count)) / total, self.alike)
            result[name] = (float(np.sum(sums)) / total, error)
        return best, result

    def explained(self, scores: Sequence[ModelScore], best: str) -> tuple[ModelScore, ...]:
        """Add to every score its distance from the best, also in words."""
        _, differences = self.differences()
        rows = []
        for score in scores:
            difference, error = differences[score.name]
            if score.name == best:
                reason = "least error at points left out"
            elif difference <= error:
                reason = Message("as good as {best} within one standard error", best)
            else:
                reason = Message(
                    "{count:.1f} standard errors worse than {best}", difference / error, best
                )
            rows.append(replace(score, reason=reason))
        return tuple(rows)


def _one_error(count: int) -> float:
    """Return Student's factor for one standard error that is estimated from a number of steps."""
    from scipy.special import ndtr, stdtrit  # imported late: a server at rest doesn't need SciPy

    return float(stdtrit(max(count - 1, 1), ndtr(1.0)))


def _score(
    name: str,
    error: FloatArray,
    torque: FloatArray,
    step: IntArray,
    full_scale: float,
    model: CompensationModel,
) -> ModelScore:
    """Return the figures of a model's errors in cross-validation."""
    groups = np.unique(step, return_inverse=True)[1]
    means = np.bincount(groups, error) / np.bincount(groups)
    large = np.abs(torque) >= _PERCENT_OF_READING_FROM * full_scale
    worst, rms = float(np.max(np.abs(error))), float(np.sqrt(np.mean(error**2)))
    of_reading = np.abs(error[large] / torque[large])
    return ModelScore(
        name=name,
        worst_nm=worst,
        rms_nm=rms,
        worst_averaged_nm=float(np.max(np.abs(means))),
        worst_percent_fs=100 * worst / full_scale,
        rms_percent_fs=100 * rms / full_scale,
        worst_percent_reading=100 * float(np.max(of_reading)) if of_reading.size else float("nan"),
        effective_parameters=model.effective_parameters_,
        fit_time_s=0.0,
        complexity=model.complexity,
    )


def _checked(X: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return features and torques as finite arrays of one length, or refuse them."""
    features = np.asarray(by_names(X), dtype=np.float64)
    torque = np.asarray(y, dtype=np.float64).ravel()
    if features.ndim != 2 or features.shape[0] != torque.size:
        raise InputError(
            Message(
                "features of shape {shape} with {size} standard values", features.shape, torque.size
            ),
            "one row of features for each standard value",
        )
    for what, values in (("features", features), ("standard", torque)):
        if not np.all(np.isfinite(values)):
            row = int(np.argmin(np.isfinite(values.reshape(torque.size, -1)).all(axis=1)))
            raise InputError(
                Message("NaN or infinity in the {what}, row {row}", what, row), "numbers"
            )
    return features, torque


def _consecutive(groups: ArrayLike, count: int) -> IntArray:
    """Return groups numbered from 0 on."""
    values = np.asarray(groups)
    if values.shape != (count,):
        raise InputError(
            Message("groups of shape {shape}", values.shape),
            Message("one for each of the {count} points", count),
        )
    return np.unique(values, return_inverse=True)[1].astype(np.intp)


def _candidates(
    models: Sequence[str] | Mapping[str, CompensationModel] | None, outliers: str
) -> dict[str, CompensationModel]:
    """Return the models to be compared, by name."""
    if isinstance(models, Mapping):
        return dict(models)
    return {name: make_model(name, outliers=outliers) for name in models or CANDIDATES}


@dataclass(frozen=True)
class _Trial:
    """A candidate fitted to all points, and its errors at held-out points."""

    model: CompensationModel
    fit_time_s: float
    errors: FloatArray


def _try_all(
    candidates: Mapping[str, CompensationModel],
    X: FloatArray,
    y: FloatArray,
    fold_of_point: IntArray,
    folds: int,
    progress: Progress,
) -> tuple[dict[str, _Trial], dict[str, str]]:
    """Fit each candidate to all points and without each fold; return trials and refusals."""
    trials: dict[str, _Trial] = {}
    refused: dict[str, str] = {}
    posteriors = _Posteriors(X, y)
    for number, (name, model) in enumerate(candidates.items()):
        share = 1.0 / len(candidates)
        part = Part(progress, SHARES * number * share, prefix=name, share=share)
        try:
            started = time.perf_counter()
            fitted = posteriors.complete(_quiet_fit(model, X, y))
            fit_time_s = time.perf_counter() - started
            errors = _left_out_errors(model, X, y, fold_of_point, folds, part)
        except InputError as refusal:
            refused[name] = Message.of(refusal)
        else:
            trials[name] = _Trial(fitted, fit_time_s, errors)
    if not trials:
        raise InputError(
            Message(
                "no candidate accepts the data ({values})", Message.joined(refused.values(), "; ")
            ),
            remedy="record more points",
        )
    return trials, refused


class _Posteriors:
    """Posteriors of the truth at all points, fitted once for all candidates of one range."""

    def __init__(self, X: FloatArray, y: FloatArray) -> None:
        self._X, self._y = X, y
        self._fitted: dict[tuple[float | None, float, str, bool], CompensationModel] = {}

    def complete(self, model: CompensationModel) -> CompensationModel:
        """Add the uncertainty to a model whose curve was fitted without it."""
        if model.lacks_uncertainty:
            key = (model.range_nm, model.range_margin, model.outliers, model.zeroed)
            if key not in self._fitted:
                self._fitted[key] = fit_posterior(model, self._X, self._y)
            model.uncertainty_ = discrepancy_of(model, self._fitted[key], self._X)
        return model


def _quiet_fit(model: CompensationModel, X: FloatArray, y: FloatArray) -> CompensationModel:
    """Return a fitted copy, without warnings that the comparison already gave."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OutlierWarning)
        warnings.simplefilter("ignore", PointsReducedWarning)
        return replace(model).fit_curve(X, y)


def _left_out_errors(
    model: CompensationModel,
    X: FloatArray,
    y: FloatArray,
    fold_of_point: IntArray,
    folds: int,
    progress: Progress,
) -> FloatArray:
    """Return each point's error by a model fitted without its fold; NaN if never held out."""
    error = np.full(y.size, np.nan)
    for fold in range(folds):
        here = fold_of_point == fold
        fitted = _quiet_fit(model, X[~here], y[~here])
        error[here] = fitted.predict(X[here]) - y[here]
        progress.reach(
            SHARES * (fold + 1) // folds, Message("fold {fold} of {folds}", fold + 1, folds)
        )
    return error
