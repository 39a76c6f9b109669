"""Speed and noise of the signal path, beside other solutions and plain reads of memory.

``python -m benchmarks.signals [--quick]`` prints what it measures and exits with 1 where an aim
is missed. Everything runs in one thread. Times are the processor's time for this process, the
least of several rounds in which all contenders take turns: other work on the machine may make
all of them slower by its use of caches and memory, but doesn't count as theirs.
"""

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks import signal_solutions as solutions
from torquebench.signals import (
    CounterMethod,
    EdgeBlock,
    FrequencyCounter,
    FrequencyScale,
)

TIMEBASE_HZ = 100e6
WINDOW_TICKS = 100_000
METHODS: tuple[CounterMethod, ...] = ("reciprocal", "regression", "triangular")
# Edges handed to a stream at once: about a minute of a transducer, as when a record is evaluated.
BLOCK_EDGES = 2**22
JITTER_S = 5e-9
DAY_EDGES = 4 * 60e3 * 86_400
"""Recorded in a day by four transducers."""
DAY_LIMIT_S = 60.0

Ticks = NDArray[np.int64]


@dataclass(frozen=True)
class Aim:
    """A figure with the limit that it must keep."""

    name: str
    value: float
    limit: float
    at_least: bool = True

    @property
    def met(self) -> bool:
        """Whether the limit is kept."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit


def pulse_train(frequency_hz: float, edges: int, seed: int) -> Ticks:
    """Edges with jitter, in ticks of the timebase."""
    generator = np.random.default_rng(seed)
    times = np.cumsum(np.full(edges, TIMEBASE_HZ / frequency_hz)) + 1000.0
    times += generator.normal(0.0, JITTER_S * TIMEBASE_HZ, edges)
    return np.floor(times).astype(np.int64)


def least_seconds(contenders: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Least processor time of each contender over rounds in which all take turns."""
    least = dict.fromkeys(contenders, np.inf)
    for run in contenders.values():
        run()
    for _ in range(rounds):
        for name, run in contenders.items():
            begin = time.process_time()
            run()
            least[name] = min(least[name], time.process_time() - begin)
    return least


def count_stream(ticks: Ticks, method: CounterMethod) -> None:
    """Run a counter over a stream, cut into blocks."""
    counter = FrequencyCounter(method, WINDOW_TICKS / TIMEBASE_HZ, TIMEBASE_HZ)
    start = 0
    for first in range(0, ticks.size, BLOCK_EDGES):
        part = ticks[first : first + BLOCK_EDGES]
        stop = int(part[-1]) + 1
        counter.push(EdgeBlock(part, start, stop, TIMEBASE_HZ))
        start = stop


def measure_counters(console: Console, frequency_hz: float, edges: int, rounds: int) -> list[Aim]:
    """Million edges per second of each counter and of other solutions."""
    ticks = pulse_train(frequency_hz, edges, seed=1)
    target = np.empty_like(ticks)
    fast: dict[str, Callable[[], object]] = {
        "plain read (sum)": lambda: np.sum(ticks),
        "plain copy": lambda: np.copyto(target, ticks),
    }
    for method in METHODS:
        fast[method] = partial(count_stream, ticks, method)
    others: dict[str, Callable[[], object]] = {
        f"regression by {name}": partial(solve, ticks, WINDOW_TICKS, TIMEBASE_HZ)
        for name, solve in solutions.available().items()
    }
    seconds = least_seconds(fast, rounds) | least_seconds(others, 5)
    rates = {name: edges / value / 1e6 for name, value in seconds.items()}
    table = Table(title=f"Counters, {frequency_hz / 1e3:g} kHz, 1 ms windows, 64-bit ticks")
    for heading in ("", "million edges/s", "of a plain read", "regression is faster by"):
        table.add_column(heading, justify="left" if not heading else "right")
    for name, rate in rates.items():
        share, times = rate / rates["plain read (sum)"], rates["regression"] / rate
        table.add_row(name, f"{rate:.0f}", f"{share:.3f}", f"{times:.1f}")
    console.print(table)
    day_s = DAY_EDGES / (2 * rates["regression"] * 1e6)
    name = f"s for a day of four channels on two cores, counted at {frequency_hz / 1e3:g} kHz"
    return [Aim(name, day_s, DAY_LIMIT_S, at_least=False)]


def noise_ratio(method: CounterMethod, windows: int) -> tuple[float, float]:
    """Measured noise in ppm, and its ratio to theory, over windows of 1 ms each."""
    generator = np.random.default_rng(7)
    frequency = generator.uniform(59e3, 61e3, windows)
    period = TIMEBASE_HZ / frequency[:, None]
    starts = np.arange(windows) * WINDOW_TICKS
    number = np.arange(int(WINDOW_TICKS / period.max()) - 1)
    # Well inside the window, so that no edge falls out of it.
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


def measure_noise(console: Console, windows: int) -> list[Aim]:
    """Noise with jitter against the formulas of arXiv:1506.05009."""
    table = Table(title="Noise, 60 kHz, 1 ms windows, 100 MHz timebase, 5 ns jitter")
    for heading in ("", "ppm of the frequency", "ppm of full scale", "of theory"):
        table.add_column(heading, justify="left" if not heading else "right")
    aims = []
    for name in METHODS:
        scatter, ratio = noise_ratio(name, windows)
        table.add_row(name, f"{scatter:.2f}", f"{2 * scatter:.2f}", f"{ratio:.3f}")
        aims.append(Aim(f"noise of {name}, of theory", ratio, 1.05, at_least=False))
    console.print(table)
    return aims


def measure_live_path(console: Console, blocks: int) -> None:
    """Show how long edges take to torque with uncertainty; `benchmarks.live_path` has the aim."""
    channels = 8
    block_ticks = 1_000_000
    ticks = pulse_train(60e3, int(blocks * 600 * 1.01), seed=5)
    borders = np.searchsorted(ticks, np.arange(blocks + 1) * block_ticks)
    counters = [FrequencyCounter("regression", 1e-3, TIMEBASE_HZ) for _ in range(channels)]
    scale = FrequencyScale.symmetric(2000.0)
    seconds = np.empty(blocks)
    for block in range(blocks):
        part = ticks[borders[block] : borders[block + 1]]
        begin = time.perf_counter()
        for counter in counters:
            edges = EdgeBlock(part, block * block_ticks, (block + 1) * block_ticks, TIMEBASE_HZ)
            scale.readings(counter.push(edges))
        seconds[block] = time.perf_counter() - begin
    table = Table(title="Edges to torque, 8 channels of 60 kHz, a block of 10 ms, 1 ms windows")
    shown = []
    for percentile in (50, 90, 99):
        value = float(np.percentile(seconds[blocks // 20 :], percentile)) * 1e3
        table.add_column(f"{percentile} %, ms", justify="right")
        shown.append(f"{value:.3f}")
    table.add_row(*shown)
    console.print(table)


def main() -> int:
    """Run the benchmark; return 1 where an aim is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="end within a minute")
    quick = parser.parse_args().quick
    console = Console()
    edges = 2**24 if quick else 2**26
    rounds = 60 if quick else 100
    aims = measure_counters(console, 60e3, edges, rounds)
    aims += measure_counters(console, 240e3, edges, rounds)
    aims += measure_noise(console, 8_000 if quick else 40_000)
    measure_live_path(console, 1_000 if quick else 10_000)
    if "polars" not in "".join(solutions.available()):
        console.print("polars isn't installed: pip install '.[benchmarks]' to compare with it")
    table = Table(title="Aims")
    for heading in ("", "measured", "aim", ""):
        table.add_column(heading)
    for aim in aims:
        sign = "≥" if aim.at_least else "≤"
        table.add_row(
            aim.name, f"{aim.value:.3g}", f"{sign} {aim.limit:g}", "met" if aim.met else "MISSED"
        )
    console.print(table)
    return 0 if all(aim.met for aim in aims) else 1


if __name__ == "__main__":
    sys.exit(main())
