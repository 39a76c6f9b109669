"""Titles of columns, live signals and streams of a run, and figures of their resolution."""

from collections.abc import Mapping, Sequence
from math import floor, log10

from torquebench.bench.roles import SIDES
from torquebench.columns import Side, column_of
from torquebench.panel.text import Text
from torquebench.units import minus_signs

UNITLESS = ("1", "counts")
DECIMALS: Mapping[Side, int] = {"input": 3, "output": 2}
"""Decimals of a module's torque in N·m."""
UNIT_DECIMALS = {"°C": 2, "Hz": 1, "s": 2, "rpm": 3, "°": 3, "%": 2}


def column_unit_shown(column: str) -> str:
    """Return a column's unit as displayed on pages; empty without a unit.

    Examples
    --------
    >>> column_unit_shown("speed_rad_s"), column_unit_shown("angle_deg"), column_unit_shown("step")
    ('rad/s', '°', '')
    """
    unit = column_of(column).unit
    return "" if unit in UNITLESS else unit


def column_title(text: Text, column: str, *, samples: bool = False) -> str:
    """Return a column's title without its unit; for an unknown column, its name.

    Parameters
    ----------
    text : Text
    column : str
    samples : bool
        Whether it is a column of raw samples, whose torque is not compensated.

    Examples
    --------
    >>> english = Text("en")
    >>> column_title(english, "reading_drift_nm_per_s"), column_title(english, "load")
    ('Change of the torque', 'load')
    >>> column_title(english, "output_torque_nm", samples=True)
    'Output, raw torque'
    >>> column_title(english, "oil_c")
    'Temperature oil'
    """
    title = text(column_of(column, samples=samples).title)
    return title[:1].upper() + title[1:] if title else column


def column_with_unit(text: Text, column: str, *, samples: bool = False) -> str:
    """Return a column's title with its unit.

    Examples
    --------
    >>> column_with_unit(Text("en"), "input_torque_hz", samples=True)
    'Input, frequency of the transducer, Hz'
    """
    unit = column_unit_shown(column)
    title = column_title(text, column, samples=samples)
    return title + text(", ") + unit if unit else title


def column_figures(column: str, values: Sequence[float], side: Side = "") -> list[str]:
    """Return a column's values as text, of a module's resolution; whole ones have no decimals.

    Torques keep two significant digits of the largest one.

    Examples
    --------
    >>> column_figures("reading_nm", [38.62849, -0.2], "output"), column_figures("step", [1.0])
    (['38.63', '−0.20'], ['1'])
    >>> column_figures("standard_error_nm", [0.000377534]), column_figures("speed_rpm", [-1.1e-4])
    (['0.00038'], ['0.000'])
    """
    unit, largest = column_unit_shown(column), max(map(abs, values), default=0.0)
    decimals = UNIT_DECIMALS.get(unit)
    if unit.startswith("N·m"):
        decimals = DECIMALS.get(column_of(column).side or side, max(DECIMALS.values()))
        decimals = max(decimals, 1 - floor(log10(largest))) if 0.0 < largest < 1.0 else decimals
    if decimals is None or all(float(value).is_integer() for value in values):
        return [minus_signs(f"{value:.6g}") for value in values]
    return [minus_signs(f"{value:z.{decimals}f}") for value in values]


def stream_title(text: Text, stream: str) -> str:
    """Return the title of a run's stream.

    Examples
    --------
    >>> stream_title(Text("en"), "zero_output"), stream_title(Text("zh"), "points")
    ('Zero, Output', '测点')
    """
    side = stream.removeprefix("zero_")
    if side in SIDES and side != stream:
        return text("Zero, {side}", side=text.title(side))
    return text("Points") if stream == "points" else text(stream)
