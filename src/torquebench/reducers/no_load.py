"""No-load running torque: what keeps the input turning at a speed, output free."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.reducers.friction import FrictionResult
from torquebench.reducers.quantities import Finding, ResultQuantity
from torquebench.uncertainty import Budget

__all__ = ["NoLoadPoint", "NoLoadResult", "TorqueUncertainty", "evaluate_no_load"]


@dataclass(frozen=True)
class TorqueUncertainty:
    """Standard uncertainties (k = 1) of a small torque.

    Parameters
    ----------
    relative : float
        Of the sensitivity, as a share of reading.
    zero_nm : float
        Of the zero that was taken just before, N·m; common to all points.
    """

    relative: float = 0.0
    zero_nm: float = 0.0


@dataclass(frozen=True)
class NoLoadPoint:
    """No-load torque at one speed.

    Parameters
    ----------
    speed_rpm : float
        Input speed, clockwise positive.
    torque : Budget
        Torque with the sign of the speed, N·m.
    up_minus_down_nm : float
        Mean while the speed rises less mean while it falls; NaN where one is missing.
    temperature_c : float
        Mean; NaN where it wasn't measured.
    """

    speed_rpm: float
    torque: Budget
    up_minus_down_nm: float
    temperature_c: float


@dataclass(frozen=True, eq=False)
class NoLoadResult:
    """No-load running torque of a reducer.

    Parameters
    ----------
    points : tuple of NoLoadPoint
        At rising speed, negative speeds first.
    friction : FrictionResult
        Curve, and Coulomb, viscous and Stribeck parts in each direction.
    temperature_coefficient : Budget or None
        Relative change of the torque per kelvin, %/K; None where the temperature hardly changed.
    speed_rpm, torque_nm, temperature_c, repeat, branch : array, shape (n,)
        What was evaluated, for figures with all repeats.
    findings : tuple of Finding
    """

    points: tuple[NoLoadPoint, ...]
    friction: FrictionResult
    temperature_coefficient: Budget | None
    speed_rpm: NDArray[np.float64]
    torque_nm: NDArray[np.float64]
    temperature_c: NDArray[np.float64]
    repeat: NDArray[np.int64]
    branch: NDArray[np.int64]
    findings: tuple[Finding, ...]

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        raise NotImplementedError


def evaluate_no_load(
    speed_rpm: ArrayLike,
    torque_nm: ArrayLike,
    *,
    repeat: ArrayLike | None = None,
    branch: ArrayLike | None = None,
    temperature_c: ArrayLike | None = None,
    uncertainty: TorqueUncertainty | None = None,
    tolerance_rpm: float | None = None,
    largest_temperature_range_k: float = 2.0,
    largest_share: float | None = None,
) -> NoLoadResult:
    """Evaluate steady no-load torques over speed.

    Parameters
    ----------
    speed_rpm, torque_nm : array of float, shape (n,)
        Mean of each steady point: input speed (clockwise positive) and torque with its sign.
    repeat : array of int, shape (n,), optional
        Number of the repeat; all 1 by default.
    branch : array of int, shape (n,), optional
        +1 while the speed's magnitude rises, -1 while it falls, 0 unknown.
    temperature_c : array of float, shape (n,), optional
        Of the reducer.
    uncertainty : TorqueUncertainty, optional
    tolerance_rpm : float, optional
        Largest gap between points of one speed; by default 0.2 % of the largest.
    largest_temperature_range_k : float
        Above this the temperature counts as unsteady, which is a finding.
    largest_share : float, optional
        Refuse the result where U exceeds this share of the torque at any speed.

    Raises
    ------
    InputError
    """
    raise NotImplementedError
