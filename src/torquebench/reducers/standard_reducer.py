"""End-to-end check of the bench with a standard reducer of certified friction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.description import CertifiedFriction

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class FrictionCheckPoint:
    """One speed: known friction against each repeat; torques in N·m, shares in % of full scale.

    Attributes
    ----------
    speed_rpm, known_nm, known_u_nm : float
        Input speed, certified torque and its U (k = 2).
    measured_nm : tuple of float
        Mean of each repeat.
    error_nm : float
        Mean of the repeats minus the known torque.
    spread_nm : float
        Largest minus smallest repeat.
    error_percent, spread_percent : float
        Magnitudes of both, % FS.
    """

    speed_rpm: float
    known_nm: float
    known_u_nm: float
    measured_nm: tuple[float, ...]
    error_nm: float
    spread_nm: float
    error_percent: float
    spread_percent: float


@dataclass(frozen=True)
class FrictionCheck:
    """Result of a check of the bench with a standard reducer.

    Attributes
    ----------
    points : tuple of FrictionCheckPoint
        At rising speed.
    range_nm, tolerance_percent : float
        Full scale of the input module, and the limit of error and repeatability, % FS.
    """

    points: tuple[FrictionCheckPoint, ...]
    range_nm: float
    tolerance_percent: float

    @property
    def error_percent(self) -> float:
        """Largest error, % FS."""
        return max(point.error_percent for point in self.points)

    @property
    def repeatability_percent(self) -> float:
        """Largest difference between repeats, % FS."""
        return max(point.spread_percent for point in self.points)

    @property
    def error_kept(self) -> bool:
        """Whether the error is within the tolerance."""
        return self.error_percent <= self.tolerance_percent

    @property
    def repeatability_kept(self) -> bool:
        """Whether the repeatability is within the tolerance."""
        return self.repeatability_percent <= self.tolerance_percent

    @property
    def kept(self) -> bool:
        """Whether error and repeatability are within the tolerance."""
        return self.error_kept and self.repeatability_kept


def check_friction(
    speed_rpm: ArrayLike,
    torque_nm: ArrayLike,
    repeat: ArrayLike,
    certified: Sequence[CertifiedFriction],
    range_nm: float,
    tolerance_percent: float = 0.1,
) -> FrictionCheck:
    """Compare measured no-load torques with the certified ones.

    Parameters
    ----------
    speed_rpm, torque_nm : array of float, shape (n,)
        Nominal input speed and torque with its sign; both directions have equal weights.
    repeat : array of int, shape (n,)
        Number of the repeat.
    certified : sequence of CertifiedFriction
        Values of the certificate, interpolated linearly between its speeds.
    range_nm : float
        Full scale of the input module, N·m.
    tolerance_percent : float
        Largest error and difference between repeats, % FS.

    Raises
    ------
    InputError
        There is no certificate, or a speed is outside its range.

    Examples
    --------
    >>> known = (CertifiedFriction(speed_rpm=100, torque_nm=0.30, expanded_uncertainty_nm=0.01),)
    >>> found = check_friction([100, -100], [0.32, -0.30], [1, 2], known, 50.0)
    >>> round(found.error_percent, 3), round(found.repeatability_percent, 3), found.kept
    (0.02, 0.04, True)
    """
    if not certified:
        raise InputError(
            "a standard reducer without certified friction",
            "[[certified_friction]] with speed_rpm, torque_nm, expanded_uncertainty_nm",
            "enter its certificate in the reducer's description",
        )
    speed, torque = (np.asarray(values, dtype=np.float64) for values in (speed_rpm, torque_nm))
    number = np.asarray(repeat)
    amount, forward = np.abs(speed), np.sign(speed) * torque
    speeds = [point.speed_rpm for point in certified]
    low, high = speeds[0], speeds[-1]
    outside = amount[(amount < low * (1 - 1e-9)) | (amount > high * (1 + 1e-9))]
    if outside.size:
        raise InputError(
            Message("a speed of {outside:g} rpm", outside[0]),
            Message("{low:g} to {high:g} rpm, as the certificate has them", low, high),
            "choose speeds within it",
        )
    points = []
    for step_rpm in np.unique(amount):
        at = amount == step_rpm
        means = tuple(float(forward[at & (number == k)].mean()) for k in np.unique(number[at]))
        certified_nm = float(np.interp(step_rpm, speeds, [point.torque_nm for point in certified]))
        stated = float(
            np.interp(step_rpm, speeds, [point.expanded_uncertainty_nm for point in certified])
        )
        error, spread = float(np.mean(means)) - certified_nm, max(means) - min(means)
        points.append(
            FrictionCheckPoint(
                float(step_rpm),
                certified_nm,
                stated,
                means,
                error,
                spread,
                100.0 * abs(error) / range_nm,
                100.0 * spread / range_nm,
            )
        )
    return FrictionCheck(tuple(points), range_nm, tolerance_percent)
