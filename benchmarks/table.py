"""Speed of compiled tables, compared with a network in NumPy and with ``numpy.interp``.

In one run, on one core, on the same readings: the 1-50-1 network in blocked NumPy, and compiled
tables with and without branches, batch after batch of as many readings as files are read and
compensated at once; then single readings from Python beside ``numpy.interp``. Every figure is the
least processor time of several rounds in which all take turns: other programs slow all of them
alike, and their own time isn't counted.
"""

from __future__ import annotations

import argparse
import timeit
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from tests.support.chains import make_chain
from threadpoolctl import threadpool_limits

from benchmarks.reporting import judge, least_seconds
from torquebench.compensation import make_model
from torquebench.compensation.table import CompensationTable, compile_table

FloatArray = NDArray[np.float64]
Way = Callable[[FloatArray, FloatArray, int], None]

_HIDDEN = 50
BATCH = 1 << 16
"""Number of readings that commands read from a file and compensate at once."""
_BATCHES = 16
"""Batches in one round of a table, so that a round is longer than the clock's resolution."""


# --- what tables are compared with -------------------------------------------------------------


class Network:
    """The 1-50-1 network in blocked NumPy, without any allocation inside the loop.

    The aim is a ratio to `rows`, the usual implementation; two others, which move more of the work
    into matrix products, are measured as well.
    """

    def __init__(self, seed: int) -> None:
        generator = np.random.default_rng(seed)
        self.weights = generator.normal(0.0, 5.0, _HIDDEN)
        self.biases = generator.normal(0.0, 3.0, _HIDDEN)
        self.outputs = generator.normal(0.0, 1e-3, _HIDDEN)
        self.both = np.vstack([self.weights, self.biases])
        self.full_scale = 2000.0

    def rows(self, reading: FloatArray, out: FloatArray, block: int) -> None:
        """Evaluate with one row per reading: outer product, tanh, matrix-vector product."""
        hidden = np.empty((block, _HIDDEN))
        for start in range(0, reading.size, block):
            part = reading[start : start + block] / self.full_scale
            layer = hidden[: part.size]
            np.multiply.outer(part, self.weights, out=layer)
            layer += self.biases
            np.tanh(layer, out=layer)
            np.dot(layer, self.outputs, out=out[start : start + block])

    def columns(self, reading: FloatArray, out: FloatArray, block: int) -> None:
        """Evaluate with one row per hidden unit."""
        hidden = np.empty((_HIDDEN, block))
        for start in range(0, reading.size, block):
            part = reading[start : start + block] / self.full_scale
            layer = hidden[:, : part.size]
            np.multiply.outer(self.weights, part, out=layer)
            layer += self.biases[:, None]
            np.tanh(layer, out=layer)
            np.dot(self.outputs, layer, out=out[start : start + block])

    def product(self, reading: FloatArray, out: FloatArray, block: int) -> None:
        """Evaluate with one row per reading, weights and biases in one matrix product."""
        hidden, inputs = np.empty((block, _HIDDEN)), np.ones((block, 2))
        for start in range(0, reading.size, block):
            part = reading[start : start + block]
            np.divide(part, self.full_scale, out=inputs[: part.size, 0])
            layer = hidden[: part.size]
            np.dot(inputs[: part.size], self.both, out=layer)
            np.tanh(layer, out=layer)
            np.dot(layer, self.outputs, out=out[start : start + block])

    def tuned(self, reading: FloatArray, out: FloatArray) -> dict[str, tuple[Way, int]]:
        """Return every implementation with its fastest block size, by name."""
        best: dict[str, tuple[Way, int]] = {}
        for way in (self.rows, self.columns, self.product):
            blocks = {
                str(block): partial(way, reading, out, block) for block in (512, 1000, 2000, 4000)
            }
            times = least_seconds(blocks, 2)
            block = min(times, key=times.__getitem__)
            best[f"network in NumPy, {way.__name__}, blocks of {block}"] = (way, int(block))
        return best


# --- the measurement ---------------------------------------------------------------------------


def compiled(kind: str) -> CompensationTable:
    """Compile a model of one kind, fitted to 50 points of a generated chain."""
    data = make_chain("reference", 1).calibration(50)
    model = make_model(kind, range_nm=2000.0).fit(data.X, data.standard_nm)
    return compile_table(model, uncertainty=False)


def measure_batches(rounds: int) -> dict[str, float]:
    """Compare the speeds for a batch that is in the caches, as it is when just read from a file."""
    generator = np.random.default_rng(5)
    reading = generator.uniform(-2000.0, 2000.0, BATCH)
    # long stretches of one branch, as on a bench
    branch = np.repeat(generator.integers(-1, 2, BATCH // 1000 + 1), 1000)[:BATCH].astype(np.int8)
    out = np.empty_like(reading)
    networks = Network(7).tuned(reading, out)
    runs: dict[str, Callable[[], object]] = {}
    for name, (way, block) in networks.items():
        runs[name] = partial(way, reading, out, block)
    tables = {kind: compiled(kind) for kind in ("bayesian-network", "hybrid")}
    for kind, table in tables.items():
        label = f"{kind} (degree {table.curve.degree}, {table.curve.intervals} intervals)"
        runs[f"table {label}"] = partial(_often, partial(table.torque, reading, out=out))
        if table.curve.branch_aware:
            with_branches = partial(table.torque, reading, branch, out=out)
            runs[f"table {label}, branches"] = partial(_often, with_branches)
    for table in tables.values():  # compiles the kernels outside the measurement
        table.torque(reading[:9], branch[:9])
        table.torque(reading[:9])
    times = {
        name: seconds / (BATCH if name in networks else _BATCHES * BATCH)
        for name, seconds in least_seconds(runs, rounds).items()
    }
    print(f"{BATCH} readings, best of {rounds} rounds; bounds of the tables in % FS:")
    for kind, table in tables.items():
        print(f"  {kind}: {100 * table.bound_nm / table.full_scale_nm:.1e}")
    for name, seconds in times.items():
        print(f"  {name:<75} {seconds * 1e9:8.3f} ns a reading")
    natural = next(iter(networks))
    table_time = next(times[name] for name in times if name.startswith("table bayesian"))
    tuned = min(times[name] for name in networks)
    print(f"table of the network / fastest of the three ways, speed: {tuned / table_time:.3g}")
    return {"table / network in NumPy, speed": times[natural] / table_time}


def _often(run: Callable[[], object]) -> None:
    for _ in range(_BATCHES):
        run()


def measure_scalars(rounds: int) -> dict[str, float]:
    """Compare the speeds for single readings from plain Python."""
    table = compiled("hybrid")
    nodes = table.curve.nodes()
    values = table.torque(nodes)
    reading, calls = 1234.5, 20_000
    statements: dict[str, Callable[[], object]] = {
        "numpy.interp": lambda: np.interp(reading, nodes, values),
        "table.at(reading)": lambda: table.at(reading),
        "table.at(reading, branch)": lambda: table.at(reading, -1),
    }
    best = {
        name: min(timeit.repeat(statement, number=calls, repeat=rounds)) / calls
        for name, statement in statements.items()
    }
    for name, seconds in best.items():
        print(f"  {name:<75} {1e9 * seconds:9.0f} ns")
    return {
        f"table.at / numpy.interp, time, {name}": best[name] / best["numpy.interp"]
        for name in statements
        if name.startswith("table")
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; return 1 where an aim is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    rounds = 15 if parser.parse_args(arguments).quick else 60
    with threadpool_limits(1):
        figures = measure_batches(rounds) | measure_scalars(rounds)
    return int(not judge(Console(), "table", figures)[1])
