"""Titles of a run's recorded columns and streams, as the other pages word them."""

from torquebench.panel.text import Text
from torquebench.records.tables.column_words import column_unit

__all__ = ["column_title", "column_unit_shown", "column_with_unit", "stream_title"]

SIDES = ("input", "output")
UNITLESS = ("1", "counts")


def column_unit_shown(column: str) -> str:
    """Return a column's unit as the pages write it; empty if it has none.

    Examples
    --------
    >>> column_unit_shown("speed_rad_s"), column_unit_shown("angle_deg"), column_unit_shown("step")
    ('rad/s', '°', '')
    """
    unit = column_unit(column)[0]
    return "" if unit in UNITLESS else unit.replace("deg", "°")


def column_title(text: Text, column: str, *, samples: bool = False) -> str:
    """Return what a column contains, without its unit; an unknown column keeps its name.

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
    side = next((each for each in SIDES if column.startswith(f"{each}_")), "")
    what = column.removeprefix(f"{side}_")
    said = text.maybe(f"column.{'raw_' if samples and what == 'torque_nm' else ''}{what}", "")
    if not said and what.endswith("_c"):
        said = text("column.probe", name=what.removesuffix("_c").replace("_", " "))
    if not said:
        return column
    if side:
        return text("column.of_side", side=text(f"side.{side}"), what=said)
    return said[:1].upper() + said[1:]


def column_with_unit(text: Text, column: str, *, samples: bool = False) -> str:
    """Return a column's title with its unit.

    Examples
    --------
    >>> column_with_unit(Text("en"), "input_torque_hz", samples=True)
    'Input, transducer frequency, Hz'
    """
    unit = column_unit_shown(column)
    title = column_title(text, column, samples=samples)
    return f"{title}, {unit}" if unit else title


def stream_title(text: Text, stream: str) -> str:
    """Return what a table of a run contains.

    Examples
    --------
    >>> stream_title(Text("en"), "zero_output"), stream_title(Text("zh"), "points")
    ('Zero, Output', '测点')
    """
    side = stream.removeprefix("zero_")
    if side in SIDES and side != stream:
        return text("column.stream_zero", side=text(f"side.{side}"))
    return text.maybe(f"column.stream_{stream}", stream)
