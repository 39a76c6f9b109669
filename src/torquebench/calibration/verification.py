"""Errors of a chain, without and with models, against the standard and against the true torque."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.calibration.data import CalibrationData
from torquebench.chain import Readings, Torque
from torquebench.chain.effects.rotation import STANDSTILL_RPM
from torquebench.errors import InputError
from torquebench.message import Message

RAW = "raw"
"""Name of the uncompensated reading among the models of a verification."""

READING_SHARE = 0.05
READING_RULE = "where |torque| is at least 5 % of full scale"
"""Torques for which an error in % of reading is stated."""

SAME_PLACE_SHARE = 0.1
"""The k-th points of all groups are one place if they differ by less than this share of the
range."""

CELL_SHARE = 0.05
SAME_NUMBER = "points of the same number in their groups"
SAME_CELL = "points of one branch and direction in the same 5 % of range"
SAME_TURNING_CELL = (
    "points of one branch and direction in the same 5 % of range and of the largest speed"
)
"""What counts as one place where groups have the same points, and where they have their own."""


class Chain(Protocol):
    """Interface of a measuring chain in a verification."""

    def torque(self, readings: Readings) -> Torque:
        """Return the compensated torques with their uncertainty."""


@dataclass(frozen=True)
class ErrorSummary:
    """Worst and RMS error in N·m, in % of full scale and in % of reading.

    Parameters
    ----------
    points : int
        Number of points.
    worst_nm, rms_nm : float
        Largest |error| and root mean square error in N·m.
    worst_at_nm : float
        Torque at which the largest error occurs, in N·m.
    worst_percent_fs, rms_percent_fs : float
        The same in % of full scale.
    worst_percent_reading, rms_percent_reading : float or None
        The same in % of the torque at each point, over the points that `reading_rule` names;
        None where there is no such point.
    reading_rule : str
        Range in which errors in % of reading are stated.
    """

    points: int
    worst_nm: float
    rms_nm: float
    worst_at_nm: float
    worst_percent_fs: float
    rms_percent_fs: float
    worst_percent_reading: float | None
    rms_percent_reading: float | None
    reading_rule: str = READING_RULE


@dataclass(frozen=True)
class Repeatability:
    """Spread of the errors over the groups at the same torque.

    Parameters
    ----------
    pooled_nm, worst_nm : float
        Standard deviation over the groups, pooled over all places and at the worst place, in N·m.
    pooled_percent_fs, worst_percent_fs : float
        The same in % of full scale.
    places : int
        Number of places that at least two groups have measured.
    rule : str
        Definition of the same place.
    """

    pooled_nm: float
    worst_nm: float
    pooled_percent_fs: float
    worst_percent_fs: float
    places: int
    rule: str


@dataclass(frozen=True)
class ModelVerification:
    """Result of a verification for one model, or for the raw reading.

    Parameters
    ----------
    name : str
        Name of the model, or `RAW`.
    against_standard : ErrorSummary
        Errors of single readings against the standard, over all groups.
    against_truth : ErrorSummary or None
        Errors of single readings against the true torque; only on a simulated bench.
    groups : tuple of ErrorSummary
        Errors of each group: against the true torque if known, else against the standard.
    averaged : ErrorSummary or None
        The error averaged over the groups at each place, against the same reference as `groups`;
        None for a single group. Single noisy readings can't show a model's quality: their worst
        error stays near 2.8 times the repeatability.
    repeatability : Repeatability or None
        Spread over the groups, against the same reference; None for a single group.
    expanded_uncertainty_nm : float or None
        Largest U (k = 2) that the measuring chain states for a point, N·m; None for the raw
        reading.
    """

    name: str
    against_standard: ErrorSummary
    against_truth: ErrorSummary | None
    groups: tuple[ErrorSummary, ...]
    averaged: ErrorSummary | None
    repeatability: Repeatability | None
    expanded_uncertainty_nm: float | None = None


@dataclass(frozen=True)
class VerificationResult:
    """A verification in groups: the raw reading first, then each model.

    Parameters
    ----------
    range_nm : float
        Full scale in N·m.
    groups, points : int
        Number of groups, and of points over all groups.
    simulated : bool
        Whether the points come from a simulated bench.
    models : tuple of ModelVerification
        The raw reading first, then the models in the given order.
    data_sha256 : str
        Hash of the points.
    """

    range_nm: float
    groups: int
    points: int
    simulated: bool
    models: tuple[ModelVerification, ...]
    data_sha256: str

    def of(self, name: str) -> ModelVerification:
        """Return the result of one model by its name.

        Raises
        ------
        InputError
            Where there is no such model.
        """
        for model in self.models:
            if model.name == name:
                return model
        raise InputError(
            Message("model {name!r}", name), ", ".join(model.name for model in self.models)
        )


def summarise_errors(
    torque_nm: ArrayLike, reference_nm: ArrayLike, range_nm: float
) -> ErrorSummary:
    """Return worst and RMS error of torques against their reference.

    Parameters
    ----------
    torque_nm : array of float, shape (n,)
        Torque as read or compensated, in N·m.
    reference_nm : array of float, shape (n,)
        Standard or true torque, in N·m.
    range_nm : float
        Full scale in N·m.

    Raises
    ------
    InputError
        Where there is no point, lengths differ, a value isn't finite or the range isn't above 0.

    Examples
    --------
    >>> summary = summarise_errors([0.1, 50.0, 99.8], [0.0, 50.0, 100.0], 100.0)
    >>> round(summary.worst_nm, 3), round(summary.worst_percent_fs, 3), summary.worst_at_nm
    (0.2, 0.2, 100.0)
    >>> round(summary.worst_percent_reading, 3), summary.reading_rule
    (0.2, 'where |torque| is at least 5 % of full scale')
    """
    torque = np.atleast_1d(np.asarray(torque_nm, dtype=np.float64))
    reference = np.atleast_1d(np.asarray(reference_nm, dtype=np.float64))
    if torque.shape != reference.shape or torque.ndim != 1 or torque.size == 0:
        raise InputError(
            Message(
                "torques of shape {shape} against references of shape {reference_shape}",
                torque.shape,
                reference.shape,
            ),
            "two columns of equal length with at least one point",
        )
    if not (np.isfinite(range_nm) and range_nm > 0):
        raise InputError(Message("range {range_nm} N·m", range_nm), "a finite range above 0 N·m")
    error = torque - reference
    if not np.all(np.isfinite(error)):
        point = int(np.flatnonzero(~np.isfinite(error))[0])
        raise InputError(
            Message(
                "torque {torque} against reference {reference} at point {point}",
                torque[point],
                reference[point],
                point + 1,
            ),
            "finite numbers",
        )
    worst = int(np.argmax(np.abs(error)))
    worst_nm, rms_nm = float(abs(error[worst])), _rms(error)
    large = np.abs(reference) >= READING_SHARE * range_nm
    relative = 100.0 * np.abs(error[large] / reference[large])
    return ErrorSummary(
        points=torque.size,
        worst_nm=worst_nm,
        rms_nm=rms_nm,
        worst_at_nm=float(reference[worst]),
        worst_percent_fs=100.0 * worst_nm / range_nm,
        rms_percent_fs=100.0 * rms_nm / range_nm,
        worst_percent_reading=float(relative.max()) if relative.size else None,
        rms_percent_reading=_rms(relative) if relative.size else None,
    )


def verify(
    data: CalibrationData,
    models: Mapping[str, Chain],
    torques: Mapping[str, Torque] | None = None,
) -> VerificationResult:
    """Verify models on points that they weren't fitted to; each series of the data is a group.

    Parameters
    ----------
    data : CalibrationData
        Points of all groups; the number of the series is that of the group.
    models : mapping of str to MeasuringChain
        Measuring chains by the names of their models.
    torques : mapping of str to Torque, optional
        The chain's torque at the points, if they aren't steady points with a zero in every series.

    Returns
    -------
    VerificationResult
        The raw reading first, under the name `RAW`.

    Raises
    ------
    InputError
        Where a model is called `RAW`, or refuses a reading (outside its range, not finite).

    Examples
    --------
    >>> import numpy as np
    >>> from torquebench.calibration.data import CalibrationData
    >>> class Halved:
    ...     def torque(self, readings):
    ...         return Torque(0.5 * readings.reading_nm, ())
    >>> data = CalibrationData([2.0, 4.0], [1.0, 2.1], [1, 1], [1, 1], 10.0)
    >>> result = verify(data, {"halved": Halved()})
    >>> [(model.name, round(model.against_standard.worst_nm, 3)) for model in result.models]
    [('raw', 1.9), ('halved', 0.1)]
    """
    if RAW in models:
        raise InputError(
            Message("a model called {raw!r}", RAW),
            "any other name",
            Message("{raw!r} is the reading", RAW),
        )
    places = _Places.of(data)
    verified = [_verified(RAW, data.reading_nm, data, places)]
    for name, chain in models.items():
        stated = (torques or {}).get(name)
        torque = chain.torque(data.readings()) if stated is None else stated
        errors = _verified(name, torque.value_nm, data, places)
        largest = float(np.max(torque.expanded_uncertainty_nm))
        verified.append(replace(errors, expanded_uncertainty_nm=largest))
    return VerificationResult(
        range_nm=data.range_nm,
        groups=int(np.unique(data.series).size),
        points=len(data),
        simulated=data.simulated,
        models=tuple(verified),
        data_sha256=data.sha256(),
    )


def _verified(
    name: str, torque: NDArray[np.float64], data: CalibrationData, places: "_Places"
) -> ModelVerification:
    """Return a model's errors on the verification's points, by series and on average."""
    truth = data.true_torque_nm
    reference = data.standard_nm if truth is None else truth
    groups = tuple(
        summarise_errors(torque[member], reference[member], data.range_nm)
        for number in np.unique(data.series)
        for member in (data.series == number,)
    )
    single = len(groups) < 2
    return ModelVerification(
        name=name,
        against_standard=summarise_errors(torque, data.standard_nm, data.range_nm),
        against_truth=None if truth is None else summarise_errors(torque, truth, data.range_nm),
        groups=groups,
        averaged=None if single else places.averaged(torque - reference, reference),
        repeatability=None if single else places.repeatability(torque - reference),
    )


@dataclass(frozen=True, eq=False)
class _Places:
    """Assigns the points of a verification to places of the range."""

    label: NDArray[np.intp]
    range_nm: float
    rule: str

    @classmethod
    def of(cls, data: CalibrationData) -> "_Places":
        """Find the places: the number of a point in its group if the groups agree, else a cell.

        The groups of a verification draw their points cell by cell, so that the k-th points of all
        groups have about the same torque, speed, branch and direction. Tables whose groups differ
        in length or order are divided into cells of torque and speed instead.
        """
        speed = np.zeros(len(data)) if data.speed_rpm is None else data.speed_rpm
        speed = np.where(np.abs(speed) > STANDSTILL_RPM, speed, 0.0)
        top_rpm = float(np.max(np.abs(speed))) or 1.0
        groups = [np.flatnonzero(data.series == number) for number in np.unique(data.series)]
        size = groups[0].size
        if all(group.size == size for group in groups):
            table = np.stack(groups)
            torque, branch = data.standard_nm[table], data.branch[table]
            near = np.ptp(torque, axis=0) <= SAME_PLACE_SHARE * data.range_nm
            near &= np.ptp(speed[table], axis=0) <= SAME_PLACE_SHARE * top_rpm
            if np.all(near) and np.all(branch == branch[0]):
                label = np.empty(len(data), dtype=np.intp)
                label[table] = np.arange(size)
                return cls(label, data.range_nm, SAME_NUMBER)
        cell = np.floor(np.abs(data.standard_nm) / (CELL_SHARE * data.range_nm)).astype(np.int64)
        turning = np.floor(speed / (CELL_SHARE * top_rpm)).astype(np.int64)
        sign = np.sign(data.standard_nm).astype(np.int64)
        keys = np.stack([cell, data.branch, sign, turning], axis=1)
        _, label = np.unique(keys, axis=0, return_inverse=True)
        rule = SAME_CELL if data.speed_rpm is None else SAME_TURNING_CELL
        return cls(label.reshape(-1), data.range_nm, rule)

    def _mean(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean of each group of equal points."""
        return np.bincount(self.label, weights=values) / np.bincount(self.label)

    def averaged(self, error: NDArray[np.float64], reference: NDArray[np.float64]) -> ErrorSummary:
        """Summarise the mean error of each place, at the place's mean torque."""
        torque = self._mean(reference)
        return summarise_errors(torque + self._mean(error), torque, self.range_nm)

    def repeatability(self, error: NDArray[np.float64]) -> Repeatability | None:
        """Return the spread of the error within the places; None if no place was measured twice."""
        count = np.bincount(self.label)
        squares = np.bincount(self.label, weights=(error - self._mean(error)[self.label]) ** 2)
        repeated = count >= 2
        if not np.any(repeated):
            return None
        freedom = count[repeated] - 1
        pooled = float(np.sqrt(squares[repeated].sum() / freedom.sum()))
        worst = float(np.sqrt(np.max(squares[repeated] / freedom)))
        return Repeatability(
            pooled_nm=pooled,
            worst_nm=worst,
            pooled_percent_fs=100.0 * pooled / self.range_nm,
            worst_percent_fs=100.0 * worst / self.range_nm,
            places=int(repeated.sum()),
            rule=self.rule,
        )


def repeatability(error_nm: NDArray[np.float64], data: CalibrationData) -> Repeatability | None:
    """Return the spread of an error over the groups of a verification at the same place.

    None for a single group, or if no place was measured twice.

    Parameters
    ----------
    error_nm : array of float, shape (n,)
    data : CalibrationData
        The points; a series is a group.
    """
    if np.unique(data.series).size < 2:
        return None
    return _Places.of(data).repeatability(error_nm)


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
