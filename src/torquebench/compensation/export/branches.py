"""The branch of a reading by the exports' rule, and the error of this rule in partial loops.

A controller without the model's memory (`torquebench.compensation.hysteresis`) derives the branch
from the direction of the readings since their last turning point. On the calibrated loop this is
exact. After a reversal in mid-range a chain is between both branches: the exports state the largest
error that follows.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from torquebench.compensation.hysteresis import HistoryCompensator

if TYPE_CHECKING:
    from torquebench.compensation.table import CompensationTable

FloatArray = NDArray[np.float64]

_TURNING_SHARE = 0.005
_STEPS = 400  # of full scale along the paths


def turning_nm(table: CompensationTable) -> float:
    """Return how far a reading moves back before it counts as reversed, N·m."""
    return _TURNING_SHARE * table.full_scale_nm


def followed_branches(reading_nm: FloatArray, turning: float) -> NDArray[np.int8]:
    """Return the branch of each reading of a stream, by the rule that exports contain.

    Examples
    --------
    >>> followed_branches(np.array([0.0, 5.0, 10.0, 9.5, 8.0, -3.0]), 1.0).tolist()
    [0, 1, 1, 1, -1, 1]
    """
    branch = np.zeros(reading_nm.size, dtype=np.int8)
    direction, extreme = 0, float(reading_nm[0])
    for row, reading in enumerate(reading_nm.tolist()):
        moved = reading - extreme
        if moved * direction > 0.0 or abs(moved) > turning:
            direction = 1 if moved > 0.0 else -1
            extreme = reading
        branch[row] = direction if reading >= 0.0 else -direction
    return branch


def partial_loop_deviation(table: CompensationTable) -> float:
    """Return the largest deviation from the model with memory over partial loops, N·m."""
    if not table.curve.branch_aware:
        return 0.0
    inner = [
        share
        for top in (1.0, 0.75, 0.5, 0.25)
        for bottom in (0.75, 0.5, 0.25, 0.0)
        if bottom < top
        for share in (top, bottom, top)
    ]
    both = [1.0, -0.5, 0.5, -1.0, 0.25, -0.25, 1.0, 0.0]
    turns = table.full_scale_nm * np.array(
        [0.0, *inner, 0.0, *(-1.0 * np.array(inner)), 0.0, *both]
    )
    turns = np.clip(turns, table.reading_low_nm, table.reading_high_nm)
    step = table.full_scale_nm / _STEPS
    path = np.concatenate(
        [
            np.linspace(start, stop, 1 + int(abs(stop - start) / step))[1:]
            for start, stop in pairwise(turns.tolist())
            if start != stop
        ]
    )
    live = HistoryCompensator(table).push(path).torque_nm
    alone = table.torque(path, followed_branches(path, turning_nm(table)))
    return float(np.max(np.abs(live - alone)))
