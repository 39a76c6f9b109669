"""Drift of a chain between calibrations: control chart, trend, due date."""

from dataclasses import dataclass
from datetime import date, datetime, timedelta

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.calibration.data import CalibrationData
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import DAY, DAYS_PER_YEAR

INDIVIDUALS_FACTOR = 2.660
"""3/d₂ for moving ranges of two (d₂ = 1.128): limits of single values about their mean."""

RANGE_FACTOR = 3.267
"""D₄ for moving ranges of two: upper limit of the moving range."""

RUN_LENGTH = 8
"""Number of values in a row on one side of the mean that are a signal (Western Electric rule 4)."""

_LEVEL = 0.95  # of the prediction interval


@dataclass(frozen=True, eq=False)
class ControlChart:
    """Individuals chart with moving range (ISO 7870-2).

    Attributes
    ----------
    values : float64[n]
        In the order of time.
    centre, lower, upper : float
        Mean of the base values, and limits of single values about it.
    moving_range_mean, moving_range_upper : float
        Mean of the base's moving ranges, and the upper limit of a single one.
    outside : tuple of int
        Values outside the limits, from 0.
    jumps : tuple of int
        Values whose moving range exceeds its limit.
    runs : tuple of int
        Values at which `RUN_LENGTH` in a row lie on one side of the centre.
    """

    values: NDArray[np.float64]
    centre: float
    lower: float
    upper: float
    moving_range_mean: float
    moving_range_upper: float
    outside: tuple[int, ...]
    jumps: tuple[int, ...]
    runs: tuple[int, ...]

    @property
    def in_control(self) -> bool:
        """Whether the values show only random variation."""
        return not (self.outside or self.jumps or self.runs)


@dataclass(frozen=True)
class Trend:
    """Test for a steady change of values with time, and the fitted line.

    Attributes
    ----------
    tau, p_value : float
        Kendall's rank correlation with time, and the probability of one at least as strong by
        chance (Mann-Kendall test, two-sided, exact for few values without ties).
    per_year : float
        Slope of the line of least squares, in units of the value per year.
    significant : bool
        Whether the p-value is below the requested level.
    """

    tau: float
    p_value: float
    per_year: float
    significant: bool


@dataclass(frozen=True)
class DriftPrediction:
    """Predicted time at which a value leaves its tolerance.

    Attributes
    ----------
    earliest : datetime or None
        Time at which the prediction interval first reaches a limit; None if not within the horizon.
    expected : datetime or None
        Time at which the line reaches it.
    latest : datetime or None
        Time at which the whole interval is beyond it.
    per_year : float
        Slope of the line, in units of the value per year.
    level : float
        Level of the prediction interval of a single further value.
    horizon : datetime
        End of the prediction.
    """

    earliest: datetime | None
    expected: datetime | None
    latest: datetime | None
    per_year: float
    level: float
    horizon: datetime


def span_errors(data: CalibrationData) -> dict[str, float]:
    """Return the error of the span of a calibration in each direction, in %.

    It is the slope of reading over standard through zero, by least squares, minus 1: one number for
    comparisons of repeated calibrations.

    Examples
    --------
    >>> data = CalibrationData([5.01, 10.02, -10.0], [5.0, 10.0, -10.0], [1] * 3, [1] * 3, 10.0)
    >>> {name: round(value, 6) for name, value in span_errors(data).items()}
    {'clockwise': 0.2, 'counter-clockwise': 0.0}
    """
    errors = {}
    for sign, name in ((1, "clockwise"), (-1, "counter-clockwise")):
        here = data.direction == sign
        if np.any(here):
            reading, standard = data.reading_nm[here], data.standard_nm[here]
            slope = float(np.dot(reading, standard) / np.dot(standard, standard))
            errors[name] = 100.0 * (slope - 1.0)
    return errors


def individuals_chart(values: ArrayLike, base: int | None = None) -> ControlChart:
    """Return the individuals chart of values in the order of time.

    Parameters
    ----------
    values : array of float, shape (n,)
        At least 3.
    base : int, optional
        Number of first values from which the limits are computed; all by default.

    Raises
    ------
    InputError
        Where there are fewer than 3 base values, or one isn't finite.

    References
    ----------
    D. C. Montgomery, Introduction to Statistical Quality Control, section 6.4: limits
    x̄ ± 3 MR̄/1.128 and 3.267 MR̄.

    Examples
    --------
    >>> chart = individuals_chart([10.0, 12.0, 11.0, 13.0])
    >>> round(chart.centre, 3), round(chart.upper, 3), round(chart.moving_range_upper, 3)
    (11.5, 15.933, 5.445)
    """
    x = _finite(values)
    count = x.size if base is None else base
    if not 3 <= count <= x.size:
        raise InputError(
            Message("a control chart over {count} values with {base} as its base", x.size, count),
            "at least 3 values, and no more base values than values",
            "calibrate or zero more often first",
        )
    moving = np.abs(np.diff(x))
    centre = float(x[:count].mean())
    mean_range = float(moving[: count - 1].mean())
    reach = INDIVIDUALS_FACTOR * mean_range
    limit = RANGE_FACTOR * mean_range
    side = np.sign(x - centre)
    ends = range(RUN_LENGTH, x.size + 1)
    runs = [end - 1 for end in ends if abs(side[end - RUN_LENGTH : end].sum()) == RUN_LENGTH]
    return ControlChart(
        values=x,
        centre=centre,
        lower=centre - reach,
        upper=centre + reach,
        moving_range_mean=mean_range,
        moving_range_upper=limit,
        outside=tuple(int(k) for k in np.flatnonzero(np.abs(x - centre) > reach)),
        jumps=tuple(int(k) + 1 for k in np.flatnonzero(moving > limit)),
        runs=tuple(runs),
    )


def find_trend(moments: list[datetime], values: ArrayLike) -> Trend | None:
    """Test values for a steady change with time; None for fewer than 4 different times.

    It is significant below a p-value of 5 %.

    Parameters
    ----------
    moments : list of datetime
        Time of each value.
    values : array of float, shape (n,)

    References
    ----------
    H. B. Mann, Econometrica 13 (1945) 245; M. G. Kendall, Rank Correlation Methods (1975).

    Examples
    --------
    >>> days = [datetime(2025, month, 1) for month in range(1, 9)]
    >>> trend = find_trend(days, [0.01, 0.012, 0.02, 0.019, 0.03, 0.034, 0.041, 0.05])
    >>> round(trend.tau, 3), trend.significant
    (0.929, True)
    """
    years, x = _years(moments), _finite(values)
    if np.unique(years).size < 4:
        return None
    # If all values are equal, there is neither trend nor correlation.
    if np.ptp(x) == 0.0:
        return Trend(0.0, 1.0, 0.0, significant=False)
    from scipy import stats  # imported late: an evaluation doesn't need SciPy's statistics

    rank = stats.kendalltau(years, x)
    line = stats.linregress(years, x)
    return Trend(
        tau=float(rank.statistic),
        p_value=float(rank.pvalue),
        per_year=float(line.slope),
        significant=bool(rank.pvalue < 0.05),
    )


def predict_drift(
    moments: list[datetime],
    values: ArrayLike,
    tolerance: float,
    *,
    centre: float = 0.0,
    horizon_years: float = 10.0,
) -> DriftPrediction:
    """Predict when a value leaves centre ± tolerance, by a line through its history.

    The interval, of 95 %, is that of a single further value (Montgomery, eq. 10.46): it contains
    the line's uncertainty, which grows with the distance from the data, and the scatter about it.

    Parameters
    ----------
    moments : list of datetime
        Time of each value, at least 3 different times.
    values : array of float, shape (n,)
    tolerance : float
        Tolerance, in the unit of the values.
    centre : float
        Centre of the tolerance.
    horizon_years : float
        Length of the prediction after the last value, years.

    Raises
    ------
    InputError
        Where there are fewer than 3 moments, or the tolerance isn't above 0.

    Examples
    --------
    >>> days = [datetime(2020 + year, 1, 1) for year in range(5)]
    >>> found = predict_drift(days, [0.0, 0.011, 0.019, 0.031, 0.04], 0.1)
    >>> found.expected.year, found.earliest < found.expected < found.latest
    (2029, True)
    """
    years, x = _years(moments), _finite(values)
    if np.unique(years).size < 3:
        raise InputError(
            Message("a prediction from {size} moments", np.unique(years).size),
            "at least 3",
            "calibrate again",
        )
    from scipy import stats

    if not (np.isfinite(tolerance) and tolerance > 0):
        raise InputError(Message("tolerance {tolerance}", tolerance), "a finite tolerance above 0")
    line = stats.linregress(years, x)
    residual = x - line.intercept - line.slope * years
    freedom = x.size - 2
    scatter = float(np.sqrt(np.sum(residual**2) / freedom))
    spread = float(np.sum((years - years.mean()) ** 2))
    factor = float(stats.t.ppf(0.5 + _LEVEL / 2.0, freedom))
    grid = years.max() + np.linspace(0.0, horizon_years, 3651)
    middle = line.intercept + line.slope * grid - centre
    reach = factor * scatter * np.sqrt(1.0 + 1.0 / x.size + (grid - years.mean()) ** 2 / spread)
    first = min(moments)

    def when(outside: NDArray[np.bool_]) -> datetime | None:
        """Return the first moment at which a condition holds; None if it never does."""
        if not np.any(outside):
            return None
        return first + timedelta(days=float(grid[int(np.argmax(outside))]) * DAYS_PER_YEAR)

    away = np.abs(middle)
    return DriftPrediction(
        earliest=when(away + reach >= tolerance),
        expected=when(away >= tolerance),
        latest=when(away - reach >= tolerance),
        per_year=float(line.slope),
        level=_LEVEL,
        horizon=first + timedelta(days=float(grid[-1]) * DAYS_PER_YEAR),
    )


def propose_due_date(
    last: datetime, prediction: DriftPrediction | None, *, longest_days: int = 365
) -> date:
    """Return the proposed date of the next calibration.

    It is before the prediction interval reaches the tolerance, and at most `longest_days` after the
    last calibration; if the interval has already reached the tolerance, it is today.

    Examples
    --------
    >>> propose_due_date(datetime(2025, 1, 31), None).isoformat()
    '2026-01-31'
    """
    latest = last + timedelta(days=longest_days)
    if prediction is not None and prediction.earliest is not None:
        latest = min(latest, max(prediction.earliest, last))
    return latest.date()


def _finite(values: ArrayLike) -> NDArray[np.float64]:
    x = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if x.ndim != 1 or not np.all(np.isfinite(x)):
        raise InputError(Message("values of shape {shape}", x.shape), "a column of finite numbers")
    return x


def _years(moments: list[datetime]) -> NDArray[np.float64]:
    """Return moments as years after the first one."""
    first = min(moments, default=None)
    if first is None:
        return np.empty(0)
    return np.array([(m - first).total_seconds() / DAY / DAYS_PER_YEAR for m in moments])
