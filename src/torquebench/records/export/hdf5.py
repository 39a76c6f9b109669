"""Streams of a run as HDF5: groups of data sets with units as attributes."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py

from torquebench.records.runs.streams import Attributes, EdgePiece, Samples

CHUNK = 65_536


def write_samples(path: Path, samples: Samples, attributes: Attributes) -> None:
    """Write each column as a data set of the group `samples`."""
    with h5py.File(path, "w") as file:
        file.attrs.update(attributes)
        group = file.create_group("samples")
        for column, values in samples.items():
            data = group.create_dataset(column.name, data=values, compression="gzip")
            data.attrs.update(column.attributes)


def write_edges(path: Path, pieces: Iterable[EdgePiece], attributes: Attributes) -> None:
    """Write one data set of ticks per channel and edge, such as `edges/output_torque/rising`."""
    with h5py.File(path, "w") as file:
        file.attrs.update(attributes)
        for piece in pieces:
            data = _data_set(file, piece)
            before = data.shape[0]
            data.resize(before + piece.ticks.size, axis=0)
            data[before:] = piece.ticks


def _data_set(file: Any, piece: EdgePiece) -> Any:
    name = f"edges/{piece.channel}/{piece.edge}"
    if name not in file:
        data = file.create_dataset(
            name,
            shape=(0,),
            maxshape=(None,),
            chunks=(CHUNK,),
            dtype="int64",
            shuffle=True,
            compression="gzip",
        )
        data.attrs.update({"unit": "ticks of timebase_hz", "timebase_hz": piece.timebase_hz})
    return file[name]
