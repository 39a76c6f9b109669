"""JSON lines: an object for each row; a first line of ours states remarks and units."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from torquebench.tables.formats import Format, OpenedTable

_HEAD = {"remarks", "units"}
"""Keys of the first line, which is no row; lines of other programs begin with the rows."""
_NO_HEAD: Mapping[str, Mapping[str, str]] = {"remarks": {}, "units": {}}


def _open(path: Path, _: str, opened: ExitStack) -> OpenedTable:
    import pyarrow as pa
    import pyarrow.json

    file = opened.enter_context(path.open("rb"))
    head = json.loads(file.readline())
    if not isinstance(head, dict) or set(head) != _HEAD:
        head = _NO_HEAD
        file.seek(0)
    rows = opened.enter_context(pyarrow.json.open_json(file))
    units = {name: {"unit": unit} for name, unit in head["units"].items()}
    fields = [each.with_metadata(units.get(each.name)) for each in rows.schema]
    schema = pa.schema(fields, head["remarks"] or None)

    def batches(count: int) -> Iterator[Any]:
        for batch in rows:
            for start in range(0, batch.num_rows, count):
                part = batch.slice(start, count)
                yield pa.RecordBatch.from_arrays(part.columns, schema=schema)

    return OpenedTable(schema, batches)


class _Writer:
    """Writes a line for each row; a number that is missing or infinite is null."""

    def __init__(self, file: IO[bytes], schema: Any, remarks: Mapping[str, str], **_: str) -> None:
        self._file, self._schema = file, schema
        units = {each.name: (each.metadata or {}).get(b"unit", b"").decode() for each in schema}
        units = {name: unit for name, unit in units.items() if unit}
        if remarks or units:
            self._write_line({"remarks": dict(remarks), "units": units})

    def _write_line(self, content: Mapping[str, Any]) -> None:
        text = json.dumps(content, ensure_ascii=False, allow_nan=False, default=str)
        self._file.write(f"{text}\n".encode())

    def write(self, batch: Any) -> None:
        """Append rows."""
        import pyarrow as pa

        table = batch if isinstance(batch, pa.Table) else pa.table(batch)
        for row in table.cast(self._schema).to_pylist():
            self._write_line({name: _stated(value) for name, value in row.items()})

    def close(self) -> None:
        """Leave the file as it is: each line is complete."""


def _stated(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


FORMAT = Format(
    name="jsonl",
    title="JSON lines (.jsonl, .ndjson)",
    endings=(".jsonl", ".ndjson"),
    open=_open,
    writer=_Writer,
    order=3,
)
