"""TDMS of LabVIEW and DIAdem, by npTDMS."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from torquebench.tables.formats import (
    Format,
    OpenedTable,
    chosen_part,
    of_channels,
    tables_by_length,
)


def _open(path: Path, part: str, opened: ExitStack) -> OpenedTable:
    from nptdms import TdmsFile

    file = opened.enter_context(TdmsFile.open(path))
    parts: dict[str, dict[str, Any]] = {}
    for group in file.groups():
        parts |= tables_by_length(group.name, {each.name: each for each in group.channels()}, len)
    chosen = chosen_part(path, part, {name: list(each) for name, each in parts.items()}, "group")
    named = parts[chosen]
    first = next(iter(named.values()))
    channels = [
        (name, str(channel.properties.get("unit_string", "")), _reader(channel))
        for name, channel in named.items()
    ]
    steps = {channel.properties.get("wf_increment") for channel in named.values()}
    if len(steps) == 1 and (step := steps.pop()) and not any(map(_is_time, named)):
        start = first.properties.get("wf_start_offset", 0.0)
        channels.insert(0, ("time_s", "s", _even_times(float(start), float(step))))
    remarks = {**file.properties, **file[first.group_name].properties}
    return of_channels(channels, len(first), remarks, chosen)


def _reader(channel: Any) -> Callable[[int, int], Any]:
    return lambda start, count: channel.read_data(start, count)


def _is_time(name: str) -> bool:
    return name.lower().startswith(("time", "zeit", "时间", "temps", "tiempo", "時間"))


def _even_times(start: float, step: float) -> Callable[[int, int], Any]:
    """Return the times of a waveform, for which TDMS only states a step."""
    import numpy as np

    return lambda first, count: start + step * np.arange(first, first + count)


class _Writer:
    """Writer of one channel for each column, with unit and description, in the group `samples`."""

    def __init__(self, file: IO[bytes], schema: Any, remarks: Mapping[str, str], **_: str) -> None:
        from nptdms import GroupObject, RootObject, TdmsWriter

        self._schema = schema
        self._writer = TdmsWriter(file)
        self._writer.open()
        self._writer.write_segment([RootObject(dict(remarks)), GroupObject("samples")])

    def write(self, batch: Any) -> None:
        """Append a segment."""
        import numpy as np
        from nptdms import ChannelObject

        from torquebench.tables.table import numbers_of

        channels = []
        for field, column in zip(self._schema, batch.columns, strict=True):
            words = {k.decode(): v.decode() for k, v in (field.metadata or {}).items()}
            properties = {"unit_string": words.pop("unit", ""), **words}
            try:
                values = numbers_of(column)
            except (TypeError, NotImplementedError):
                values = np.array([])
            if values.dtype == np.bool_:
                # TDMS has no one-byte boolean that every reader supports
                values = values.astype(np.uint8)
            if values.dtype.kind not in "iuf":
                values = np.array([str(value or "") for value in column.to_pylist()])
            channels.append(ChannelObject("samples", field.name, values, properties))
        self._writer.write_segment(channels)

    def close(self) -> None:
        """Write the end of the file."""
        self._writer.close()


FORMAT = Format(
    name="tdms",
    title="TDMS (.tdms)",
    endings=(".tdms",),
    open=_open,
    begins=(b"TDSm",),
    package="nptdms",
    extra="tdms",
    writer=_Writer,
    parts="group",
)
