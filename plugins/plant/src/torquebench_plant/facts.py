"""Data of a sealed run folder for the plant: specimen, quantities, points."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from torquebench.calibration.data import OPTIONAL_COLUMNS, REQUIRED_COLUMNS

__all__ = ["RunFacts", "facts_of", "points_table"]

_COLUMNS = (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS)


@dataclass(frozen=True)
class RunFacts:
    """Results of a run that a plant uses.

    Parameters
    ----------
    specimen_type, serial : str
        Of the tested reducer; empty for other runs.
    quantities : tuple of mapping
        Of a reducer test: quantity, title, value, expanded uncertainty, unit, limit, verdict.
    """

    specimen_type: str = ""
    serial: str = ""
    quantities: tuple[Mapping[str, Any], ...] = ()


def facts_of(results: Any) -> RunFacts:
    """Return the facts in the content of a run's ``results.json``.

    Examples
    --------
    >>> facts_of({"reducer": {"name": "RV-40E"}, "serial": "S-1", "quantities": [
    ...     {"key": "backlash", "title": "Backlash", "value": 0.6, "unit": "arcmin",
    ...      "expanded_uncertainty": 0.1}]}).quantities[0]["value"]
    0.6
    >>> facts_of(None)
    RunFacts(specimen_type='', serial='', quantities=())
    """
    if not (isinstance(results, Mapping) and isinstance(results.get("quantities"), list)):
        return RunFacts()
    return RunFacts(
        specimen_type=str(results["reducer"]["name"]),
        serial=str(results.get("serial") or ""),
        quantities=tuple(
            {
                "quantity": row["key"],
                "title": row["title"],
                "value": row["value"],
                "expanded_uncertainty": row.get("expanded_uncertainty"),
                "unit": row.get("unit", ""),
                "limit": row.get("limit") or "",
                "verdict": row.get("verdict") or "",
            }
            for row in results["quantities"]
            if row.get("value") is not None
        ),
    )


def points_table(results: Any, started: datetime) -> bytes | None:
    """Return the points of a calibration, check or verification as a Parquet file (zstd).

    None where the run has none. Values common to all points (transducer, range) are columns, so
    that thousands of such files form one table.

    Parameters
    ----------
    results : object
        Content of the run's ``results.json``.
    started : datetime.datetime
    """
    data = results.get("data") if isinstance(results, Mapping) else None
    if not (isinstance(data, Mapping) and data.get("reading_nm")):
        return None
    import pyarrow as pa
    import pyarrow.parquet as pq

    count = len(data["reading_nm"])
    columns: dict[str, Any] = {
        name: pa.array(
            data.get(name) or [None] * count,
            pa.int32() if name in ("series", "branch") else pa.float64(),
        )
        for name in _COLUMNS
    }
    constant = {
        "range_nm": pa.scalar(float(data["range_nm"])),
        "side": pa.scalar(str(data.get("side") or "")),
        "transducer_serial": pa.scalar(str(data.get("transducer_serial") or "")),
        "counter_identity": pa.scalar(str(data.get("counter_identity") or "")),
        "started": pa.scalar(started, pa.timestamp("us", tz="UTC")),
    }
    columns |= {name: pa.repeat(value, count) for name, value in constant.items()}
    sink = io.BytesIO()
    pq.write_table(pa.table(columns), sink, compression="zstd")
    return sink.getvalue()
