"""Efficiency over torque and speed: η = T_o/(R·T_i) when the input drives, with iso-lines."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.reducers.no_load import TorqueUncertainty
from torquebench.reducers.quantities import Finding, ResultQuantity
from torquebench.uncertainty import Budget

__all__ = ["EfficiencyMap", "EfficiencyPoint", "evaluate_efficiency"]


@dataclass(frozen=True)
class EfficiencyPoint:
    """Efficiency at one torque and one speed.

    Parameters
    ----------
    driving : {"input", "output"}
        Which side drives.
    speed_rpm : float
        Input speed, 1/min, clockwise positive.
    torque_nm : float
        Output torque, N·m, magnitude.
    efficiency : Budget
        In %.
    loss_w : float
        Power that is lost, W.
    points : int
        How many steady points the mean is of.
    temperature_c : float
        Mean; NaN where it wasn't measured.
    """

    driving: Literal["input", "output"]
    speed_rpm: float
    torque_nm: float
    efficiency: Budget
    loss_w: float
    points: int
    temperature_c: float


@dataclass(frozen=True, eq=False)
class EfficiencyMap:
    """Efficiency over a grid of torque and speed.

    Parameters
    ----------
    ratio : float
        Input turns for one output turn.
    points : tuple of EfficiencyPoint
        By driving side, speed and torque.
    findings : tuple of Finding
    """

    ratio: float
    points: tuple[EfficiencyPoint, ...]
    findings: tuple[Finding, ...]

    def grid(
        self, driving: Literal["input", "output"] = "input", direction: int = 1, size: int = 41
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return speeds (rpm), torques (N·m) and interpolated efficiencies (%), for iso-lines.

        The efficiencies have the shape (torques, speeds) and are NaN outside the measured points.
        """
        raise NotImplementedError

    def at(
        self, torque_nm: float, speed_rpm: float, driving: Literal["input", "output"] = "input"
    ) -> Budget:
        """Return the interpolated efficiency in % at an output torque and an input speed.

        Raises
        ------
        InputError
            Outside the measured points.
        """
        raise NotImplementedError

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        raise NotImplementedError


def evaluate_efficiency(
    input_torque_nm: ArrayLike,
    output_torque_nm: ArrayLike,
    speed_rpm: ArrayLike,
    ratio: float,
    *,
    temperature_c: ArrayLike | None = None,
    nominal_torque_nm: ArrayLike | None = None,
    nominal_speed_rpm: ArrayLike | None = None,
    input_uncertainty: TorqueUncertainty | None = None,
    output_uncertainty: TorqueUncertainty | None = None,
    largest_temperature_range_k: float = 2.0,
    largest_share: float | None = None,
) -> EfficiencyMap:
    """Evaluate the efficiency from steady points.

    The side whose power is larger drives: η = T_o/(R·T_i) when the input drives,
    η = R·T_i/T_o when the output does. u(η)/η = √((u_To/T_o)² + (u_Ti/T_i)²).

    Parameters
    ----------
    input_torque_nm, output_torque_nm : array of float, shape (n,)
        Torque at the input, and at the output, of each steady point, N·m; the output torque is
        counted positive in the direction of the load on the input's torque (same sign of
        T_i and T_o when power flows through), see `docs/explanation/reducer-tests.md`.
    speed_rpm : array of float, shape (n,)
        Input speed, 1/min.
    ratio : float
        Input turns for one output turn.
    temperature_c : array of float, shape (n,), optional
    nominal_torque_nm, nominal_speed_rpm : array of float, shape (n,), optional
        Set points by which repeats are put together; by default points within 1 % of the
        largest torque and of the largest speed count as one.
    input_uncertainty, output_uncertainty : TorqueUncertainty, optional
    largest_temperature_range_k : float
        Above this the temperature counts as unsteady, which is a finding.
    largest_share : float, optional
        Refuse the result where U exceeds this share of the efficiency at any point.

    Raises
    ------
    InputError
    """
    raise NotImplementedError
