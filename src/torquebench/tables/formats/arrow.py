"""Arrow's own files (Feather 2) and streams."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from torquebench.tables.formats import Format, OpenedTable


def _open(path: Path, _: str, opened: ExitStack) -> OpenedTable:
    import pyarrow as pa
    import pyarrow.ipc

    source = opened.enter_context(pa.OSFile(str(path)))
    if source.read(6) == b"ARROW1":
        source.seek(0)
        file = pa.ipc.open_file(source)
        schema, count = file.schema, file.num_record_batches

        def read() -> Iterator[Any]:
            return (file.get_batch(number) for number in range(count))
    else:
        source.seek(0)
        stream = pa.ipc.open_stream(source)
        schema = stream.schema

        def read() -> Iterator[Any]:
            return iter(stream)

    def batches(rows: int) -> Iterator[Any]:
        for batch in read():
            for start in range(0, batch.num_rows, rows):
                yield batch.slice(start, rows)

    return OpenedTable(schema, batches)


class _Writer:
    """Writes Feather 2."""

    def __init__(self, file: IO[bytes], schema: Any, remarks: Mapping[str, str], **_: str) -> None:
        import pyarrow as pa
        import pyarrow.ipc

        self._schema = schema.with_metadata(dict(remarks) or None)
        self._writer = pa.ipc.new_file(file, self._schema)

    def write(self, batch: Any) -> None:
        """Append rows."""
        import pyarrow as pa

        table = batch if isinstance(batch, pa.Table) else pa.table(batch)
        self._writer.write_table(table.cast(self._schema))

    def close(self) -> None:
        """Write the end of the file."""
        self._writer.close()


FORMAT = Format(
    name="arrow",
    title="Arrow (.arrow, .feather)",
    endings=(".arrow", ".feather"),
    open=_open,
    begins=(b"ARROW1",),
    writer=_Writer,
    order=2,
)
