"""Standard uncertainties of a torque by its measuring chain, before a test repeats it."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import compress
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message


class StandardUncertainties:
    """Base of dataclasses whose fields are standard uncertainties: finite, 0 or more."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (isfinite(value) and value >= 0.0):
                raise InputError(
                    Message("standard uncertainty {name} = {value}", name, value),
                    "finite, 0 or more",
                )


@dataclass(frozen=True)
class TorqueUncertainty(StandardUncertainties):
    """Standard uncertainties (k = 1) of a torque, grouped by what shares their errors.

    Parameters
    ----------
    relative : float
        Standard uncertainty of the calibration, as a share of reading.
    zero_nm : float
        Of the zero measured just before, N·m; the same in both directions, so that it cancels in
        their mean.
    model_nm : float
        Standard uncertainty of the calibration, N·m; its error may change sign with the torque.
    speed_nm_per_rpm : float
        Standard uncertainty of the zero over speed, N·m per 1/min; it cancels in the mean of both
        directions.
    mounting_nm : float
        Of the mounting and the drag of bearings, N·m; it changes sign with torque and speed.
    loading_nm : float
        Of a loading, N·m, by errors that may be alike in all repeats: position in the hysteresis
        loop, creep, dynamics.
    repeatability_nm : float
        Scatter of one loading, N·m; used only if a test has no repeats that show it.
    """

    relative: float = 0.0
    zero_nm: float = 0.0
    model_nm: float = 0.0
    speed_nm_per_rpm: float = 0.0
    mounting_nm: float = 0.0
    loading_nm: float = 0.0
    repeatability_nm: float = 0.0


KnownTorque = TorqueUncertainty | Sequence[TorqueUncertainty]
"""Uncertainty of the torque: the same for all points of a test, or one for each."""


def over(uncertainty: KnownTorque, rows: NDArray[np.bool_] | None = None) -> TorqueUncertainty:
    """Return the uncertainty of the mean torque of some points; of all points without `rows`.

    It is the root mean square of the points' uncertainties, because they share their errors.

    Examples
    --------
    >>> known = [TorqueUncertainty(mounting_nm=each) for each in (0.1, 0.7, 9.0)]
    >>> round(over(known, np.array([True, True, False])).mounting_nm, 9)
    0.5
    """
    if isinstance(uncertainty, TorqueUncertainty):
        return uncertainty
    chosen = list(uncertainty if rows is None else compress(uncertainty, rows))
    return TorqueUncertainty(
        **{
            item.name: float(np.sqrt(np.mean([getattr(one, item.name) ** 2 for one in chosen])))
            for item in fields(TorqueUncertainty)
        }
    )
