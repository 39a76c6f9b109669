"""Frequency acquisition: error budget, counted pulse trains, and the stream of a counter card."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from torquebench.message import Message
from torquebench.papers.items import Answer
from torquebench.reports.errors_table import number
from torquebench.reports.page import Block, Table
from torquebench.signals import CounterMethod, EdgeBlock, FrequencyCounter
from torquebench.units import MS_PER_S, TURN

CHANNELS = 4
"""Number of channels: two transducers, and the two outputs of the standard."""
CENTRE_HZ, SPAN_HZ = 60e3, 30e3
"""Frequency at zero torque, and its change at full scale, of a 60 kHz transducer."""
TIMEBASE_HZ, JITTER_S = 100e6, 5e-9
TIMEBASE_PPM = 1.0
BLOCK_S, HELD_BLOCKS = 0.01, 100
"""Length of the simulated card's blocks, and number of blocks that it can store."""
LIMIT_PERCENT = 0.1
PPM = 1e6
_STEADY_S = 2.0
Blocks = list[Block]


def _ticks(frequency_hz: NDArray[np.float64] | float, edges: int, seed: int) -> NDArray[np.int64]:
    """Return the edges of a pulse train with jitter, in ticks of the timebase."""
    periods = np.broadcast_to(1.0 / np.asarray(frequency_hz), edges)
    jitter = np.random.default_rng(seed).normal(0.0, JITTER_S, edges)
    return np.floor((np.cumsum(periods) + jitter) * TIMEBASE_HZ).astype(np.int64)


@dataclass(frozen=True)
class Streamed:
    """Result of counting a stream of blocks.

    Attributes
    ----------
    edges_per_s : float
        Rate of edges on all channels together.
    seconds : float
    blocks, lost : int
        Numbers of delivered blocks, and of blocks lost because the card's storage was full.
    faults : int
        Number of windows in which a counter reported a fault.
    """

    edges_per_s: float
    seconds: float
    blocks: int
    lost: int
    faults: int


@cache
def streamed(seconds: float) -> Streamed:
    """Count the edges of a simulated card in real time; it loses blocks when its storage is full.

    The torque on all channels oscillates over nine tenths of the range. The card stores one second.
    """
    count = round(seconds / BLOCK_S)
    swing = (
        0.9 * SPAN_HZ * np.sin(TURN * 0.5 * np.arange(round(1.5 * CENTRE_HZ * seconds)) / CENTRE_HZ)
    )
    trains = [_ticks(CENTRE_HZ + swing, swing.size, seed) for seed in range(CHANNELS)]
    borders = np.arange(count + 1) * round(BLOCK_S * TIMEBASE_HZ)
    cuts = [np.searchsorted(train, borders) for train in trains]
    stored: queue.Queue[int] = queue.Queue(HELD_BLOCKS)
    lost = 0

    def deliver() -> None:
        nonlocal lost
        begun = time.perf_counter()
        for block in range(count):
            time.sleep(max(begun + (block + 1) * BLOCK_S - time.perf_counter(), 0.0))
            try:
                stored.put_nowait(block)
            except queue.Full:
                lost += 1
        stored.put(count)

    counters = [
        FrequencyCounter("regression", BLOCK_S, TIMEBASE_HZ, edge_jitter_s=JITTER_S)
        for _ in range(CHANNELS)
    ]
    card = threading.Thread(target=deliver, name="torquebench-card", daemon=True)
    card.start()
    edges = faults = 0
    while (block := stored.get()) < count:
        start, stop = borders[block : block + 2].tolist()
        for train, cut, counter in zip(trains, cuts, counters, strict=True):
            ticks = train[cut[block] : cut[block + 1]]
            edges += ticks.size
            faults += int(
                np.count_nonzero(counter.push(EdgeBlock(ticks, start, stop, TIMEBASE_HZ))["fault"])
            )
    card.join()
    return Streamed(edges / seconds, seconds, count, lost, faults)


def _counted_ppm(method: CounterMethod, window_s: float) -> tuple[float, float]:
    """Return u of one window as the counter states it and as measured, ppm FS."""
    frequency = CENTRE_HZ + SPAN_HZ * 0.7310585  # the period isn't a simple fraction of a tick
    edges = round(frequency * _STEADY_S)
    counter = FrequencyCounter(method, window_s, TIMEBASE_HZ, edge_jitter_s=JITTER_S)
    end = round(_STEADY_S * TIMEBASE_HZ)
    ticks = _ticks(frequency, edges, 7)
    found = counter.push(EdgeBlock(ticks[ticks < end], 0, end, TIMEBASE_HZ))
    values = found["frequency_hz"]
    stated = float(np.mean(found["frequency_uncertainty_hz"]))
    return PPM * stated / SPAN_HZ, PPM * float(np.std(values, ddof=1)) / SPAN_HZ


def acquisition_blocks() -> tuple[Answer, Blocks]:
    """Return the error budget of one window, and the counters' stated and measured u."""
    frequency, tau = CENTRE_HZ + SPAN_HZ, BLOCK_S
    by_noise = PPM * 12.0**0.5 * frequency / (tau * (frequency * tau) ** 0.5) / SPAN_HZ
    lines = [
        ("quantisation of an edge by the timebase, 10 ns", by_noise / TIMEBASE_HZ / 12.0**0.5),
        ("jitter of an edge, 5 ns", by_noise * JITTER_S),
        ("timebase, 1 ppm: gain", TIMEBASE_PPM / 3.0**0.5),
        ("timebase, 1 ppm: zero", TIMEBASE_PPM * CENTRE_HZ / SPAN_HZ / 3.0**0.5),
    ]
    sum_ppm = float(np.linalg.norm([u for _, u in lines]))
    rows = [[name, number(u), number(1e-4 * u)] for name, u in lines]
    rows.append(["U (k = 2)", number(2.0 * sum_ppm), number(2e-4 * sum_ppm)])
    methods: tuple[CounterMethod, ...] = ("reciprocal", "regression")
    counted = [
        [
            Message("{method}, {window:g} ms", method, MS_PER_S * window_s),
            *map(number, _counted_ppm(method, window_s)),
        ]
        for method, window_s in product(methods, (0.001, 0.01))
    ]
    answer = Answer(
        Message("U = {u} % FS of one window of 10 ms at full scale", number(2e-4 * sum_ppm)),
        "met" if 2e-4 * sum_ppm <= LIMIT_PERCENT else "not met",
        "A calibration with the same clock contains the timebase's part",
    )
    return answer, [
        Table(
            ("source", "u, ppm FS", "% FS"),
            rows,
            "Regression counter, 60 kHz option, 100 MHz, one window of 10 ms at full scale. The "
            "timebase is rectangular within its limit: an error of its frequency changes zero and "
            "gain alike.",
        ),
        Table(
            ("counter, window", "u as stated, ppm FS", "standard deviation as counted, ppm FS"),
            counted,
            "One simulated train of 2 s with 5 ns of jitter.",
        ),
    ]
