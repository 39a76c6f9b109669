"""MDF4, the measurement format of ASAM, by asammdf."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from torquebench.tables.formats import Format, OpenedTable, chosen_part, of_channels

_VERSION = "4.10"
_DEFLATED = 2
_TIME = "time_s"


def _open(path: Path, part: str, opened: ExitStack) -> OpenedTable:
    from asammdf import MDF

    file: Any = MDF(path)
    opened.callback(file.close)
    groups: dict[str, int] = {}
    for number, each in enumerate(file.groups):
        if each.channel_group.cycles_nr and len(each.channels) > 1:
            name = each.channel_group.acq_name or str(number)
            groups[name if name not in groups else f"{name} {number}"] = number
    names = {
        name: [channel.name for channel in file.groups[number].channels]
        for name, number in groups.items()
    }
    chosen = chosen_part(path, part, names, "group")
    number = groups[chosen]
    group = file.groups[number]

    def values(index: int) -> Callable[[int, int], Any]:
        def read(start: int, count: int) -> Any:
            samples, invalid = file.get(
                group=number,
                index=index,
                record_offset=start,
                record_count=count,
                samples_only=True,
                ignore_invalidation_bits=True,
            )
            return _without(samples, invalid)

        return read

    channels = []
    for index, channel in enumerate(group.channels):
        unit = str(file.get_channel_unit(group=number, index=index) or "")
        read = values(index)
        first = read(0, 1)
        if first.ndim == 1 and first.dtype.names is None:
            channels.append((channel.name, unit, read))
    remarks = _remarks(file.header.comment)
    return of_channels(channels, group.channel_group.cycles_nr, remarks, chosen)


def _without(samples: Any, invalid: Any) -> Any:
    """Return samples, with NaN for invalid ones."""
    import numpy as np

    if invalid is None or not np.any(invalid):
        return samples
    return np.where(np.asarray(invalid, dtype=bool), np.nan, samples)


def _remarks(comment: str) -> dict[str, str]:
    """Return the properties in an MDF file's header comment."""
    from xml.etree import ElementTree

    try:
        tree = ElementTree.fromstring(comment)
    except ElementTree.ParseError:
        return {}
    entries = [each for each in tree.iter() if each.tag.endswith("e") and "name" in each.attrib]
    return {each.attrib["name"]: each.text or "" for each in entries}


class _Writer:
    """Writer of one channel group with the time as master; it keeps the table in memory."""

    def __init__(self, file: IO[bytes], schema: Any, remarks: Mapping[str, str], **_: str) -> None:
        self._file, self._schema, self._remarks = file, schema, remarks
        self._batches: list[Any] = []

    def write(self, batch: Any) -> None:
        """Store rows."""
        import pyarrow as pa

        self._batches.append(batch if isinstance(batch, pa.Table) else pa.table(batch))

    def close(self) -> None:
        """Write the file."""
        import shutil
        import tempfile
        from xml.sax.saxutils import escape

        import numpy as np
        import pyarrow as pa
        from asammdf import MDF, Signal

        from torquebench.tables.table import numbers_of

        table = pa.concat_tables(self._batches) if self._batches else self._schema.empty_table()
        columns = dict(zip(self._schema.names, table.columns, strict=True))
        time = columns.get(_TIME)
        counted = np.arange(table.num_rows, dtype=np.float64)
        time_s = counted if time is None else numbers_of(time)
        signals = []
        for field in self._schema:
            if field.name == _TIME:
                continue
            words = {k.decode(): v.decode() for k, v in (field.metadata or {}).items()}
            column = columns[field.name]
            if pa.types.is_string(field.type) or pa.types.is_nested(field.type):
                texts = [str(value or "").encode() for value in column.to_pylist()]
                values, coding = np.array(texts or [b""]), {"encoding": "utf-8"}
            else:
                values, coding = numbers_of(column), {}
                values = values.astype(np.uint8) if values.dtype == np.bool_ else values
            signals.append(
                Signal(
                    values,
                    time_s,
                    unit=words.get("unit", ""),
                    name=field.name,
                    comment=words.get("description", ""),
                    **coding,
                )
            )
        properties = "".join(
            f'<e name="{escape(name)}">{escape(str(value))}</e>'
            for name, value in self._remarks.items()
        )
        with MDF(version=_VERSION) as file, tempfile.TemporaryDirectory() as folder:
            file.header.comment = (
                f"<HDcomment><TX>torquebench</TX>"
                f"<common_properties>{properties}</common_properties></HDcomment>"
            )
            file.append(signals, acq_name="samples", common_timebase=True)
            path = file.save(Path(folder) / "table.mf4", overwrite=True, compression=_DEFLATED)
            with Path(path).open("rb") as made:
                shutil.copyfileobj(made, self._file)


FORMAT = Format(
    name="mdf4",
    title="MDF4 (.mf4)",
    endings=(".mf4", ".mdf"),
    open=_open,
    begins=(b"MDF     ",),
    package="asammdf",
    extra="mdf4",
    writer=_Writer,
    parts="group",
)
