"""The table of one calibration: readings beside standard values, with branch, series and more."""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from datetime import date
from functools import reduce
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.chain import Readings, readings_of_rows
from torquebench.compensation import FEATURES, NoiseFloor, branch_values, features, noise_floor
from torquebench.errors import InputError
from torquebench.html_table import html_table
from torquebench.message import Message
from torquebench.units import HOUR

if TYPE_CHECKING:
    from torquebench.chain import Reference
    from torquebench.compensation import ReadingScale

RANGE_MARGIN = 0.02
"""Share of the range by which readings and standard values may exceed the range."""

UNLOADED_SHARE = 0.001
"""Standard values below this share of the range are treated as unloaded, without a direction."""

STREAM_S = 1.0
"""Rows of a rotating chain farther apart in time than this are steady points, not a record."""

REQUIRED_COLUMNS = ("reading_nm", "standard_nm", "series", "branch")


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationData:
    """Readings of one measuring chain with the torque of the standard, in measuring order.

    Parameters
    ----------
    reading_nm : array of float, shape (n,)
        Torque as the chain under calibration reads it, zero subtracted, in N·m.
    standard_nm : array of float, shape (n,)
        Torque of the standard, in N·m, clockwise positive.
    series : array of int, shape (n,)
        Number of the loading series that each point belongs to.
    branch : array of int8, shape (n,)
        +1 where |torque| grows, -1 where it falls, 0 where unknown; "up" and "down" are
        understood.
    range_nm : float
        Full scale of the chain, in N·m: what % FS refers to.
    side : str
        ``"input"``, ``"output"`` or empty.
    transducer_serial, counter_identity : str
        Serial number of the transducer, and timebase; empty if unknown.
    nominal_nm : array of float, shape (n,), optional
        Nominal torque of the step, in N·m.
    position_deg : array of float, shape (n,), optional
        Mounting position of the transducer about its axis, in degrees.
    speed_rpm, temperature_c, time_s : array of float, shape (n,), optional
        Speed, temperature and time of each point.
    standard_error_nm : array of float, shape (n,), optional
        Standard error of each reading's mean, in N·m.
    acceleration_rad_s2 : array of float, shape (n,), optional
        Angular acceleration of the shaft; 0 where it isn't given, as points are steady.
    angle_rad : array of float, shape (n,), optional
        Angle of the shaft in the middle of a window, where the points are a record.
    zero_temperature_c : array of float, shape (n,), optional
        Temperature of the transducer when the zero that each reading counts from was taken.
    zero_nm : array of float, shape (n,), optional
        That zero itself, as a torque from the transducer's nominal zero, in N·m.
    standard_temperature_c : array of float, shape (n,), optional
        Temperature of the standard.
    true_torque_nm : array of float, shape (n,), optional
        The true torque in N·m; simulated bench only.
    simulated : bool
        Whether the points come from a simulated bench; always true with a true torque.
    reference : Reference, optional
        The standard with its uncertainty, as a table states it. A run of a bench has it in its
        metadata instead.
    measured_on : datetime.date or str, optional
        Day of the measurement, from which the age of a calibration counts; ISO 8601 as text.
    tared : bool
        Whether the zero of each series is already subtracted from its readings, as on a bench.
    row : array of int, shape (n,), optional
        Row of each point in its table, as the file numbers them.
    table : array of str, shape (n,), optional
        Name of that table, if the points come from several.
    scale : ReadingScale, optional
        Unit that the readings came in, where it wasn't N·m.

    Raises
    ------
    InputError
        Where the arrays' lengths differ, a value isn't finite, a branch isn't -1, 0 or +1, or a
        standard value lies outside the range by more than `RANGE_MARGIN`.

    Examples
    --------
    >>> data = CalibrationData([0.1, 5.2, 10.1], [0.0, 5.0, 10.0], [1, 1, 1], [1, 1, 1], 10.0)
    >>> len(data), data.direction.tolist(), data.simulated
    (3, [0, 1, 1], False)
    >>> data.subset(data.standard_nm > 0).reading_nm.tolist()
    [5.2, 10.1]
    """

    reading_nm: NDArray[np.float64]
    standard_nm: NDArray[np.float64]
    series: NDArray[np.int64]
    branch: NDArray[np.int8]
    range_nm: float
    side: str = ""
    transducer_serial: str = ""
    counter_identity: str = ""
    nominal_nm: NDArray[np.float64] | None = None
    position_deg: NDArray[np.float64] | None = None
    speed_rpm: NDArray[np.float64] | None = None
    temperature_c: NDArray[np.float64] | None = None
    time_s: NDArray[np.float64] | None = None
    standard_error_nm: NDArray[np.float64] | None = None
    true_torque_nm: NDArray[np.float64] | None = None
    simulated: bool = False
    acceleration_rad_s2: NDArray[np.float64] | None = None
    angle_rad: NDArray[np.float64] | None = None
    zero_temperature_c: NDArray[np.float64] | None = None
    zero_nm: NDArray[np.float64] | None = None
    standard_temperature_c: NDArray[np.float64] | None = None
    reference: "Reference | None" = None
    measured_on: date | None = None
    tared: bool = False
    row: NDArray[np.int64] | None = None
    table: NDArray[np.str_] | None = None
    scale: "ReadingScale | None" = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.range_nm) and self.range_nm > 0):
            raise InputError(
                Message("range {range_nm} N·m", self.range_nm),
                "a finite range above 0 N·m",
                "state the full scale",
            )
        object.__setattr__(self, "range_nm", float(self.range_nm))
        n = int(np.size(self.reading_nm))
        if n == 0:
            raise InputError("a calibration without points", "at least one point")
        for name in (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS, "row"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _column(name, value, n))
        object.__setattr__(self, "simulated", self.simulated or self.true_torque_nm is not None)
        if isinstance(self.measured_on, str):
            object.__setattr__(self, "measured_on", date.fromisoformat(self.measured_on))
        _check_branch(self.branch)
        _check_range(self.standard_nm, self.range_nm)

    def __len__(self) -> int:
        return int(self.reading_nm.size)

    def __repr__(self) -> str:
        words = [f"{len(self)} points", f"{self.range_nm:g} N·m", self.side]
        words += [f"transducer {self.transducer_serial}"] * bool(self.transducer_serial)
        words += ["simulated"] * self.simulated
        return f"CalibrationData({', '.join(filter(None, words))})"

    def _repr_html_(self) -> str:
        """Return a table of the points' range, series and largest error."""
        worst = float(np.max(np.abs(self.additional_torque_nm)))
        loops, percent = np.unique(self.series).size, 100.0 * worst / self.range_nm
        rows = [
            ("standard", f"{self.standard_nm.min():.6g} to {self.standard_nm.max():.6g} N·m"),
            ("series", str(loops)),
            (
                "largest additional torque",
                f"{worst:.4g} N·m ({percent:.3g} % FS)",
            ),
            *(("note", note) for note in self.notes()),
        ]
        return html_table(repr(self), (), rows)

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Return the columns for Arrow: ``pyarrow.table(data)``, ``polars.DataFrame(data)``."""
        import pyarrow

        present = {
            name: value
            for name in (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS)
            if (value := getattr(self, name)) is not None
        }
        return pyarrow.table(present).__arrow_c_stream__(requested_schema)

    @property
    def direction(self) -> NDArray[np.int8]:
        """+1 clockwise, -1 counter-clockwise, 0 unloaded, as commanded; shape (n,).

        Without nominal torques it is estimated from the standard, which `notes` states.
        """
        if self.nominal_nm is not None:
            return np.sign(self.nominal_nm).astype(np.int8)
        loaded = np.abs(self.standard_nm) > UNLOADED_SHARE * self.range_nm
        return np.where(loaded, np.sign(self.standard_nm), 0).astype(np.int8)

    @property
    def unloaded(self) -> NDArray[np.bool_]:
        """Points with a commanded torque of zero; shape (n,)."""
        return np.asarray(self.direction == 0)

    @property
    def additional_torque_nm(self) -> NDArray[np.float64]:
        """Additional torque, standard − reading, in N·m, shape (n,)."""
        return self.standard_nm - self.reading_nm

    @property
    def first_of_series(self) -> NDArray[np.intp]:
        """Row of the first point of each point's series, shape (n,)."""
        _, first, number = np.unique(self.series, return_index=True, return_inverse=True)
        return np.asarray(first[number.reshape(-1)])

    def zeroed_each_series(self) -> Self:
        """Return the points with zero temperatures: for each series that of its first point."""
        if self.temperature_c is None:
            return self
        return replace(self, zero_temperature_c=self.temperature_c[self.first_of_series])

    @property
    def loading_accuracy_percent(self) -> float | None:
        """Largest difference of the standard from the request, % of range.

        None if the table doesn't state the request.
        """
        error = self.loading_error_percent
        return None if error is None else float(np.max(np.abs(error)))

    @property
    def loading_error_percent(self) -> NDArray[np.float64] | None:
        """Standard minus target torque at every point, % of range; None if unknown."""
        if self.nominal_nm is None:
            return None
        return 100.0 * (self.standard_nm - self.nominal_nm) / self.range_nm

    @property
    def steady(self) -> bool:
        """Whether the points are steady means, not the rows of a record (`STREAM_S`)."""
        if self.time_s is None or self.speed_rpm is None or len(self) < 2:
            return True
        step = np.diff(self.time_s)
        return not (np.all(step > 0.0) and np.median(step) <= STREAM_S)

    def readings(
        self, *, zero_temperature_c: float | None = None, zeroed_each_series: bool = True
    ) -> Readings:
        """Return the points as readings of a measuring chain; see `readings_of_rows`.

        Parameters
        ----------
        zero_temperature_c : float, optional
            Temperature of the transducer when the zero was taken; replaces that of the table.
        zeroed_each_series : bool
            Whether a table without that temperature was zeroed at the first point of each series.
            Otherwise it has the zero temperature of the calibration.
        """
        begin = self.first_of_series
        age, zeroed, warm = self.time_s, self.zero_temperature_c, self.temperature_c
        if zeroed is None and warm is not None and zeroed_each_series:
            zeroed = warm[begin]
        return readings_of_rows(
            vars(self),
            steady=self.steady,
            zero_age_h=None if age is None else np.abs(age - age[begin]) / HOUR,
            zero_temperature_c=zeroed if zero_temperature_c is None else zero_temperature_c,
            measured_on=self.measured_on,
        )

    def features(self, columns: int | None = None) -> NDArray[np.float64]:
        """Return the feature matrix X of these points for compensation models.

        Parameters
        ----------
        columns : int, optional
            Number of columns of `torquebench.compensation.FEATURES` in X: as many as the model was
            fitted to. By default three: reading, branch and series.

        Returns
        -------
        array of float, shape (n, columns)

        Raises
        ------
        InputError
            If a requested column is missing.

        Examples
        --------
        >>> CalibrationData([5.1], [5.0], [1], [1], 10.0).features().tolist()
        [[5.1, 1.0, 1.0]]
        """
        width = 3 if columns is None else columns
        known = {name: getattr(self, name) for name in FEATURES[:width]}
        for name, column in known.items():
            if column is None:
                raise InputError(
                    Message("no column {name}", name),
                    Message("the columns {features}", ", ".join(FEATURES[:width])),
                    "measure it too, or use a model that was fitted without it",
                )
        return features(**known)

    def subset(self, index: ArrayLike) -> Self:
        """Return the points selected by a mask or an index array, in that order.

        Parameters
        ----------
        index : array of bool, shape (n,), or array of int
            Which points to keep.

        Raises
        ------
        InputError
            If no point is left.
        """
        where = np.asarray(index)
        changes = {
            name: value[where]
            for name in (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS, *PLACE_COLUMNS)
            if (value := getattr(self, name)) is not None
        }
        return replace(self, **changes)

    def sha256(self) -> str:
        """Return the SHA-256 of all columns and metadata, as 64 hexadecimal digits.

        The hash is over the float64 values, not over a file, so the same points give the same
        hash whatever table they were read from.
        """
        meta = {
            "range_nm": self.range_nm,
            "side": self.side,
            "transducer_serial": self.transducer_serial,
            "counter_identity": self.counter_identity,
        }
        digest = hashlib.sha256(json.dumps(meta, sort_keys=True).encode())
        for name in (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS):
            value = getattr(self, name)
            if value is not None:
                digest.update(name.encode())
                digest.update(np.ascontiguousarray(value, dtype="<f8").tobytes())
        return digest.hexdigest()

    def notes(self) -> tuple[str, ...]:
        """Return the limitations of these points, as sentences: a one-sided or rising-only table.

        Examples
        --------
        >>> CalibrationData([5.1, 10.2], [5.0, 10.0], [1, 1], [1, 1], 20.0).notes()
        ('only clockwise points: nothing is known of counter-clockwise torque',
         "only rising series: hysteresis can't be separated from an error that depends on torque",
         'points up to 50 % of the range only')
        """
        notes: list[str] = []
        names = {1: "clockwise", -1: "counter-clockwise"}
        present = set(self.direction.tolist()) - {0}
        if len(present) == 1:
            sign = next(iter(present))
            notes.append(
                Message(
                    "only {known} points: nothing is known of {unknown} torque",
                    names[sign],
                    names[-sign],
                )
            )
        if not np.any(self.branch < 0):
            notes.append(
                "only rising series: hysteresis can't be separated from "
                "an error that depends on torque"
            )
        elif np.any(self.branch > 0):
            direction = self.loading_direction()
            for sign in sorted(present):
                for side, word in ((1, "rising"), (-1, "falling")):
                    if not np.any((direction == sign) & (self.branch == side)):
                        notes.append(
                            Message(
                                "no {word} {names} points: that branch is extrapolated from "
                                "the other",
                                word,
                                names[sign],
                            )
                        )
        guessed = self.unloaded & (self.standard_nm != 0.0)
        if self.nominal_nm is None and np.any(guessed):
            notes.append(
                Message(
                    "no column nominal_nm: {count} points below {unloaded_share:g} % of the "
                    "range are treated as zeros",
                    np.count_nonzero(guessed),
                    100 * UNLOADED_SHARE,
                )
            )
        share = float(np.max(np.abs(self.standard_nm))) / self.range_nm
        if share < 0.9:
            notes.append(Message("points up to {share:.0f} % of the range only", 100 * share))
        return tuple(notes)

    def averaged(self, tolerance_nm: float | None = None) -> Self:
        """Return the mean of the points that repeat one step on one branch and in one direction.

        Points repeat a step where their nominal torque (or, without one, their standard value)
        lies within the tolerance. Reading, standard value and all other columns are averaged; the
        standard error is that of the mean, from the scatter of standard − reading.

        Parameters
        ----------
        tolerance_nm : float, optional
            Largest gap between neighbours of one step, in N·m. By default nominal torques must
            agree (within 10⁻⁶ of the range), and standard values lie within 0.5 % of the range.

        Returns
        -------
        CalibrationData
            One point a step, in the order of each step's first appearance, all in series 1.

        Examples
        --------
        >>> data = CalibrationData(
        ...     [5.0, 10.0, 5.2, 10.2], [5.0, 10.0, 5.0, 10.0], [1, 1, 2, 2], [1, 1, 1, 1], 10.0
        ... )
        >>> data.averaged().reading_nm.tolist()
        [5.1, 10.1]
        """
        _, first, label, count = np.unique(
            self.step_labels(tolerance_nm),
            return_index=True,
            return_inverse=True,
            return_counts=True,
        )
        order = np.argsort(first)

        def mean(values: NDArray[Any]) -> NDArray[np.float64]:
            return (np.bincount(label, weights=values) / count)[order]

        changes: dict[str, Any] = {
            name: mean(value)
            for name in OPTIONAL_COLUMNS
            if (value := getattr(self, name)) is not None
        }
        changes["standard_error_nm"] = self._error_of_means(label, count)[order]
        if not np.all(count >= 2):
            changes["standard_error_nm"] = None
        return replace(
            self,
            reading_nm=mean(self.reading_nm),
            standard_nm=mean(self.standard_nm),
            series=np.ones(order.size, dtype=np.int64),
            branch=self.branch[first][order],
            row=None,
            table=None,
            **changes,
        )

    def noise_floor(self) -> NoiseFloor | None:
        """Return the scatter of points that repeat a step, its branch and its direction.

        Zeros after clockwise and after counter-clockwise load aren't repeats: they differ by
        hysteresis. None where no step was repeated.
        """
        return noise_floor(self.features(2), self.standard_nm, self.step_labels())

    def step_labels(self, tolerance_nm: float | None = None) -> NDArray[np.int64]:
        """Return the number of the step that each point repeats, shape (n,).

        Points belong to one step where branch and direction agree and where no gap between
        neighbouring torques exceeds the tolerance, in N·m, by default that of `averaged`.
        """
        if tolerance_nm is None:
            tolerance_nm = (0.005 if self.nominal_nm is None else 1e-6) * self.range_nm
        torque = self.standard_nm if self.nominal_nm is None else self.nominal_nm
        labels = np.zeros(len(self), dtype=np.int64)
        taken = 0
        keys = np.stack([self.branch, self.loading_direction()], axis=1)
        for key in np.unique(keys, axis=0):
            members = np.flatnonzero(np.all(keys == key, axis=1))
            ranked = members[np.argsort(torque[members], kind="stable")]
            new_step = np.diff(torque[ranked], prepend=-np.inf) > tolerance_nm
            labels[ranked] = taken + np.cumsum(new_step) - 1
            taken = int(labels[ranked].max()) + 1
        return labels

    def loading_direction(self) -> NDArray[np.int8]:
        """Return the direction of the load; unloaded points have that of the removed load.

        An unloaded point at the beginning of a series takes the direction of the following load.
        """
        direction = self.direction.copy()
        for number in np.unique(self.series):
            where = np.flatnonzero(self.series == number)
            loaded = np.flatnonzero(direction[where])
            if loaded.size:
                before = np.searchsorted(loaded, np.arange(where.size), side="right") - 1
                direction[where] = direction[where][loaded[np.maximum(before, 0)]]
        return direction

    def _error_of_means(
        self, label: NDArray[np.intp], count: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Return the standard error of the mean error of each labelled group, N·m."""
        error = self.additional_torque_nm
        mean = np.bincount(label, weights=error) / count
        squares = np.bincount(label, weights=(error - mean[label]) ** 2)
        freedom = np.maximum(count - 1, 1)
        return np.asarray(np.sqrt(squares / freedom / count), dtype=np.float64)

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """Return several tables of one chain as one, series renumbered so that none coincide.

        The result has the largest uncertainty of the standards and the earliest day; if the day of
        one table isn't stated, the result has none.

        Parameters
        ----------
        parts : sequence of CalibrationData
            Tables of the same range, side, transducer and counter.

        Raises
        ------
        InputError
            Where there is no part, or parts of different chains or ranges.
        """
        if not parts:
            raise InputError("no calibration table to join", "at least one")
        scales = {part.scale for part in parts}
        if all(scale is None or scale.is_torque for scale in scales) and len(scales) > 1:
            parts = [replace(part, scale=None) for part in parts]
        head = parts[0]
        for name in ("range_nm", "side", "transducer_serial", "counter_identity", "scale"):
            values = {getattr(part, name) for part in parts}
            if len(values) > 1:
                raise InputError(
                    Message("tables of different {name}: {values}", name, sorted(map(str, values))),
                    "tables of one measuring chain",
                )
        changes: dict[str, Any] = {}
        for name in ("reading_nm", "standard_nm", "branch", *OPTIONAL_COLUMNS, *PLACE_COLUMNS):
            columns = [getattr(part, name) for part in parts]
            complete = all(column is not None for column in columns)
            changes[name] = np.concatenate(columns) if complete else None
        changes["series"] = np.concatenate(list(_renumbered(part.series for part in parts)))
        changes["simulated"] = any(part.simulated for part in parts)
        changes["tared"] = all(part.tared for part in parts)
        stated = [part.reference for part in parts if part.reference is not None]
        larger = reduce(lambda one, other: one.larger(other), stated) if stated else None
        changes["reference"] = larger
        days = [part.measured_on for part in parts]
        known_days = [day for day in days if day is not None]
        changes["measured_on"] = min(known_days) if len(known_days) == len(days) else None
        return replace(head, **changes)


OPTIONAL_COLUMNS = tuple(
    column.name for column in fields(CalibrationData) if column.type == NDArray[np.float64] | None
)
"""Columns of a calibration beside readings, standard, series and branch."""

PLACE_COLUMNS = ("row", "table")
"""Columns that state the row and table of a point: no part of its data."""


def infer_branch(standard_nm: ArrayLike, series: ArrayLike) -> NDArray[np.int8]:
    """Return the branch of each point of a table that is in measuring order.

    Within a series a point is up where |standard| is larger than at the point before (or where the
    torque has changed its direction) and down where it is smaller. Changes below 0.1 % of the
    largest |standard| are ignored: such a point keeps the branch of the point before. The first
    point of a series has the branch of the next one, and a series of one point is up.

    Parameters
    ----------
    standard_nm : array of float, shape (n,)
        Torque of the standard, in N·m, in measuring order within each series.
    series : array of int, shape (n,)
        Number of the series of each point.

    Returns
    -------
    array of int8, shape (n,)
        +1 up, -1 down.

    Raises
    ------
    InputError
        Where the lengths differ or a value isn't finite.

    Examples
    --------
    >>> infer_branch([0.0, 5.0, 10.0, 5.0, 0.0], [1, 1, 1, 1, 1]).tolist()
    [1, 1, 1, -1, -1]
    """
    standard = _column("standard_nm", standard_nm, int(np.size(standard_nm)))
    numbers = _column("series", series, standard.size)
    tolerance = UNLOADED_SHARE * float(np.max(np.abs(standard), initial=0.0))
    branch = np.ones(standard.size, dtype=np.int8)
    for number in np.unique(numbers):
        where = np.flatnonzero(numbers == number)
        branch[where] = _branch_of_series(standard[where], tolerance)
    return branch


def infer_series(standard_nm: ArrayLike) -> NDArray[np.int64]:
    """Return the number of the series of each point of a table in measuring order, from 1.

    A series is at most one rise and fall in each direction. Where torque rises again in a direction
    in which it has fallen, the next series begins, with the last of the unloaded points before.

    Examples
    --------
    >>> infer_series([0.0, 5.0, 0.0, -5.0, 0.0, 5.0, 10.0, 5.0, 0.0]).tolist()
    [1, 1, 1, 1, 1, 2, 2, 2, 2]
    """
    standard = _column("standard_nm", standard_nm, int(np.size(standard_nm)))
    branch = infer_branch(standard, np.ones(standard.size))
    loaded = np.abs(standard) > UNLOADED_SHARE * float(np.max(np.abs(standard), initial=0.0))
    size, side = np.abs(standard), standard > 0
    starts: list[int] = []
    fallen: set[bool] = set()
    last = -1
    for row in np.flatnonzero(loaded).tolist():
        if last >= 0:
            rises = branch[row] > 0 and (branch[last] < 0 or size[row] < size[last])
            if rises or side[row] != side[last]:
                fallen.add(bool(side[last]))
                if bool(side[row]) in fallen:
                    # A single reading between them belongs to the end of the series before.
                    repeated = row == last + 1 and last > 0 and size[last] == size[last - 1]
                    starts.append(row - 1 if row > last + 2 or repeated else row)
                    fallen = set()
        last = row
    return np.asarray(np.searchsorted(starts, np.arange(standard.size), side="right") + 1)


def plainest(value: float, within: float) -> float:
    """Return the number with the fewest digits that deviates from a value by at most a share of it.

    Examples
    --------
    >>> plainest(99.97, 1e-3), plainest(93.7, 1e-3)
    (100.0, 93.7)
    """
    rounded = (float(f"{value:.{digits}g}") for digits in range(1, 8))
    return next((number for number in rounded if abs(number - value) <= within * abs(value)), value)


def _branch_of_series(torque: NDArray[np.float64], tolerance: float) -> NDArray[np.int8]:
    """Return the branch of each point from the changes of the torque within a series."""
    growth = np.diff(np.abs(torque))
    step = np.where(growth > tolerance, 1, np.where(growth < -tolerance, -1, 0))
    loaded = np.abs(torque) > tolerance
    crossed = (np.sign(torque[1:]) != np.sign(torque[:-1])) & loaded[1:] & loaded[:-1]
    step[crossed] = 1
    moving = np.flatnonzero(step)
    if moving.size == 0:
        return np.ones(torque.size, dtype=np.int8)
    # Each unknown change takes the last known one; changes before the first known one take that
    # one.
    last_known = np.maximum.accumulate(np.where(step != 0, np.arange(step.size), -1))
    filled = step[np.where(last_known >= 0, last_known, moving[0])]
    return np.concatenate([filled[:1], filled]).astype(np.int8)


def _renumbered(parts: Iterable[NDArray[np.int64]]) -> Iterable[NDArray[np.int64]]:
    """Yield the parts' series with numbers that go on from part to part."""
    taken = 0
    for series in parts:
        shifted = series - series.min() + 1 + taken
        taken = int(shifted.max())
        yield shifted


def _column(name: str, value: ArrayLike, n: int) -> NDArray[Any]:
    """Return a column as an array of n finite numbers, or refuse it."""
    try:
        column = np.array(branch_values(value) if name == "branch" else value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            Message("column {name} contains values that aren't numbers", name), "numbers"
        ) from error
    if column.shape != (n,):
        raise InputError(
            Message("column {name} has shape {shape}", name, column.shape),
            Message("{n} values like reading_nm", n),
        )
    bad = np.flatnonzero(~np.isfinite(column))
    if bad.size:
        raise InputError(
            Message(
                "column {name} holds {column} at point {bad}", name, column[bad[0]], bad[0] + 1
            ),
            "finite numbers",
            "remove the point or measure it again",
        )
    if name in ("series", "branch", "row"):
        column = _whole_numbers(name, column)
    column.flags.writeable = False
    return column


def _whole_numbers(name: str, column: NDArray[np.float64]) -> NDArray[Any]:
    """Return a column as integers; refuse other numbers."""
    rounded = np.rint(column)
    bad = np.flatnonzero(rounded != column)
    if bad.size:
        raise InputError(
            Message("{name} {column} at point {bad}", name, column[bad[0]], bad[0] + 1),
            "whole numbers",
        )
    return rounded.astype(
        np.int8 if name == "branch" and np.all(np.abs(rounded) <= 1) else np.int64
    )


def _check_branch(branch: NDArray[np.int8]) -> None:
    """Refuse branches other than +1, -1 and 0."""
    bad = np.flatnonzero(np.abs(branch) > 1)
    if bad.size:
        raise InputError(
            Message("branch {branch} at point {bad}", branch[bad[0]], bad[0] + 1),
            "+1 (up), -1 (down) or 0 (unknown)",
        )


def _check_range(standard: NDArray[np.float64], range_nm: float) -> None:
    """Refuse a standard's torque beyond the range, margin included."""
    limit = range_nm * (1 + RANGE_MARGIN)
    worst = int(np.argmax(np.abs(standard)))
    if abs(standard[worst]) > limit:
        raise InputError(
            Message("standard_nm {value:.6g} N·m at point {worst}", standard[worst], worst + 1),
            Message(
                "±{limit:.6g} N·m (range {range:.6g} N·m and {percent:.0f} %)",
                limit,
                range_nm,
                100 * RANGE_MARGIN,
            ),
            "check the range, or remove the point",
        )
