"""Data keys of Bluesky documents: name, unit and description from the table of columns."""

from __future__ import annotations

from typing import cast

from event_model import DataKey

from torquebench.columns import column_of

_TYPES = {bool: "boolean", int: "integer", float: "number"}


def data_key(source: str, field: str, kind: type = float) -> DataKey:
    """Return the data key of a scalar, with a description as an addition to event-model's keys.

    Parameters
    ----------
    source : str
        Its origin, such as ``bench://output/standard_nm``.
    field : str
        Name of a column.
    kind : type
        bool, int or float.

    Examples
    --------
    >>> key = data_key("bench://output/standard_nm", "standard_nm")
    >>> key["dtype"], key["units"], key["description"]
    ('number', 'N·m', 'torque of the standard')
    """
    described = column_of(field).attributes
    key = {
        "source": source,
        "dtype": _TYPES[kind],
        "shape": [],
        "units": described["unit"],
        "description": described["description"],
    }
    return cast("DataKey", key)
