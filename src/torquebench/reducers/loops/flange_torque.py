"""Torque at the reducer: the transducer's, less the torque that accelerates the flange between."""

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import savgol_filter

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals import motion_of_angle, without_inertia

Floats = NDArray[np.float64]

WINDOW = 11
DEGREE = 5
"""Degree of the polynomials through torque and angle, and samples of their window: they keep 99 %
of the torque and 94 % of the acceleration of a ripple of 12 samples a period, and 99 % of both for
20 samples.
"""


@dataclass(frozen=True)
class FlangeInertia:
    """Moment of inertia between a transducer's measuring section and the reducer.

    Parameters
    ----------
    inertia_kgm2 : float
        Its moment of inertia, kg·m².
    inertia_uncertainty_percent : float
        Expanded uncertainty (k = 2) of the moment of inertia, %.
    """

    inertia_kgm2: float
    inertia_uncertainty_percent: float = 10.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (isfinite(value) and value >= 0.0):
                raise InputError(
                    Message("{name} = {value} of a flange", name, value), "finite, 0 or more"
                )

    def __str__(self) -> str:
        """Return the moment of inertia with its uncertainty, as a text."""
        return Message(
            "{inertia_kgm2:g} kg·m² ± {inertia_uncertainty_percent:g} %",
            self.inertia_kgm2,
            self.inertia_uncertainty_percent,
        )


def torque_at_flange(
    time_s: ArrayLike,
    torque_nm: ArrayLike,
    angle_rad: ArrayLike,
    flange: FlangeInertia,
    *,
    standard_uncertainty_nm: ArrayLike = 0.0,
    angle_uncertainty_rad: float = 0.0,
) -> tuple[Floats, Floats]:
    """Subtract the torque that accelerates the flange.

    A drive's ripple accelerates the flange, and the transducer before it also measures that torque,
    which doesn't reach the reducer. Torque and angle are filtered with the same window, which keeps
    58 % of the torque's white noise.

    Parameters
    ----------
    time_s : array of float, shape (n,)
        At an even rate, gaps allowed; each stretch without a gap is filtered by itself.
    torque_nm : array of float, shape (n,)
        Torque at the transducer, N·m.
    angle_rad : array of float, shape (n,)
        Angle of the flange, rad, growing in the direction of a positive torque.
    standard_uncertainty_nm : float or array of float, shape (n,)
        Standard uncertainty of the torque, N·m.
    angle_uncertainty_rad : float
        Standard deviation of the angle's noise, rad.

    Returns
    -------
    torque_nm, standard_uncertainty_nm : array of float, shape (n,)
        Torque at the reducer, N·m. The first and last samples of a stretch, which have no window of
        their own, keep their torque.

    Raises
    ------
    InputError
        Where columns differ in length, or no stretch is as long as a window.

    Examples
    --------
    >>> time = 0.002 * np.arange(200)
    >>> swing = 1e-5 * np.sin(2.0 * np.pi * 20.0 * time)  # takes 0.25 kg·m² to move
    >>> read = 3.0 - 0.25 * (2.0 * np.pi * 20.0) ** 2 * swing
    >>> torque, uncertainty = torque_at_flange(time, read, swing, FlangeInertia(0.25))
    >>> round(float(np.ptp(read)), 3), round(float(np.ptp(torque[5:-5])), 3)
    (0.079, 0.0)
    """
    time, angle = (np.asarray(values, dtype=np.float64) for values in (time_s, angle_rad))
    torque = np.array(torque_nm, dtype=np.float64)
    if not (torque.ndim == 1 and time.shape == angle.shape == torque.shape):
        raise InputError(
            Message(
                "{size} torques, {angle_size} angles, {time_size} times",
                torque.size,
                angle.size,
                time.size,
            ),
            "as many of each, at the same times",
        )
    uncertainty = np.broadcast_to(standard_uncertainty_nm, torque.shape).astype(np.float64)
    unsure = flange.inertia_kgm2 * flange.inertia_uncertainty_percent / 200.0
    step_s = np.diff(time)
    interval_s = float(np.median(step_s)) if step_s.size else 0.0
    gaps = np.flatnonzero(np.abs(step_s - interval_s) > 0.5 * interval_s) + 1
    stretches = [rows for rows in np.split(np.arange(torque.size), gaps) if rows.size >= WINDOW]
    if not stretches or not interval_s > 0.0:
        raise InputError(
            Message(
                "{size} samples without {window} of them at even times in a row",
                torque.size,
                WINDOW,
            ),
            Message("at least {window}, to know how the flange accelerates", WINDOW),
            "give the times of a recording at an even rate, or leave the flange's inertia out",
        )
    for rows in stretches:
        motion = motion_of_angle(
            angle[rows],
            interval_s,
            window=WINDOW,
            degree=DEGREE,
            angle_uncertainty_rad=angle_uncertainty_rad,
        )
        smooth = savgol_filter(torque[rows], WINDOW, DEGREE)
        corrected = without_inertia(smooth, uncertainty[rows], motion, flange.inertia_kgm2, unsure)
        inner = slice(WINDOW // 2, rows.size - WINDOW // 2)
        torque[rows[inner]], uncertainty[rows[inner]] = corrected[0][inner], corrected[1][inner]
    return torque, uncertainty
