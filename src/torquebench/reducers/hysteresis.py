"""Torque-angle loops: stiffness, backlash, lost motion and hysteresis loss, with uncertainties."""

from numpy.typing import ArrayLike

from torquebench.reducers.loop_results import HysteresisResult
from torquebench.reducers.loop_rules import LoopSettings, LoopUncertainty

__all__ = ["evaluate_hysteresis"]


def evaluate_hysteresis(
    torque_nm: ArrayLike,
    angle_rad: ArrayLike,
    settings: LoopSettings,
    *,
    position: ArrayLike | None = None,
    loop: ArrayLike | None = None,
    demanded_nm: ArrayLike | None = None,
    bench_compliance_rad_per_nm: float = 0.0,
    uncertainty: LoopUncertainty | None = None,
) -> HysteresisResult:
    """Evaluate torque-angle loops, input locked and output loaded.

    Parameters
    ----------
    torque_nm : array of float, shape (n,)
        Torque at the output in the order of measurement, N·m.
    angle_rad : array of float, shape (n,)
        Angle of the output against the locked input, rad; any zero.
    settings : LoopSettings
        Rated torque, rules and intervals.
    position : array of float, shape (n,), optional
        Label of the output position of each sample; one position by default.
    loop : array of int, shape (n,), optional
        Number of the loop at its position; found from the torque's reversals by default.
    demanded_nm : array of float, shape (n,), optional
        Torque that the drive was asked for: only to find where it saturates.
    bench_compliance_rad_per_nm : float
        The bench's own twist per torque between the encoder and the reducer, which is subtracted.
    uncertainty : LoopUncertainty, optional
        Of torque, angle and compliance; by default none, so that only repeatability counts.

    Raises
    ------
    InputError
        Where the data can't be used: not finite, no whole loop, a loop that doesn't close,
        swapped columns, a loop that never reaches the stiffness interval.
    """
    raise NotImplementedError
