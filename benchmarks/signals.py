"""Speed and noise of the frequency counters, compared with plain reads of memory.

Everything runs in one thread. Times are processor times of this process, the least of several
rounds in which all contenders take turns. Other programs may slow all of them through caches and
memory, but their processor time isn't counted.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from benchmarks.reporting import judge, least_seconds, show
from torquebench.signals import (
    CounterMethod,
    EdgeBlock,
    FrequencyCounter,
)

TIMEBASE_HZ = 100e6
WINDOW_TICKS = 100_000
METHODS: tuple[CounterMethod, ...] = ("reciprocal", "regression", "triangular")
# Edges in one block: about a minute of a transducer's signal, as when a record is evaluated.
BLOCK_EDGES = 2**22
JITTER_S = 5e-9
DAY_EDGES = 4 * 60e3 * 86_400
"""Edges that four transducers deliver in a day."""

Ticks = NDArray[np.int64]


def pulse_train(frequency_hz: float, edges: int, seed: int) -> Ticks:
    """Return edges with jitter, in ticks of the timebase."""
    generator = np.random.default_rng(seed)
    times = np.cumsum(np.full(edges, TIMEBASE_HZ / frequency_hz)) + 1000.0
    times += generator.normal(0.0, JITTER_S * TIMEBASE_HZ, edges)
    return np.floor(times).astype(np.int64)


def count_stream(ticks: Ticks, method: CounterMethod) -> None:
    """Run a counter over a stream, cut into blocks."""
    counter = FrequencyCounter(method, WINDOW_TICKS / TIMEBASE_HZ, TIMEBASE_HZ)
    start = 0
    for first in range(0, ticks.size, BLOCK_EDGES):
        part = ticks[first : first + BLOCK_EDGES]
        stop = int(part[-1]) + 1
        counter.push(EdgeBlock(part, start, stop, TIMEBASE_HZ))
        start = stop


def measure_counters(
    console: Console, frequency_hz: float, edges: int, rounds: int
) -> dict[str, float]:
    """Return million edges per second of each counter, and of plain reads and copies."""
    ticks = pulse_train(frequency_hz, edges, seed=1)
    target = np.empty_like(ticks)
    fast: dict[str, Callable[[], object]] = {
        "plain read (sum)": lambda: np.sum(ticks),
        "plain copy": lambda: np.copyto(target, ticks),
    }
    for method in METHODS:
        fast[method] = partial(count_stream, ticks, method)
    seconds = least_seconds(fast, rounds)
    rates = {name: edges / value / 1e6 for name, value in seconds.items()}
    rows = [
        [name, f"{rate:.0f}", f"{rate / rates['plain read (sum)']:.3f}"]
        for name, rate in rates.items()
    ]
    title = f"Counters, {frequency_hz / 1e3:g} kHz, 1 ms windows, 64-bit ticks"
    show(console, title, ["", "million edges/s", "of a plain read"], rows)
    day_s = DAY_EDGES / (2 * rates["regression"] * 1e6)
    return {f"a day of four channels on two cores, s, {frequency_hz / 1e3:g} kHz": day_s}


def noise_ratio(method: CounterMethod, windows: int) -> tuple[float, float]:
    """Return the measured noise in ppm, and its ratio to theory, for windows of 1 ms."""
    generator = np.random.default_rng(7)
    frequency = generator.uniform(59e3, 61e3, windows)
    period = TIMEBASE_HZ / frequency[:, None]
    starts = np.arange(windows) * WINDOW_TICKS
    number = np.arange(int(WINDOW_TICKS / period.max()) - 1)
    # Well inside the window, so that jitter moves no edge out of it.
    phase = generator.uniform(0.1, 0.5, (windows, 1))
    times = starts[:, None] + (phase + number) * period
    times += generator.normal(0.0, JITTER_S * TIMEBASE_HZ, times.shape)
    counter = FrequencyCounter(
        method,
        WINDOW_TICKS / TIMEBASE_HZ,
        TIMEBASE_HZ,
        edge_jitter_s=JITTER_S,
        check_train=False,
    )
    ticks = np.floor(times).astype(np.int64).ravel()
    counted = counter.push(EdgeBlock(ticks, 0, windows * WINDOW_TICKS, TIMEBASE_HZ))
    error = (counted["frequency_hz"] - frequency) / frequency
    theory = counted["frequency_uncertainty_hz"] / frequency
    scatter = float(np.sqrt(np.mean(error**2)))
    return scatter * 1e6, scatter / float(np.sqrt(np.mean(theory**2)))


def measure_noise(console: Console, windows: int) -> dict[str, float]:
    """Compare the noise caused by jitter with the formulas of arXiv:1506.05009."""
    found = {name: noise_ratio(name, windows) for name in METHODS}
    rows = [
        [name, f"{scatter:.2f}", f"{2 * scatter:.2f}", f"{ratio:.3f}"]
        for name, (scatter, ratio) in found.items()
    ]
    title = "Noise, 60 kHz, 1 ms windows, 100 MHz timebase, 5 ns jitter"
    show(console, title, ["", "ppm of the frequency", "ppm of full scale", "of theory"], rows)
    return {f"noise, of theory, {name}": ratio for name, (_, ratio) in found.items()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; return 1 where an aim is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="end within a minute")
    quick = parser.parse_args(arguments).quick
    console = Console()
    edges, rounds = (2**24, 60) if quick else (2**26, 100)
    figures = measure_counters(console, 60e3, edges, rounds)
    figures |= measure_counters(console, 240e3, edges, rounds)
    figures |= measure_noise(console, 8_000 if quick else 40_000)
    return int(not judge(console, "signals", figures)[1])
