"""Static evaluation of a calibration in steps: deviations in % of reading, uncertainty, class.

Quantities and formulas follow the general practice of EURAMET cg-14 and DIN 51309 as far as it is
public; they were not checked against the licensed texts, and don't claim conformity.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

FloatArray = NDArray[np.float64]
DEGREES = (1, 2, 3)
Reproducibility = Literal["range", "standard-deviation"]
"""Form of the reproducibility: range over the positions, or their standard deviation."""

CLASSES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)

PERCENT_DIGITS = 4
"""Decimals to which quantities in % are stated, and compared with the limits of a class."""


@dataclass(frozen=True, eq=False)
class LoadingSeries:
    """One increasing series and, if it was measured, the decreasing one after it.

    Parameters
    ----------
    position_deg : float
        Mounting position.
    increasing : array of float, shape (m,)
        Deflections X = I − I₀ at the steps, in the unit of the indication, above 0; NaN at steps
        that the series doesn't have.
    decreasing : array of float, shape (m,), optional
        Deflections X′ at the same steps (in rising order of torque) with decreasing torque.
    zero_return : float, optional
        Indication without load after the series, I_f − I₀.
    """

    position_deg: float
    increasing: FloatArray
    decreasing: FloatArray | None = None
    zero_return: float | None = None


@dataclass(frozen=True, eq=False)
class Interpolation:
    """A polynomial through zero that describes the mean deflection, and its residuals.

    Parameters
    ----------
    degree : int
        1, 2 or 3.
    coefficients : array of float, shape (degree,)
        Coefficients of M, M², M³, in the unit of the indication per (N·m)ᵏ.
    deviation_percent : array of float, shape (m,)
        f_a = (X̄ − X_a)/X_a at the steps, in %.
    largest_nm : float
        Largest torque.
    """

    degree: int
    coefficients: FloatArray
    deviation_percent: FloatArray
    largest_nm: float = 1.0

    @property
    def equation(self) -> str:
        """The polynomial as text, for M in N·m, to 10⁻⁹ of its value at the largest torque.

        Examples
        --------
        >>> Interpolation(2, np.array([1.0002, -3e-7]), np.zeros(3), 100.0).equation
        'X_a = 1.0002·M − 3e-07·M²'
        """
        text = "X_a ="
        size = np.abs(self.coefficients) * self.largest_nm ** np.arange(1, self.degree + 1)
        for power, value, part in zip(("M", "M²", "M³"), self.coefficients, size, strict=False):
            if part > 1e-9 * size.max():
                sign = "−" if value < 0 else "+"
                text += f" {sign} {abs(value):.{max(1, int(10 + np.log10(part / size.max())))}g}"
                text += f"·{power}"
        return text.replace("= + ", "= ").replace("= − ", "= −")


@dataclass(frozen=True)
class Regression:
    """Straight line of the deflections over the reference torque, X = slope · M + intercept.

    Parameters
    ----------
    slope, intercept : float
        In the unit of the indication, per N·m.
    see : float
        Standard error of estimate, with n − 2 degrees of freedom; NaN of two points.
    r_squared : float
        Coefficient of determination.

    References
    ----------
    40 CFR 1065.602, equations for slope, intercept, SEE and r².
    """

    slope: float
    intercept: float
    see: float
    r_squared: float
    points: int


def regression(torque_nm: ArrayLike, deflection: ArrayLike) -> Regression | None:
    """Return the least-squares line of deflections over torques; None for fewer than two torques.

    Examples
    --------
    >>> regression([0, 1, 2], [1, 3, 5])
    Regression(slope=2.0, intercept=1.0, see=0.0, r_squared=1.0, points=3)
    """
    x, y = (np.asarray(values, dtype=np.float64) for values in (torque_nm, deflection))
    if x.size < 2 or np.ptp(x) == 0.0:
        return None
    across, up = x - x.mean(), y - y.mean()
    slope = float(across @ up / (across @ across))
    squares = float(np.sum((up - slope * across) ** 2))
    return Regression(
        slope=slope,
        intercept=float(y.mean() - slope * x.mean()),
        see=float(np.sqrt(squares / (x.size - 2))) if x.size > 2 else float("nan"),
        r_squared=1.0 - squares / float(up @ up) if np.any(up) else 0.0,
        points=int(x.size),
    )


@dataclass(frozen=True, eq=False)
class StaticEvaluation:
    """All quantities of a static calibration; relative ones in % of the mean deflection.

    A quantity is NaN at a step where it wasn't measured, and None if it was never measured.

    Parameters
    ----------
    torque_nm : array of float, shape (m,)
        The steps M.
    mean : array of float, shape (m,)
        Mean deflection X̄ of the increasing series.
    positions : array of int, shape (m,)
        Number of positions at each step, n.
    span, sensitivity : float
        X̄ at the largest torque, and the same per N·m.
    repeatability_percent : array of float, shape (m,), or None
        b′: the largest range over series of one position; None without a repeated series.
    reproducibility_range_percent, reproducibility_deviation_percent : array, shape (m,), or None
        b in range and standard-deviation form; None for a single position.
    interpolations : mapping of int to Interpolation
        By degree.
    reversibility_percent : array of float, shape (m,), or None
        h; None without a decreasing series.
    zero_residual_percent : float or None
        f₀, relative to the span; None where no zero was read before and after a series.
    indication_deviation_percent : array of float, shape (m,), or None
        f_q; None without a fixed scale.
    resolution_percent : array of float, shape (m,)
        r/X̄.
    reference_uncertainty_percent : float or array of float, shape (m,)
        W of the reference torque, k = 2.
    """

    torque_nm: FloatArray
    mean: FloatArray
    positions: NDArray[np.intp]
    span: float
    sensitivity: float
    repeatability_percent: FloatArray | None
    reproducibility_range_percent: FloatArray | None
    reproducibility_deviation_percent: FloatArray | None
    interpolations: Mapping[int, Interpolation]
    reversibility_percent: FloatArray | None
    zero_residual_percent: float | None
    indication_deviation_percent: FloatArray | None
    resolution_percent: FloatArray
    reference_uncertainty_percent: float | FloatArray

    def interpolation(self, degree: int) -> Interpolation:
        """Return the interpolation of a degree.

        Raises
        ------
        InputError
            Where there are too few steps for it.
        """
        if degree not in self.interpolations:
            raise InputError(
                Message(
                    "an interpolation of degree {degree} through {size} steps",
                    degree,
                    self.torque_nm.size,
                ),
                Message("the degrees {degrees}", ", ".join(map(str, self.interpolations))),
            )
        return self.interpolations[degree]

    def reproducibility_percent(self, form: Reproducibility) -> FloatArray | None:
        """Return b in one of its forms, shape (m,), or None for a single position."""
        if form == "range":
            return self.reproducibility_range_percent
        return self.reproducibility_deviation_percent

    def components(
        self, degree: int, form: Reproducibility, *, decreasing: bool
    ) -> dict[str, FloatArray]:
        """Return the standard uncertainties that make up the combined one, in %.

        A step at which a quantity wasn't measured takes its largest value at the other steps.

        Parameters
        ----------
        degree : int
            Degree of the interpolation.
        form : {"range", "standard-deviation"}
            Form of the reproducibility.
        decreasing : bool
            Whether decreasing torque counts, so that the reversibility enters.

        Returns
        -------
        dict of str to array, shape (m,)
            Quantities by name; a quantity that wasn't measured is left out. The resolution enters
            twice: at the indication and at the zero.

        Raises
        ------
        InputError
            If decreasing torque shall count and wasn't measured.
        """
        ones = np.ones_like(self.torque_nm)
        components = {
            "reference": self.reference_uncertainty_percent / 2.0 * ones,
            "resolution": self.resolution_percent / (2.0 * np.sqrt(3.0)),
            "resolution of the zero": self.resolution_percent / (2.0 * np.sqrt(3.0)),
            "interpolation": self.interpolation(degree).deviation_percent / np.sqrt(6.0),
        }
        if self.repeatability_percent is not None:
            components["repeatability"] = self.repeatability_percent / (2.0 * np.sqrt(3.0))
        b = self.reproducibility_percent(form)
        if b is not None:
            divisor = 2.0 * np.sqrt(2.0) if form == "range" else np.sqrt(self.positions)
            components["reproducibility"] = b / divisor
        if self.zero_residual_percent is not None:
            components["zero residual"] = self.zero_residual_percent / (2.0 * np.sqrt(3.0)) * ones
        if decreasing:
            if self.reversibility_percent is None:
                raise InputError("no decreasing series", "one, to include decreasing torque")
            components["reversibility"] = self.reversibility_percent / (2.0 * np.sqrt(3.0))
        sizes = {name: np.abs(values) for name, values in components.items()}
        return {
            name: np.where(np.isnan(size), np.nanmax(size), size) for name, size in sizes.items()
        }

    def uncertainty_percent(
        self, degree: int, form: Reproducibility, *, decreasing: bool
    ) -> FloatArray:
        """Return the expanded uncertainty W (k = 2) about the interpolation, in %, shape (m,)."""
        squares = [w**2 for w in self.components(degree, form, decreasing=decreasing).values()]
        return np.asarray(2.0 * np.sqrt(np.sum(squares, axis=0)), dtype=np.float64)

    def interval_percent(
        self, degree: int, form: Reproducibility, *, decreasing: bool
    ) -> FloatArray:
        """Return the uncertainty interval W′ = |f_q| + W about the fixed scale, in %, shape (m,).

        Raises
        ------
        InputError
            Where the calibration has no fixed scale.
        """
        if self.indication_deviation_percent is None:
            raise InputError("no fixed scale", "the scale that the indication is read with")
        w = self.uncertainty_percent(degree, form, decreasing=decreasing)
        return np.abs(self.indication_deviation_percent) + w


def evaluate_static(
    torque_nm: ArrayLike,
    series: Sequence[LoadingSeries],
    *,
    resolution: float,
    reference_uncertainty_percent: float | FloatArray,
    scale: float | None = None,
) -> StaticEvaluation:
    """Evaluate a calibration in steps.

    Each step is evaluated over the series that have it. If the first of several positions has two
    series, the second one is the repeat and contributes to b′ only; other series of a position are
    averaged.

    Parameters
    ----------
    torque_nm : array of float, shape (m,)
        Steps of the deflections, rising, above 0, in N·m.
    series : sequence of LoadingSeries
        In the order in which they were measured.
    resolution : float
        Resolution r, in the unit of the indication.
    reference_uncertainty_percent : float or array of float, shape (m,)
        Expanded uncertainty (k = 2) of the reference torque, in % of it.
    scale : float, optional
        Fixed indication per N·m: 1 for a scale in N·m. Without it there is no f_q.

    Raises
    ------
    InputError
        Where the steps don't rise, a step has no increasing deflection, lengths differ, or a value
        is infinite.

    Examples
    --------
    >>> first = LoadingSeries(0.0, np.array([5.01, 10.0]))
    >>> turned = LoadingSeries(120.0, np.array([5.03, 10.0]))
    >>> result = evaluate_static(
    ...     [5.0, 10.0], [first, turned], resolution=0.01, reference_uncertainty_percent=0.02
    ... )
    >>> result.mean.round(6).tolist(), result.reproducibility_range_percent.round(3).tolist()
    ([5.02, 10.0], [0.398, 0.0])
    """
    torque = np.atleast_1d(np.asarray(torque_nm, dtype=np.float64))
    _check(torque, series, resolution, reference_uncertainty_percent)
    positions: dict[float, list[FloatArray]] = {}
    for loading in series:
        positions.setdefault(loading.position_deg, []).append(loading.increasing)
    tables = [np.stack(rows) for rows in positions.values()]
    averaged = [rows[:1] if k == 0 and len(tables) > 1 and len(rows) == 2 else rows
                for k, rows in enumerate(tables)]  # fmt: skip
    of_position = np.stack([_mean(rows) for rows in averaged])
    # A step that only the repeat has is evaluated from the repeat.
    lacking = np.all(np.isnan(of_position), axis=0)
    of_position[0, lacking] = _mean(tables[0])[lacking]
    mean = _mean(of_position)
    number = np.sum(np.isfinite(of_position), axis=0)
    several = number > 1
    span = float(mean[-1])
    returns = [abs(loading.zero_return) for loading in series if loading.zero_return is not None]
    spread = np.where(several, _range(of_position), np.nan)
    deviation = np.full(torque.size, np.nan)
    deviation[several] = np.nanstd(of_position[:, several], axis=0, ddof=1)
    return StaticEvaluation(
        torque_nm=torque,
        mean=mean,
        positions=number,
        span=span,
        sensitivity=span / float(torque[-1]),
        repeatability_percent=_known(_repeatability(tables)),
        reproducibility_range_percent=_known(100.0 * spread / mean),
        reproducibility_deviation_percent=_known(100.0 * deviation / mean),
        interpolations={
            degree: _interpolate(torque, mean, degree) for degree in DEGREES if torque.size > degree
        },
        reversibility_percent=_known(_reversibility(series, mean)),
        zero_residual_percent=100.0 * max(returns) / span if returns else None,
        indication_deviation_percent=(
            None if scale is None else 100.0 * (mean - scale * torque) / (scale * torque)
        ),
        resolution_percent=100.0 * resolution / mean,
        reference_uncertainty_percent=reference_uncertainty_percent,
    )


def _known(values: FloatArray) -> FloatArray | None:
    return None if np.all(np.isnan(values)) else values


def _mean(rows: FloatArray) -> FloatArray:
    """Return the mean of the finite values of each column; NaN without any."""
    finite = np.isfinite(rows)
    count = finite.sum(axis=0)
    total = np.where(finite, rows, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _range(rows: FloatArray) -> FloatArray:
    """Return the range of each column; NaN for a column without values."""
    low = np.where(np.isnan(rows), np.inf, rows).min(axis=0)
    high = np.where(np.isnan(rows), -np.inf, rows).max(axis=0)
    return np.where(np.isfinite(low), high - low, np.nan)


def _repeatability(tables: Sequence[FloatArray]) -> FloatArray:
    """Return the largest range over series of one position, in % of their mean."""
    relative = [
        np.where(np.isfinite(rows).sum(axis=0) > 1, 100.0 * _range(rows) / _mean(rows), np.nan)
        for rows in tables
    ]
    return np.asarray(np.fmax.reduce(relative), dtype=np.float64)


def _reversibility(series: Sequence[LoadingSeries], mean: FloatArray) -> FloatArray:
    """Return the mean difference of decreasing and increasing deflections, in %.

    A decreasing series without its own increasing deflection is compared with the mean.
    """
    differences = [
        np.abs(
            loading.decreasing - np.where(np.isnan(loading.increasing), mean, loading.increasing)
        )
        for loading in series
        if loading.decreasing is not None
    ]
    if not differences:
        return np.full(mean.size, np.nan)
    return 100.0 * _mean(np.stack(differences)) / mean


def _interpolate(torque: FloatArray, mean: FloatArray, degree: int) -> Interpolation:
    """Fit a polynomial without a constant to the mean deflections."""
    # Torques scaled to 1 keep the powers well conditioned; one refinement step removes the rounding
    # error of the residual, which matters because f_a is a small difference of large numbers.
    largest = float(torque[-1])
    powers = np.arange(1, degree + 1)
    columns = (torque[:, None] / largest) ** powers
    scaled = np.linalg.lstsq(columns, mean, rcond=None)[0]
    scaled += np.linalg.lstsq(columns, mean - columns @ scaled, rcond=None)[0]
    fitted = columns @ scaled
    return Interpolation(
        degree=degree,
        coefficients=np.asarray(scaled / largest**powers, dtype=np.float64),
        deviation_percent=np.asarray(100.0 * (mean - fitted) / fitted, dtype=np.float64),
        largest_nm=largest,
    )


def _check(
    torque: FloatArray,
    series: Sequence[LoadingSeries],
    resolution: float,
    reference_uncertainty_percent: float | FloatArray,
) -> None:
    """Refuse steps and series that a static evaluation can't take."""
    if torque.size < 2 or not np.all(np.diff(torque, prepend=0.0) > 0):
        raise InputError(
            Message("steps {torque} N·m", torque.tolist()),
            "at least two rising steps above 0",
            "sort them",
        )
    if not series:
        raise InputError("no series", "at least one increasing series")
    for number, loading in enumerate(series, start=1):
        for name, values in (
            ("increasing", loading.increasing),
            ("decreasing", loading.decreasing),
        ):
            if values is not None and (values.shape != torque.shape or np.any(np.isinf(values))):
                raise InputError(
                    Message(
                        "series {number} has {name} values {values}", number, name, values.tolist()
                    ),
                    Message("{size} deflections, one per step, NaN where unknown", torque.size),
                )
        if np.any(loading.increasing <= 0):
            raise InputError(
                Message(
                    "series {number} has a deflection of {increasing:.6g}",
                    number,
                    np.nanmin(loading.increasing),
                ),
                "deflections above 0",
                "subtract the zero of the series; give counter-clockwise torque as magnitudes",
            )
    unknown = np.all([np.isnan(loading.increasing) for loading in series], axis=0)
    if np.any(unknown):
        raise InputError(
            Message("no increasing deflection at {torque:g} N·m", torque[unknown][0]),
            "an increasing series with every step",
            "leave the step out",
        )
    for name, value in (
        ("resolution", resolution),
        ("uncertainty of the reference", reference_uncertainty_percent),
    ):
        if not np.all(np.isfinite(value) & (np.asarray(value) >= 0)):
            raise InputError(Message("{name} {value}", name, value), "a finite number, 0 or more")


@dataclass(frozen=True)
class ClassLimits:
    """Limits of one class, in %.

    Parameters
    ----------
    reproducibility, repeatability, interpolation, indication, reversibility : float
        Limits of b, b′, |f_a|, |f_q| and h, of reading.
    zero_residual : float
        Limit of f₀, of the span.
    resolution : float
        Limit of r/X̄: the range starts at M_A ≥ (200/class)·r.
    reference : float
        Limit of the expanded uncertainty of the reference torque.
    """

    reproducibility: float
    repeatability: float
    interpolation: float
    indication: float
    zero_residual: float
    reversibility: float
    resolution: float
    reference: float


@dataclass(frozen=True, eq=False)
class Classification:
    """Range over which a calibration meets each class.

    Parameters
    ----------
    starts_nm : dict of float to float or None
        For each class, the smallest step from which all steps up to the largest meet every limit;
        None if the largest doesn't.
    whole_range : float or None
        Best class over all steps.
    """

    starts_nm: dict[float, float | None]
    whole_range: float | None

    def __str__(self) -> str:
        words: list[str] = []
        for each, start in sorted(self.starts_nm.items(), reverse=True):
            if start is None or (self.whole_range is not None and each > self.whole_range):
                continue
            if each == self.whole_range:
                words.append(Message("class {name:g} over the whole range", each))
            else:
                words.append(Message("class {name:g} from {start:g} N·m", each, start))
        return Message.joined(words) if words else "within no class"


def limits_of_class(accuracy_class: float) -> ClassLimits:
    """Return the limits of a class.

    Raises
    ------
    InputError
        Where there is no such class.

    Examples
    --------
    >>> limits = limits_of_class(0.05)
    >>> limits.repeatability, limits.zero_residual, limits.reversibility
    (0.025, 0.0125, 0.063)
    """
    if accuracy_class not in CLASSES:
        raise InputError(
            Message("class {accuracy_class}", accuracy_class), ", ".join(map(str, CLASSES))
        )
    c = accuracy_class
    rounded_up = {0.05: 0.063, 0.5: 0.63}
    return ClassLimits(
        reproducibility=c,
        repeatability=c / 2,
        interpolation=c / 2,
        indication=c / 2,
        zero_residual=c / 4,
        reversibility=rounded_up.get(c, 1.25 * c),
        resolution=c / 2,
        reference=c / 5,
    )


def classify(
    evaluation: StaticEvaluation,
    *,
    degree: int,
    decreasing: bool,
    fixed_scale: bool = False,
) -> Classification:
    """Find the class of a calibration and the range over which each class is met.

    Quantities are rounded to `PERCENT_DIGITS` decimals before the comparison, as they are stated. A
    step at which a quantity wasn't measured meets no class.

    Parameters
    ----------
    evaluation : StaticEvaluation
        The calibration's quantities.
    degree : int
        Degree of the interpolation.
    decreasing : bool
        Whether decreasing torque counts.
    fixed_scale : bool, default False
        Whether the indication is read with a fixed scale, so that f_q counts instead of f_a.

    Raises
    ------
    InputError
        A quantity that a class needs wasn't measured.
    """
    starts: dict[float, float | None] = {}
    for accuracy_class in CLASSES:
        meets = np.ones(evaluation.torque_nm.shape, dtype=np.bool_)
        limits = limits_of_class(accuracy_class)
        for name, values, limit in _limited(evaluation, limits, degree, decreasing, fixed_scale):
            if values is None:
                raise InputError(
                    Message("a calibration without {name}", name),
                    "every quantity that the class limits",
                    "measure it, or state the uncertainty without a class",
                )
            meets &= np.round(np.abs(values), PERCENT_DIGITS) <= limit
        failing = np.flatnonzero(~meets)
        first = 0 if failing.size == 0 else int(failing[-1]) + 1
        starts[accuracy_class] = float(evaluation.torque_nm[first]) if first < meets.size else None
    smallest = float(evaluation.torque_nm[0])
    classes = [accuracy_class for accuracy_class, start in starts.items() if start == smallest]
    return Classification(starts_nm=starts, whole_range=min(classes, default=None))


def _limited(
    evaluation: StaticEvaluation,
    limits: ClassLimits,
    degree: int,
    decreasing: bool,
    fixed_scale: bool,
) -> Iterator[tuple[str, float | FloatArray | None, float]]:
    """Yield name, values and limit of every quantity that a class limits."""
    e = evaluation
    yield "a repeated series (b′)", e.repeatability_percent, limits.repeatability
    yield "a second position (b)", e.reproducibility_percent("range"), limits.reproducibility
    yield "a zero after a series (f₀)", e.zero_residual_percent, limits.zero_residual
    yield "the resolution", e.resolution_percent, limits.resolution
    yield "the reference's uncertainty", e.reference_uncertainty_percent, limits.reference
    if fixed_scale:
        yield "a fixed scale (f_q)", e.indication_deviation_percent, limits.indication
    else:
        yield "an interpolation", e.interpolation(degree).deviation_percent, limits.interpolation
    if decreasing:
        yield "a decreasing series (h)", e.reversibility_percent, limits.reversibility
