"""Readings from the rows of a table: what is assumed about them is stated here, once."""

from __future__ import annotations

from datetime import date
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from torquebench.chain.readings import FloatArray, Known, Readings

__all__ = ["Rows", "readings_of_rows"]


class Rows(Protocol):
    """Columns of a table of readings; None where the table doesn't have one."""

    @property
    def reading_nm(self) -> FloatArray:
        """Torque by the frequency, N·m."""

    @property
    def branch(self) -> NDArray[np.int8] | None:
        """+1, -1, or 0 where unknown."""

    @property
    def standard_error_nm(self) -> FloatArray | None:
        """Of means, N·m."""

    @property
    def time_s(self) -> FloatArray | None:
        """Of the rows."""

    @property
    def speed_rpm(self) -> FloatArray | None:
        """Of the shaft."""

    @property
    def acceleration_rad_s2(self) -> FloatArray | None:
        """Of the shaft."""

    @property
    def angle_rad(self) -> FloatArray | None:
        """Of the shaft, in the middle of a window."""

    @property
    def temperature_c(self) -> FloatArray | None:
        """Of the transducer."""


def readings_of_rows(
    rows: Rows,
    *,
    steady: bool,
    window_s: float | None = None,
    zero_age_h: Known = None,
    zero_temperature_c: Known = None,
    measured_on: date | None = None,
) -> Readings:
    """Return the rows of a table as readings of a measuring chain.

    Steady means are the points of a calibration or a verification, or of a table that states
    ``steady = true``. Two quantities of theirs are assumed:

    - the acceleration is 0, unless the table has it: a point is taken at a constant speed;
    - the window is infinite: a mean over whole revolutions contains no ripple.

    Their times matter only where the branch isn't stated and follows from the earlier rows. Nothing
    is assumed about other rows. They are single readings; with times they are one record, from
    which acceleration and branch follow.

    Parameters
    ----------
    rows : Rows
        Columns of the table.
    steady : bool
        Whether the rows are steady means.
    window_s : float, optional
        Length of the windows, as the table states it.
    zero_age_h, zero_temperature_c : float64[n] or float, optional
        Time since the zero was taken, and the transducer's temperature then.
    measured_on : datetime.date, optional
        Day of the readings; the age of the calibration counts to it.

    Examples
    --------
    >>> from torquebench.calibration import CalibrationData
    >>> point = CalibrationData([5.1], [5.0], [1], [1], 10.0)
    >>> steady = readings_of_rows(point, steady=True)
    >>> steady.acceleration_rad_s2, steady.window_s
    (0.0, inf)
    >>> single = readings_of_rows(point, steady=False)
    >>> single.acceleration_rad_s2, single.window_s
    (None, None)
    """
    acceleration: Known = rows.acceleration_rad_s2
    time_s, angle_rad = rows.time_s, rows.angle_rad
    if steady:
        acceleration = 0.0 if acceleration is None else acceleration
        time_s, angle_rad, window_s = (time_s if rows.branch is None else None), None, np.inf
    return Readings(
        rows.reading_nm,
        branch=None if rows.branch is None else rows.branch.astype(np.float64),
        counter_nm=rows.standard_error_nm,
        time_s=time_s,
        speed_rpm=rows.speed_rpm,
        acceleration_rad_s2=acceleration,
        angle_rad=angle_rad,
        window_s=window_s,
        temperature_c=rows.temperature_c,
        zero_age_h=zero_age_h,
        zero_temperature_c=zero_temperature_c,
        measured_on=measured_on,
    )
