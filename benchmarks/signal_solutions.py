"""The regression counter as one would write it with array libraries."""

import importlib.util
import os
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

__all__ = [
    "available",
    "with_numpy",
    "with_numpy_and_search",
    "with_polars",
    "with_scipy",
]

Ticks = NDArray[np.int64]
Frequencies = NDArray[np.float64]
Solution = Callable[[Ticks, int, float], Frequencies]


def available() -> dict[str, Solution]:
    """Solutions whose libraries are installed, by name."""
    found: dict[str, Solution] = {
        "NumPy (add.reduceat)": with_numpy,
        "NumPy (searchsorted, add.reduceat)": with_numpy_and_search,
        "SciPy (sparse product)": with_scipy,
    }
    if importlib.util.find_spec("polars") is not None:
        found["polars (group_by)"] = with_polars
    return found


def _windows(ticks: Ticks, window: int) -> tuple[Ticks, NDArray[np.intp]]:
    """Find the starts of the whole windows, and the borders of their edges."""
    starts = np.arange(-(-ticks[0] // window), ticks[-1] // window, dtype=np.int64) * window
    return starts, np.searchsorted(ticks, np.append(starts, starts[-1] + window))


def _offsets_and_places(
    ticks: Ticks, starts: Ticks, borders: NDArray[np.intp]
) -> tuple[Ticks, Ticks]:
    """Each edge's tick and number within its window."""
    counts = np.diff(borders)
    inside = ticks[borders[0] : borders[-1]]
    places = np.arange(inside.size) - np.repeat(borders[:-1] - borders[0], counts)
    return inside - np.repeat(starts, counts), places


def _frequency(count: Ticks, total: Ticks, moment: Ticks, timebase_hz: float) -> Frequencies:
    slope = 6.0 * (2 * moment - (count - 1) * total)
    return np.asarray(timebase_hz * count * (count * count - 1) / slope)


def with_numpy(ticks: Ticks, window: int, timebase_hz: float) -> Frequencies:
    """Vectorised: the window of each edge, then two reductions over the windows' slices."""
    number = ticks // window
    first = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
    count = np.diff(first, append=ticks.size)
    place = np.arange(ticks.size) - np.repeat(first, count)
    offset = ticks - number * window
    total = np.add.reduceat(offset, first)
    moment = np.add.reduceat(offset * place, first)
    whole = slice(1, -1)
    return _frequency(count[whole], total[whole], moment[whole], timebase_hz)


def with_numpy_and_search(ticks: Ticks, window: int, timebase_hz: float) -> Frequencies:
    """Vectorised likewise, but with the windows' borders searched: no division per edge."""
    starts, borders = _windows(ticks, window)
    offsets, places = _offsets_and_places(ticks, starts, borders)
    first = borders[:-1] - borders[0]
    total = np.add.reduceat(offsets, first)
    moment = np.add.reduceat(offsets * places, first)
    return _frequency(np.diff(borders), total, moment, timebase_hz)


def with_scipy(ticks: Ticks, window: int, timebase_hz: float) -> Frequencies:
    """Take the same sums as products with a sparse matrix of windows and edges."""
    starts, borders = _windows(ticks, window)
    offsets, places = _offsets_and_places(ticks, starts, borders)
    rows = borders - borders[0]
    members = np.arange(offsets.size)
    shape = (starts.size, offsets.size)
    ones = np.ones(offsets.size, dtype=np.int64)
    total = sparse.csr_array((ones, members, rows), shape=shape) @ offsets
    moment = sparse.csr_array((places, members, rows), shape=shape) @ offsets
    return _frequency(np.diff(borders), total, moment, timebase_hz)


def with_polars(ticks: Ticks, window: int, timebase_hz: float) -> Frequencies:
    """Take the same sums by a query that groups the edges by their window."""
    # One thread, as all others have; polars reads this once.
    os.environ["POLARS_MAX_THREADS"] = "1"
    import polars as pl

    tick = pl.col("tick")
    offset = tick % window
    sums = (
        pl.LazyFrame({"tick": ticks})
        .with_columns(window=(tick // window).set_sorted())
        .group_by("window", maintain_order=True)
        .agg(
            count=pl.len().cast(pl.Int64),
            total=offset.sum(),
            moment=(offset * pl.int_range(pl.len(), dtype=pl.Int64)).sum(),
        )
        .collect()
    )
    whole = slice(1, -1)
    count, total, moment = (sums[name].to_numpy()[whole] for name in ("count", "total", "moment"))
    return _frequency(count, total, moment, timebase_hz)
