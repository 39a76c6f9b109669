"""Static evaluation of a calibration in steps: deviations in % of reading and their uncertainty.

Quantities and formulas follow the general practice of EURAMET cg-14 and DIN 51309 as far as it is
public; they were not checked against the licensed texts, and nothing here claims conformity.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = [
    "Interpolation",
    "LoadingSeries",
    "Reproducibility",
    "StaticEvaluation",
    "evaluate_static",
]

DEGREES = (1, 2, 3)
Reproducibility = Literal["range", "standard-deviation"]
"""Form of the reproducibility: range over the positions, or their standard deviation."""


@dataclass(frozen=True, eq=False)
class LoadingSeries:
    """One increasing series and, if it was measured, the decreasing one after it.

    Parameters
    ----------
    position_deg : float
        Mounting position.
    increasing : array of float, shape (m,)
        Deflections X = I − I₀ at the steps, in the unit of the indication, above 0.
    decreasing : array of float, shape (m,), optional
        Deflections X′ at the same steps (in rising order of torque) with decreasing torque.
    zero_return : float, optional
        Indication without load after the series, I_f − I₀.
    """

    position_deg: float
    increasing: NDArray[np.float64]
    decreasing: NDArray[np.float64] | None = None
    zero_return: float | None = None


@dataclass(frozen=True, eq=False)
class Interpolation:
    """A polynomial through zero that describes the mean deflection, and its residuals.

    Parameters
    ----------
    degree : int
        1, 2 or 3.
    coefficients : array of float, shape (degree,)
        Of M, M², M³, in the unit of the indication per (N·m)ᵏ.
    deviation_percent : array of float, shape (m,)
        f_a = (X̄ − X_a)/X_a at the steps, in %.
    """

    degree: int
    coefficients: NDArray[np.float64]
    deviation_percent: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StaticEvaluation:
    """All quantities of a static calibration; relative ones in % of the mean deflection.

    Parameters
    ----------
    torque_nm : array of float, shape (m,)
        The steps M.
    mean : array of float, shape (m,)
        Mean deflection X̄ of the increasing series in different positions.
    positions : int
        Number of positions, n.
    span, sensitivity : float
        X̄ at the largest torque, and the same per N·m.
    repeatability_percent : array of float, shape (m,), or None
        b′; None without a repeated increasing series in the first position.
    reproducibility_range_percent, reproducibility_deviation_percent : array, shape (m,), or None
        b in range and standard-deviation form; None for a single position.
    interpolations : mapping of int to Interpolation
        By degree.
    reversibility_percent : array of float, shape (m,), or None
        h; None without a decreasing series.
    zero_residual_percent : float or None
        f₀, relative to the span; None where no zero was read after a series.
    indication_deviation_percent : array of float, shape (m,), or None
        f_q; None without a fixed scale.
    resolution_percent : array of float, shape (m,)
        r/X̄.
    reference_uncertainty_percent : float or array of float, shape (m,)
        W of the reference torque, k = 2.
    """

    torque_nm: NDArray[np.float64]
    mean: NDArray[np.float64]
    positions: int
    span: float
    sensitivity: float
    repeatability_percent: NDArray[np.float64] | None
    reproducibility_range_percent: NDArray[np.float64] | None
    reproducibility_deviation_percent: NDArray[np.float64] | None
    interpolations: Mapping[int, Interpolation]
    reversibility_percent: NDArray[np.float64] | None
    zero_residual_percent: float | None
    indication_deviation_percent: NDArray[np.float64] | None
    resolution_percent: NDArray[np.float64]
    reference_uncertainty_percent: float | NDArray[np.float64]

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

    def reproducibility_percent(self, form: Reproducibility) -> NDArray[np.float64] | None:
        """Return b in one of its forms, shape (m,), or None for a single position."""
        if form == "range":
            return self.reproducibility_range_percent
        return self.reproducibility_deviation_percent

    def components(
        self, degree: int, form: Reproducibility, *, decreasing: bool
    ) -> dict[str, NDArray[np.float64]]:
        """Return the standard uncertainties of which the combined one consists, in %.

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
            By name; a quantity that wasn't measured is left out. The resolution enters twice: at
            the indication and at the zero.

        Raises
        ------
        InputError
            Where decreasing torque is to count and wasn't measured.
        """
        ones = np.ones_like(self.torque_nm)
        found = {
            "reference": self.reference_uncertainty_percent / 2.0 * ones,
            "resolution": self.resolution_percent / (2.0 * np.sqrt(3.0)),
            "resolution of the zero": self.resolution_percent / (2.0 * np.sqrt(3.0)),
            "interpolation": self.interpolation(degree).deviation_percent / np.sqrt(6.0),
        }
        if self.repeatability_percent is not None:
            found["repeatability"] = self.repeatability_percent / (2.0 * np.sqrt(3.0))
        b = self.reproducibility_percent(form)
        if b is not None:
            divisor = 2.0 * np.sqrt(2.0) if form == "range" else np.sqrt(self.positions)
            found["reproducibility"] = b / divisor
        if self.zero_residual_percent is not None:
            found["zero residual"] = self.zero_residual_percent / (2.0 * np.sqrt(3.0)) * ones
        if decreasing:
            if self.reversibility_percent is None:
                raise InputError("no decreasing series", "one, to include decreasing torque")
            found["reversibility"] = self.reversibility_percent / (2.0 * np.sqrt(3.0))
        return {name: np.abs(values) for name, values in found.items()}

    def uncertainty_percent(
        self, degree: int, form: Reproducibility, *, decreasing: bool
    ) -> NDArray[np.float64]:
        """Return the expanded uncertainty W (k = 2) about the interpolation, in %, shape (m,)."""
        squares = [w**2 for w in self.components(degree, form, decreasing=decreasing).values()]
        return np.asarray(2.0 * np.sqrt(np.sum(squares, axis=0)), dtype=np.float64)

    def interval_percent(
        self, degree: int, form: Reproducibility, *, decreasing: bool
    ) -> NDArray[np.float64]:
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
    reference_uncertainty_percent: float | NDArray[np.float64],
    scale: float | None = None,
) -> StaticEvaluation:
    """Evaluate a calibration in steps.

    The increasing series of different positions give mean and reproducibility; a second one in the
    first position gives the repeatability only.

    Parameters
    ----------
    torque_nm : array of float, shape (m,)
        Rising steps above 0, in N·m. Those of the evaluated deflections.
    series : sequence of LoadingSeries
        In the order in which they were measured.
    resolution : float
        Resolution r, in the unit of the indication.
    reference_uncertainty_percent : float or array of float, shape (m,)
        Expanded uncertainty (k = 2) of the reference torque, in % of it.
    scale : float, optional
        Fixed indication per N·m: 1 for a scale in N·m. Without it there is no f_q.

    Returns
    -------
    StaticEvaluation

    Raises
    ------
    InputError
        Where the steps don't rise, there is no series, lengths differ, or a value isn't finite.

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
    positions: dict[float, LoadingSeries] = {}
    for each in series:
        positions.setdefault(each.position_deg, each)
    table = np.stack([each.increasing for each in positions.values()])
    n = table.shape[0]
    mean = np.asarray(table.mean(axis=0), dtype=np.float64)
    span = float(mean[-1])
    returns = [abs(each.zero_return) for each in series if each.zero_return is not None]
    return StaticEvaluation(
        torque_nm=torque,
        mean=mean,
        positions=n,
        span=span,
        sensitivity=span / float(torque[-1]),
        repeatability_percent=_repeatability(series),
        reproducibility_range_percent=100.0 * np.ptp(table, axis=0) / mean if n > 1 else None,
        reproducibility_deviation_percent=(
            100.0 * table.std(axis=0, ddof=1) / mean if n > 1 else None
        ),
        interpolations={
            degree: _interpolate(torque, mean, degree) for degree in DEGREES if torque.size > degree
        },
        reversibility_percent=_reversibility(series, mean),
        zero_residual_percent=100.0 * max(returns) / span if returns else None,
        indication_deviation_percent=(
            None if scale is None else 100.0 * (mean - scale * torque) / (scale * torque)
        ),
        resolution_percent=100.0 * resolution / mean,
        reference_uncertainty_percent=reference_uncertainty_percent,
    )


def _repeatability(series: Sequence[LoadingSeries]) -> NDArray[np.float64] | None:
    first = [each for each in series if each.position_deg == series[0].position_deg]
    if len(first) < 2:
        return None
    one, two = first[0].increasing, first[1].increasing
    return np.asarray(100.0 * np.abs(one - two) / ((one + two) / 2.0), dtype=np.float64)


def _reversibility(
    series: Sequence[LoadingSeries], mean: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    differences = [
        np.abs(each.decreasing - each.increasing) for each in series if each.decreasing is not None
    ]
    if not differences:
        return None
    return np.asarray(100.0 * np.mean(differences, axis=0) / mean, dtype=np.float64)


def _interpolate(
    torque: NDArray[np.float64], mean: NDArray[np.float64], degree: int
) -> Interpolation:
    # Scaled to 1, the powers are well conditioned; one step of refinement takes the residual's
    # rounding out, which matters because f_a is a small difference of large numbers.
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
    )


def _check(
    torque: NDArray[np.float64],
    series: Sequence[LoadingSeries],
    resolution: float,
    reference_uncertainty_percent: float | NDArray[np.float64],
) -> None:
    if torque.size < 2 or not np.all(np.diff(torque, prepend=0.0) > 0):
        raise InputError(
            Message("steps {torque} N·m", torque.tolist()),
            "at least two steps above 0 that rise",
            "sort them",
        )
    if not series:
        raise InputError("no series", "at least one increasing series")
    for number, each in enumerate(series, start=1):
        for name, values in (("increasing", each.increasing), ("decreasing", each.decreasing)):
            if values is None:
                continue
            if values.shape != torque.shape or not np.all(np.isfinite(values)):
                raise InputError(
                    Message(
                        "series {number} has {name} values {values}", number, name, values.tolist()
                    ),
                    Message("{size} finite deflections, one per step", torque.size),
                )
        if not np.all(each.increasing > 0):
            raise InputError(
                Message(
                    "series {number} has a deflection of {increasing:.6g}",
                    number,
                    each.increasing.min(),
                ),
                "deflections above 0",
                "subtract the zero of the series; give counter-clockwise torque as magnitudes",
            )
    for name, value in (
        ("resolution", resolution),
        ("uncertainty of the reference", reference_uncertainty_percent),
    ):
        if not np.all(np.isfinite(value) & (np.asarray(value) >= 0)):
            raise InputError(Message("{name} {value}", name, value), "a finite number, 0 or more")
