"""Speed and acceleration from an angle, and the torque that accelerates the rotating parts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from torquebench.errors import InputError
from torquebench.message import Message


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Motion:
    """Speed and acceleration at each sample of an angle.

    Parameters
    ----------
    speed_rad_s, acceleration_rad_s2 : float64 arrays, shape (n,)
        First and second derivative of the angle.
    speed_uncertainty_rad_s, acceleration_uncertainty_rad_s2 : float
        Standard uncertainty (k = 1) from the angle's noise; it is larger in the first and last half
        window.
    """

    speed_rad_s: NDArray[np.float64]
    acceleration_rad_s2: NDArray[np.float64]
    speed_uncertainty_rad_s: float
    acceleration_uncertainty_rad_s2: float


def motion_of_angle(
    angle_rad: ArrayLike,
    interval_s: float,
    *,
    window: int = 51,
    degree: int = 3,
    angle_uncertainty_rad: float = 0.0,
) -> Motion:
    """Return speed and acceleration from polynomials in a moving window.

    A. Savitzky, M. J. E. Golay, Analytical Chemistry 36 (1964) 1627. The filter has no phase shift,
    so that it needs later samples and suits recorded data only. The uncertainty is that of white
    noise of the angle; an encoder's count c contributes c/√12 if the shaft turns by several counts
    per sample.

    Parameters
    ----------
    angle_rad : array_like, shape (n,)
        Angle in rad at even times, unwrapped.
    interval_s : float
        Distance of the samples in seconds.
    window : int
        Samples in the window, odd; at most n.
    degree : int
        Degree of the polynomials, 2 or more, below the window.
    angle_uncertainty_rad : float
        Standard deviation of the angle's noise in rad.

    Raises
    ------
    InputError
        When the angle isn't a finite row, or the window doesn't fit.

    Examples
    --------
    >>> time = np.arange(200) * 1e-3
    >>> motion = motion_of_angle(3.0 * time + 0.5 * 40.0 * time**2, 1e-3)
    >>> motion.acceleration_rad_s2[100].round(6), motion.speed_rad_s[100].round(6)
    (np.float64(40.0), np.float64(7.0))
    """
    angle = np.asarray(angle_rad, dtype=np.float64)
    if angle.ndim != 1 or not np.all(np.isfinite(angle)):
        raise InputError("an angle that isn't a finite row", "finite angles at even times")
    if not (interval_s > 0 and np.isfinite(interval_s)):
        raise InputError(Message("interval {interval_s} s", interval_s), "a time above 0 s")
    if window % 2 == 0 or not degree < window <= angle.size or degree < 2:
        raise InputError(
            Message(
                "a window of {window} samples with degree {degree} on {size} samples",
                window,
                degree,
                angle.size,
            ),
            "an odd window above the degree, no longer than the record; degree 2 or more",
        )
    derivatives = []
    for order in (1, 2):
        weights = savgol_coeffs(window, degree, deriv=order, delta=interval_s)
        derivatives.append(
            (
                savgol_filter(angle, window, degree, deriv=order, delta=interval_s),
                angle_uncertainty_rad * float(np.sqrt(np.sum(weights**2))),
            )
        )
    return Motion(
        speed_rad_s=derivatives[0][0],
        acceleration_rad_s2=derivatives[1][0],
        speed_uncertainty_rad_s=derivatives[0][1],
        acceleration_uncertainty_rad_s2=derivatives[1][1],
    )


def inertia_torque(
    motion: Motion, inertia_kgm2: float, inertia_uncertainty_kgm2: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the torque J·dω/dt and its standard uncertainty.

    u² = (dω/dt·u_J)² + (J·u_dω/dt)², the law of propagation of uncertainty for a product
    (JCGM 100, 5.1.2).

    Parameters
    ----------
    motion : Motion
        From `motion_of_angle`, at n times.
    inertia_kgm2 : float
        Moment of inertia J in kg·m² of all that turns between the transducer's measuring section
        and the place for which the torque is calculated.
    inertia_uncertainty_kgm2 : float
        Standard uncertainty of J in kg·m².

    Returns
    -------
    torque_nm, standard_uncertainty_nm : float64 arrays, shape (n,)
        In N·m.
    """
    if not (inertia_kgm2 >= 0 and inertia_uncertainty_kgm2 >= 0):
        raise InputError(
            Message(
                "inertia {inertia_kgm2} ± {inertia_uncertainty_kgm2} kg·m²",
                inertia_kgm2,
                inertia_uncertainty_kgm2,
            ),
            "0 kg·m² or more",
        )
    acceleration = motion.acceleration_rad_s2
    by_inertia = acceleration * inertia_uncertainty_kgm2
    by_acceleration = inertia_kgm2 * motion.acceleration_uncertainty_rad_s2
    return inertia_kgm2 * acceleration, np.hypot(by_inertia, by_acceleration)


def without_inertia(
    torque_nm: ArrayLike,
    standard_uncertainty_nm: ArrayLike,
    motion: Motion,
    inertia_kgm2: float,
    inertia_uncertainty_kgm2: float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the torque without inertia, T − J·dω/dt, with the combined standard uncertainty.

    Parameters
    ----------
    torque_nm, standard_uncertainty_nm : array_like, shape (n,)
        Torque at the transducer in N·m, synchronous with the motion.
    motion : Motion
        From `motion_of_angle`, at the same n times.
    inertia_kgm2, inertia_uncertainty_kgm2 : float
        As for `inertia_torque`.

    Examples
    --------
    >>> time = np.arange(100) * 1e-3
    >>> motion = motion_of_angle(0.5 * 40.0 * time**2, 1e-3, angle_uncertainty_rad=1e-6)
    >>> torque, uncertainty = without_inertia(
    ...     5.0 + 0.02 * 40.0 * np.ones(100), np.full(100, 0.01), motion, 0.02, 0.0002
    ... )
    >>> torque[50].round(6), uncertainty[50].round(4)
    (np.float64(5.0), np.float64(0.0128))
    """
    torque = np.asarray(torque_nm, dtype=np.float64)
    if torque.shape != motion.acceleration_rad_s2.shape:
        raise InputError(
            Message(
                "{size} torques and {acceleration_rad_s2_size} accelerations",
                torque.size,
                motion.acceleration_rad_s2.size,
            ),
            "as many of each, at the same times",
        )
    inertial, uncertainty = inertia_torque(motion, inertia_kgm2, inertia_uncertainty_kgm2)
    return torque - inertial, np.hypot(standard_uncertainty_nm, uncertainty)
