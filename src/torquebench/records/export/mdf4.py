"""Streams of a run as MDF4, the measurement format of ASAM."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from asammdf import MDF, Signal
from numpy.typing import NDArray

from torquebench.records.runs.streams import Attributes, EdgePiece, Samples

VERSION = "4.10"
DEFLATED = 2
TIME = "time_s"


def write_samples(path: Path, samples: Samples, attributes: Attributes) -> None:
    """Write one channel group whose master channel is the time."""
    time_s = next(values for column, values in samples.items() if column.name == TIME)
    signals = [
        Signal(
            _numbers(values),
            time_s,
            unit=column.unit,
            name=column.name,
            comment=column.attributes["description"],
        )
        for column, values in samples.items()
        if column.name != TIME
    ]
    with _file(path, attributes) as file:
        file.append(signals, acq_name="samples", common_timebase=True)


def write_edges(path: Path, pieces: Iterable[EdgePiece], attributes: Attributes) -> None:
    """Write one channel group per channel and edge: ticks over time."""
    trains: dict[tuple[str, str], tuple[float, list[NDArray[np.int64]]]] = {}
    for piece in pieces:
        key = piece.channel, piece.edge
        trains.setdefault(key, (piece.timebase_hz, []))[1].append(piece.ticks)
    with _file(path, attributes) as file:
        for (channel, edge), (timebase_hz, parts) in trains.items():
            ticks = np.concatenate(parts)
            name = f"{channel} {edge}"
            comment = f"ticks of a timebase of {timebase_hz:.17g} Hz since its start"
            signal = Signal(ticks, ticks / timebase_hz, unit="ticks", name=name, comment=comment)
            file.append([signal], acq_name=name)


def _numbers(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(np.uint8) if values.dtype == np.bool_ else values


@contextmanager
def _file(path: Path, attributes: Attributes) -> Iterator[Any]:
    file = MDF(version=VERSION)
    try:
        properties = "".join(
            f'<e name="{escape(name)}">{escape(str(value))}</e>'
            for name, value in attributes.items()
        )
        file.header.comment = (
            f"<HDcomment><TX>torquebench</TX>"
            f"<common_properties>{properties}</common_properties></HDcomment>"
        )
        yield file
        file.save(path, overwrite=True, compression=DEFLATED)
    finally:
        file.close()
