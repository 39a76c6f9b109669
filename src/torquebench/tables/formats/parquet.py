"""Parquet, by Arrow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from torquebench.tables.formats import Format, OpenedTable

_GROUP_ROWS = 1 << 18  # rows of a group; while one is written, threads calculate the next
_LOOKED_AT_ROWS = 10_000
_FOREIGN = (b"ARROW:schema", b"pandas", b"org.apache.spark.sql.parquet.row.metadata")
"""Metadata keys of other programs, which aren't remarks."""


def _open(path: Path, _: str, opened: ExitStack) -> OpenedTable:
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = opened.enter_context(pq.ParquetFile(path, pre_buffer=False))
    schema = file.schema_arrow
    texts = {key: text for key, text in (schema.metadata or {}).items() if key not in _FOREIGN}
    schema = schema.with_metadata(texts or None)

    def batches(rows: int) -> Iterator[Any]:
        for batch in file.iter_batches(rows, use_threads=False):
            yield pa.RecordBatch.from_arrays(batch.columns, schema=schema)

    return OpenedTable(schema, batches, file.metadata.num_rows)


class _Writer:
    """Writer of row groups; text that contains numbers stays text."""

    def __init__(self, file: IO[bytes], schema: Any, remarks: Mapping[str, str], **_: str) -> None:
        self._file = file
        self._schema = schema.with_metadata(dict(remarks) or None)
        self._writer: Any = None
        self._waiting: list[Any] = []

    def write(self, batch: Any) -> None:
        """Append rows; they are written when they fill a row group."""
        self._waiting.append(batch)
        if sum(each.num_rows for each in self._waiting) >= _GROUP_ROWS:
            self._write_group()

    def _write_group(self) -> None:
        import pyarrow as pa
        import pyarrow.compute as pc
        import pyarrow.parquet as pq

        tables = [each if isinstance(each, pa.Table) else pa.table(each) for each in self._waiting]
        group = pa.concat_tables(tables).cast(self._schema)
        if self._writer is None:
            # if values hardly repeat, a dictionary takes time and saves nothing
            first = group.slice(0, _LOOKED_AT_ROWS)
            repeating = [
                name
                for name, column in zip(first.column_names, first.columns, strict=True)
                if not pa.types.is_nested(column.type)
                and 2 * pc.count_distinct(column).as_py() < len(column)
            ]
            self._writer = pq.ParquetWriter(
                self._file, group.schema, compression="zstd", use_dictionary=repeating
            )
        self._writer.write_table(group, row_group_size=_GROUP_ROWS)
        self._waiting = []

    def close(self) -> None:
        """Write the remaining data and the end of the file."""
        if self._waiting or self._writer is None:
            if not self._waiting:
                self._waiting = [self._schema.empty_table()]
            self._write_group()
        self._writer.close()


FORMAT = Format(
    name="parquet",
    title="Parquet (.parquet)",
    endings=(".parquet", ".pq"),
    open=_open,
    begins=(b"PAR1",),
    writer=_Writer,
    order=1,
)
