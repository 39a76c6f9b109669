"""Starting and back-driving torque: the quasi-static torque at which a reducer begins to turn."""

from dataclasses import dataclass
from typing import Literal

from numpy.typing import ArrayLike

from torquebench.reducers.no_load import TorqueUncertainty
from torquebench.reducers.quantities import Finding, ResultQuantity
from torquebench.uncertainty import Budget

__all__ = ["BreakawayResult", "BreakawayRun", "evaluate_breakaway", "first_motion"]

BreakawayKind = Literal["starting", "back-driving"]


@dataclass(frozen=True)
class BreakawayRun:
    """One ramp of torque up to the first motion.

    Parameters
    ----------
    label : float
        Number of the run.
    position : float
        Label of the position; NaN where there is none.
    torque_nm : float
        Torque at the first motion, with its sign.
    standard_uncertainty_nm : float
        Of the moment of the first motion: torque's noise and rate times the moment's uncertainty.
    time_s : float
        Moment of the first motion.
    angle_noise_rad : float
        Standard deviation of the angle before it.
    """

    label: float
    position: float
    torque_nm: float
    standard_uncertainty_nm: float
    time_s: float
    angle_noise_rad: float


@dataclass(frozen=True, eq=False)
class BreakawayResult:
    """Starting or back-driving torque from several ramps.

    Parameters
    ----------
    kind : {"starting", "back-driving"}
    torque : Budget
        Median of the magnitudes over all runs, N·m at the driven side.
    clockwise, counter_clockwise : Budget or None
        Median of each direction.
    largest_nm, smallest_nm : float
        Over all runs: the spread.
    runs : tuple of BreakawayRun
    findings : tuple of Finding
    """

    kind: BreakawayKind
    torque: Budget
    clockwise: Budget | None
    counter_clockwise: Budget | None
    largest_nm: float
    smallest_nm: float
    runs: tuple[BreakawayRun, ...]
    findings: tuple[Finding, ...]

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        raise NotImplementedError


def evaluate_breakaway(
    time_s: ArrayLike,
    angle_rad: ArrayLike,
    torque_nm: ArrayLike,
    *,
    kind: BreakawayKind = "starting",
    run: ArrayLike | None = None,
    position: ArrayLike | None = None,
    uncertainty: TorqueUncertainty | None = None,
    resolution_rad: float = 0.0,
    presliding_rad: float = 0.0,
    largest_share: float | None = None,
) -> BreakawayResult:
    """Find the torque at the first motion in ramps of torque.

    Parameters
    ----------
    time_s, angle_rad, torque_nm : array of float, shape (n,)
        Samples of the driven side, all runs one after another.
    kind : {"starting", "back-driving"}
        Driven from the input, or from the output.
    run, position : array, shape (n,), optional
        Labels of each ramp and its position; without `run` everything is one ramp.
    uncertainty : TorqueUncertainty, optional
    resolution_rad : float
        Resolution of the angle: smaller changes are no motion.
    presliding_rad : float
        Elastic motion before the break-away that doesn't count as motion.
    largest_share : float, optional
        Refuse the result where its U exceeds this share of it.

    Raises
    ------
    InputError
        Where a run never moves, moves from its first sample, or holds too few samples.
    """
    raise NotImplementedError


def first_motion(
    time_s: ArrayLike, angle_rad: ArrayLike, *, resolution_rad: float = 0.0
) -> tuple[int, float]:
    """Return the sample of the first motion (change point) and the noise before it, rad."""
    raise NotImplementedError
