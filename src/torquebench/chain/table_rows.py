"""Conversion of table rows to readings, with all assumptions about them."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from typing import Any

import numpy as np

from torquebench.chain.readings import MEASURED, Known, Readings


def readings_of_rows(
    rows: Mapping[str, Any],
    *,
    steady: bool,
    window_s: float | None = None,
    zero_age_h: Known = None,
    zero_temperature_c: Known = None,
    measured_on: date | None = None,
) -> Readings:
    """Return the rows of a table as readings of a measuring chain.

    Steady means are the points of a calibration or a verification, or of a table that states
    ``steady = true``. Two assumptions are made about them:

    - the acceleration is 0, unless the table has it: a point is taken at a constant speed;
    - the window is infinite: a mean over whole revolutions contains no ripple.

    Their times are used only if the branch isn't stated and follows from earlier rows. No
    assumptions are made about other rows. These are single readings; with times they are one
    record, from which acceleration and branch follow.

    Parameters
    ----------
    rows : mapping of str to array of shape (n,) or None
        Columns of the table by name: ``reading_nm``, and optionally ``branch``,
        ``standard_error_nm``, ``time_s`` and `MEASURED` quantities.
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
    >>> rows = {"reading_nm": np.array([5.1])}
    >>> steady = readings_of_rows(rows, steady=True)
    >>> steady.acceleration_rad_s2, steady.window_s
    (0.0, inf)
    >>> single = readings_of_rows(rows, steady=False)
    >>> single.acceleration_rad_s2, single.window_s
    (None, None)
    """
    branch, time_s = rows.get("branch"), rows.get("time_s")
    measured: dict[str, Any] = {name: rows.get(name) for name in MEASURED}
    if steady:
        if measured["acceleration_rad_s2"] is None:
            measured["acceleration_rad_s2"] = 0.0
        time_s, window_s = (time_s if branch is None else None), np.inf
        measured["angle_rad"] = None
    return Readings(
        rows["reading_nm"],
        branch=None if branch is None else branch.astype(np.float64),
        counter_nm=rows.get("standard_error_nm"),
        time_s=time_s,
        window_s=window_s,
        zero_age_h=zero_age_h,
        zero_temperature_c=zero_temperature_c,
        measured_on=measured_on,
        **measured,
    )
