"""Titles of columns, live signals and streams of a run."""

from torquebench.columns import column_of
from torquebench.panel.text import Text

SIDES = ("input", "output")
UNITLESS = ("1", "counts")


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
    return f"{title}, {unit}" if unit else title


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
