"""The quantities of readings that the effects of a measuring chain need."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from datetime import date
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.elementwise import Values

FloatArray = NDArray[np.float64]
Known = FloatArray | float | None
"""One value for all readings, or one for each; None or NaN if not measured."""


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Readings of one transducer in time order, with their conditions.

    Optional quantities are described by the metadata of their fields. A quantity with
    ``"measured"`` is read from the column of its name in tables and recordings, in any unit of
    `torquebench.units.UNITS`.

    Parameters
    ----------
    reading_nm : float64[n]
        Torque from frequency, zero in use and sensitivity, N·m, clockwise positive.
    branch : float64[n] or None
        +1 where the size of the torque grows, -1 where it falls, 0 where that isn't known.
    counter_nm : float64[n], float or None
        Standard uncertainty of the reading itself, N·m: by counting, or the standard error of a
        mean.
    time_s : float64[n] or None
        Centres of the windows, from which a stream recognises gaps.
    speed_rpm, acceleration_rad_s2 : float64[n], float or None
        Of the shaft.
    acceleration_uncertainty_rad_s2 : float64[n], float or None
        Standard uncertainty of an acceleration that was derived from the speed.
    angle_rad : float64[n], float or None
        Angle of the shaft in the middle of the window, measured from a mark on the shaft.
    window_s : float or None
        Length of the windows.
    temperature_c : float64[n], float or None
        Of the transducer.
    zero_age_h, zero_temperature_c : float64[n], float or None
        Time since the zero in use was taken, and the transducer's temperature then.
    zero_nm : float64[n], float or None
        Standard uncertainty of that zero, N·m.
    calibration_age_h : float or None
        Time since the calibration.
    measured_on : datetime.date or None
        Day of the readings, from which the age of the calibration follows.
    of_bench : bool
        Whether `time_s` counts from the opening of the bench: it then has no relation to
        running-in.
    loadings : float
        Number of separate loadings over which each reading is a mean.
    """

    reading_nm: FloatArray
    branch: FloatArray | None = None
    counter_nm: Known = None
    time_s: FloatArray | None = None
    speed_rpm: Known = field(default=None, metadata={"description": "speed", "measured": True})
    acceleration_rad_s2: Known = field(
        default=None, metadata={"description": "acceleration", "measured": True}
    )
    acceleration_uncertainty_rad_s2: Known = None
    angle_rad: Known = field(
        default=None, metadata={"description": "shaft angle", "measured": True}
    )
    window_s: float | None = None
    temperature_c: Known = field(
        default=None, metadata={"description": "temperature of the transducer", "measured": True}
    )
    zero_age_h: Known = field(
        default=None, metadata={"description": "time since the zero was taken"}
    )
    zero_temperature_c: Known = field(
        default=None, metadata={"description": "temperature when the zero was taken"}
    )
    zero_nm: Known = None
    calibration_age_h: float | None = field(
        default=None, metadata={"description": "time since the calibration"}
    )
    loadings: float = 1.0
    of_bench: bool = False
    measured_on: date | None = None

    def __len__(self) -> int:
        return int(self.reading_nm.size)


QUANTITIES = {
    quantity.name: quantity.metadata["description"]
    for quantity in fields(Readings)
    if "description" in quantity.metadata
}
"""Quantities that readings may lack, with their descriptions."""
MEASURED = tuple(
    quantity.name for quantity in fields(Readings) if quantity.metadata.get("measured")
)
"""Quantities that are measured with every reading: columns of tables and recordings."""


def known_or(value: Known, otherwise: float) -> Values:
    """Return a quantity, with a default for values that weren't measured.

    Examples
    --------
    >>> known_or(np.array([1.0, np.nan]), 5.0).tolist(), known_or(None, 5.0)
    ([1.0, 5.0], 5.0)
    """
    if isinstance(value, np.ndarray):
        return np.where(np.isnan(value), otherwise, value)
    return otherwise if value is None or value != value else value


def unknown(value: Known) -> NDArray[np.bool_] | bool:
    """Return whether a quantity is unknown: for each reading, or once if it is one value.

    Examples
    --------
    >>> unknown(None), unknown(5.0), unknown(np.array([1.0, np.nan])).tolist()
    (True, False, [False, True])
    """
    if isinstance(value, np.ndarray):
        return np.isnan(value)
    return value is None or value != value


def row_of(value: Known, count: int) -> FloatArray:
    """Return a quantity for each reading; NaN where it isn't measured.

    Examples
    --------
    >>> row_of(None, 2).tolist(), row_of(5.0, 2).tolist()
    ([nan, nan], [5.0, 5.0])
    """
    if isinstance(value, np.ndarray) and value.shape == (count,):
        return value
    return np.full(count, np.nan if value is None else value)


def rows_of(readings: Readings, rows: slice) -> Readings:
    """Return some of the readings."""

    def chosen(value: Any) -> Any:
        return value[rows] if isinstance(value, np.ndarray) and value.ndim else value

    return replace(
        readings, **{item.name: chosen(getattr(readings, item.name)) for item in fields(Readings)}
    )
