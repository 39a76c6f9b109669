"""A run's streams for export: columns with units, edges, and the run's metadata."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.columns import Column, column_of
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.records.runs.folder import RunFolder

Attributes = Mapping[str, str | int | float | bool]
Samples = Mapping[Column, NDArray[Any]]
"""Values of shape (n,) by column; NaN marks a missing number."""

_KNOWN = ("run_id", "kind", "bench_name", "side", "operator", "counter_identity")
_LATER = ("profile_name", "profile_sha256", "software_version", "created")


@dataclass(frozen=True, slots=True, eq=False)
class EdgePiece:
    """A piece of one channel's edges: ticks of a timebase since its start."""

    channel: str
    edge: str
    timebase_hz: float
    ticks: NDArray[np.int64]


def sample_columns(folder: RunFolder) -> Samples:
    """Return the samples of a run, time first.

    Raises
    ------
    InputError
        Where the run has no such data.
    """
    raw = folder.raw()
    if not raw.rows:
        raise InputError(
            Message("run {run_id} has no samples", folder.run_id),
            "a run that was acquired",
            "name another run",
        )
    return {column_of(name, samples=True): values for name, values in raw.columns.items()}


def edge_pieces(folder: RunFolder) -> Iterator[EdgePiece]:
    """Yield the edges of a run in the order in which they were recorded.

    Raises
    ------
    InputError
        Where the run has no such data.
    """
    found = False
    for recorded in folder.edges():
        found, block = True, recorded.block
        yield EdgePiece(recorded.channel, "rising", block.timebase_hz, block.ticks)
    if not found:
        raise InputError(
            Message("run {run_id} has no edges", folder.run_id),
            "a run of a bench whose bench.toml has `edges = true` in [recording]",
            "export its samples",
        )


def run_attributes(folder: RunFolder) -> dict[str, str | int | float | bool]:
    """Return the run's metadata as a flat mapping for exported files."""
    known = folder.metadata
    found: dict[str, str | int | float | bool] = {
        key: str(known[key]) for key in _KNOWN if known.get(key)
    }
    found["simulated"] = bool(known.get("simulated", False))
    found.update({key: str(known[key]) for key in _LATER if known.get(key)})
    if folder.sealed:
        manifest = folder.manifest
        found["status"] = str(manifest["status"])
        for name, entry in manifest["files"].items():
            if name.endswith(".parquet"):
                found[f"{name}_sha256"] = str(entry["sha256"])
    else:
        found["status"] = "not sealed"
    for side in ("input", "output"):
        module = known.get("bench", {}).get(side, {})
        if module:
            found[f"{side}_transducer_serial"] = str(module["transducer"]["serial"])
            found[f"{side}_counts_per_revolution"] = int(module["encoder"]["counts_per_revolution"])
    return found
