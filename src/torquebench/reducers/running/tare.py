"""Readings of a rotating chain with nothing mounted, subtracted from readings with a reducer."""

from dataclasses import dataclass, field
from math import inf, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.chain import Component, Shared, Torque
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import finite_columns, labels

TRANSFER_SHARE = 0.2
"""Half width of the change of bearing drag with a reducer mounted, as a share of the drag:
misalignment then loads the bearings.
"""
REACH = 1.05
"""Factor on the fastest speed of an empty run up to which the run is used."""
HIGHEST_DEGREE = 2


@dataclass(frozen=True)
class TareValue:
    """Result of an empty run at one speed.

    Parameters
    ----------
    torque_nm : float
        Torque to be subtracted, N·m.
    scatter_nm, degrees_of_freedom : float
        Its standard uncertainty from the repeats, N·m.
    drag_nm : float
        The part that changes sign with the speed, N·m.
    """

    torque_nm: float
    scatter_nm: float
    degrees_of_freedom: float
    drag_nm: float

    @property
    def transfer_nm(self) -> float:
        """Standard uncertainty of using the empty run's drag with a mounted reducer, N·m."""
        return TRANSFER_SHARE * abs(self.drag_nm) / sqrt(3.0)


@dataclass(frozen=True, eq=False)
class Tare:
    """Torque of an empty run over speed: a polynomial of the speed in each direction.

    Parameters
    ----------
    coefficients : mapping of int to array of float, shape (repeats, degree + 1)
        By direction (+1, -1): of the powers of the speed's magnitude in 1/min, for each repeat.
    zero_nm : float
        Standard uncertainty of the zeros of the empty run, N·m.
    residual_nm : float
        Scatter about the polynomials, N·m.
    speed_rpm : array of float, shape (n,)
        Speeds of the empty run's points, 1/min.
    stated : Torque or None
        Torque that the measuring chain stated at these points; None without an active chain.
    """

    coefficients: dict[int, NDArray[np.float64]]
    fastest_rpm: float
    zero_nm: float
    residual_nm: float
    speed_rpm: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    stated: Torque | None = None

    def left(self, torque: Torque, speed_rpm: ArrayLike) -> Torque:
        """Return torques without the errors that they share with the empty run.

        The empty run's point at the nearest speed counts. Shared errors of the calibration and of
        the mounting cancel. The scatter of the empty run and its zero are in `at` and `zero_nm`.

        Parameters
        ----------
        torque : Torque
            Torque of the same measuring chain, before the empty run is subtracted.
        speed_rpm : array of float, shape (n,)
        """
        if self.stated is None:
            return torque
        apart = np.abs(np.asarray(speed_rpm)[:, None] - self.speed_rpm[None, :])
        empty = self.stated.at(np.argmin(apart, axis=1))
        components = []
        for component in torque.components:
            if component.shared in (Shared.CALIBRATION, Shared.MOUNTING):
                for other in (one for one in empty.components if one.name == component.name):
                    component = _difference(component, other)
            components.append(component)
        return Torque(torque.value_nm, tuple(components))

    def at(self, speed_rpm: float) -> TareValue:
        """Return the torque to be subtracted at a speed.

        Raises
        ------
        InputError
            The speed exceeds that of the empty run, or the empty run lacks its direction.
        """
        if abs(speed_rpm) > REACH * self.fastest_rpm:
            raise InputError(
                Message(
                    "an empty run up to {fastest_rpm:g} rpm for a test at {speed_rpm:g} rpm",
                    self.fastest_rpm,
                    abs(speed_rpm),
                ),
                "an empty run up to the speed of the test",
                "repeat it with higher speeds",
            )
        direction = 1 if speed_rpm >= 0.0 else -1
        if direction not in self.coefficients:
            raise InputError(
                "an empty run in the other direction only",
                "both directions of the test",
                "repeat it in both directions",
            )
        values = {
            sign: np.polynomial.polynomial.polyval(abs(speed_rpm), coefficients.T)
            for sign, coefficients in self.coefficients.items()
        }
        mean = {sign: float(values_of_sign.mean()) for sign, values_of_sign in values.items()}
        squares = sum(float(np.sum((value - value.mean()) ** 2)) for value in values.values())
        freedom = sum(value.size - 1 for value in values.values())
        count = values[direction].size
        single = sqrt(squares / freedom) if freedom else self.residual_nm
        return TareValue(
            torque_nm=mean[direction],
            scatter_nm=single / sqrt(count),
            degrees_of_freedom=float(freedom) if freedom else inf,
            drag_nm=0.5 * (mean[1] - mean[-1]) if len(mean) == 2 else mean[direction],
        )


def _difference(one: Component, other: Component) -> Component:
    """Return an error component of the difference of two torques, row by row."""
    first, second = np.asarray(one.uncertainty_nm), np.asarray(other.uncertainty_nm)
    if one.place is None or other.place is None:
        return one._replace(uncertainty_nm=first - second)
    common = np.prod(np.maximum(1.0 - np.abs(one.place - other.place), 0.0), axis=1)
    square = first**2 + second**2 - 2.0 * common * first * second
    sign = np.where(first < 0.0, -1.0, 1.0)
    return one._replace(uncertainty_nm=sign * np.sqrt(np.maximum(square, 0.0)))


def fit_tare(
    speed_rpm: ArrayLike,
    torque_nm: ArrayLike,
    *,
    repeat: ArrayLike | None = None,
    zero_nm: float = 0.0,
    stated: Torque | None = None,
) -> Tare:
    """Fit the readings of an empty run.

    Parameters
    ----------
    speed_rpm, torque_nm : array of float, shape (n,)
        Steady points with nothing mounted: speed (clockwise positive) and torque.
    repeat : array of int, shape (n,), optional
        Number of the repeat; its scatter is the tare's uncertainty.
    zero_nm : float
        Standard uncertainty of the zeros, N·m.
    stated : Torque, optional
        What the measuring chain stated at these points: errors that it shares with a test cancel.

    Raises
    ------
    InputError
        Where the columns can't be used, or a point is at rest.

    Examples
    --------
    >>> speed = np.tile([200.0, 600.0, 1000.0, -200.0, -600.0, -1000.0], 2)
    >>> torque = 0.002 * np.sign(speed) + 3e-6 * np.abs(speed)
    >>> tare = fit_tare(speed, torque, repeat=np.repeat([1, 2], 6))
    >>> round(tare.at(800.0).torque_nm, 6), round(tare.at(-800.0).drag_nm, 6)
    (0.0044, 0.002)
    """
    speed, torque = finite_columns(1, speed_rpm=speed_rpm, torque_nm=torque_nm)
    series = labels(repeat, speed.size, 1.0, "repeat")
    if np.any(speed == 0.0):
        raise InputError("a point of the empty run at 0 rpm", "points at which the shaft turns")
    coefficients: dict[int, NDArray[np.float64]] = {}
    rest: list[NDArray[np.float64]] = []
    for sign in (1, -1):
        same_direction = np.sign(speed) == sign
        if not same_direction.any():
            continue
        rows = []
        for number in np.unique(series[same_direction]):
            here = same_direction & (series == number)
            size = np.abs(speed[here])
            degree = min(HIGHEST_DEGREE, np.unique(np.round(size)).size - 1)
            line = np.polynomial.polynomial.polyfit(size, torque[here], degree)
            rest.append(torque[here] - np.polynomial.polynomial.polyval(size, line))
            rows.append(np.pad(line, (0, HIGHEST_DEGREE - degree)))
        coefficients[sign] = np.array(rows)
    residual = float(np.sqrt(np.mean(np.concatenate(rest) ** 2)))
    return Tare(coefficients, float(np.max(np.abs(speed))), float(zero_nm), residual, speed, stated)
