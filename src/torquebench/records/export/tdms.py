"""Streams of a run as TDMS, for LabVIEW and DIAdem."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

from torquebench.records.runs.streams import Attributes, EdgePiece, Samples


def write_samples(path: Path, samples: Samples, attributes: Attributes) -> None:
    """Write each column as a channel of the group `samples`."""
    channels = [
        ChannelObject(
            "samples",
            column.name,
            # TDMS has no one-byte boolean that every reader supports
            values.astype(np.uint8) if values.dtype == np.bool_ else values,
            {"unit_string": column.unit, "description": column.attributes["description"]},
        )
        for column, values in samples.items()
    ]
    with TdmsWriter(path) as writer:
        writer.write_segment([RootObject(dict(attributes)), GroupObject("samples"), *channels])


def write_edges(path: Path, pieces: Iterable[EdgePiece], attributes: Attributes) -> None:
    """Write one channel of ticks per channel and edge, such as `output_torque rising`."""
    with TdmsWriter(path) as writer:
        writer.write_segment([RootObject(dict(attributes)), GroupObject("edges")])
        for piece in pieces:
            properties = {"unit_string": "ticks", "timebase_hz": piece.timebase_hz}
            name = f"{piece.channel} {piece.edge}"
            writer.write_segment([ChannelObject("edges", name, piece.ticks, properties)])
