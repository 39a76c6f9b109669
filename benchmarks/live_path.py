"""Latency of the live path, block by block.

Eight channels of one core: a block of 10 ms of 60 kHz edges with 5 ns of jitter becomes frequency
and torque, and, for the two modules that a bench has, compensated torque with the uncertainty of a
chain that has all effects: hysteresis, temperature, rotation, running-in, inertia by the encoder's
acceleration, dynamics. It is checked by the supervisor; then the journal takes it, with every edge,
and a viewer whose queue is never read. All parts are those of a real bench, with the priority that
the system grants to acquisition. ``--compensated 8`` compensates all channels, which no bench does.
"""

from __future__ import annotations

import argparse
import gc
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from tests.support.rotating_chains import make_rotating_chain
from threadpoolctl import threadpool_limits

from benchmarks.reporting import judge, show
from benchmarks.rotating import fitted_chain
from benchmarks.safety import other_programs
from torquebench.bench.active_chain import ActiveChain, ZeroTaken
from torquebench.bench.blocks import Block, Viewer
from torquebench.bench.chain_effects import chain_effects
from torquebench.bench.channels import Channel
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription, default_bench
from torquebench.bench.drivers import open_drivers
from torquebench.bench.evaluating import BlockEvaluator
from torquebench.bench.roles import SIDES, Side, angle_channel, torque_channel
from torquebench.bench.safety import SafetySupervisor
from torquebench.bench.safety.priority import collecting_later, lift_process, prefer_this_thread
from torquebench.bench.state import CommandState
from torquebench.chain import Dynamics, Effect, MeasuringChain, Mounting, effect_from
from torquebench.compensation import RECOMMENDED, CompensationModel, features, make_model
from torquebench.records import RunFolder
from torquebench.signals import EdgeBlock, FrequencyCounter, Record
from torquebench.station.journal import QueuedJournal, RunJournal

CHANNELS = 8
BLOCK_S = 0.01
TIMEBASE_HZ = 100e6
JITTER_S = 5e-9
FULL_SCALE_NM = 2000.0
PERCENTILES = (50.0, 90.0, 99.0, 100.0)
PROBES = ("input_transducer", "output_transducer")

# The journal expects the two modules' channels; names of the other six are arbitrary.
NAMES = ("input_torque", "output_torque", *(f"torque_{number}" for number in range(2, CHANNELS)))


def pulse_trains(duration_s: float, draw: np.random.Generator) -> dict[str, NDArray[np.int64]]:
    """Return the edges of every channel, whose torque swings over nine tenths of the range."""
    trains = {}
    for index, name in enumerate(NAMES):
        number = np.arange(round(duration_s * 92e3))
        swing = 0.45 * np.sin(2.0 * np.pi * 0.5 * number / 60e3 + index)
        time_s = np.cumsum(1.0 / (60e3 * (1.0 + swing)))
        jittered = time_s + draw.normal(0.0, JITTER_S, time_s.size)
        trains[name] = np.floor(jittered * TIMEBASE_HZ).astype(np.int64)
    return trains


def edge_blocks(duration_s: float) -> Iterator[dict[str, EdgeBlock]]:
    """Yield the edges that a counter card would deliver every 10 ms."""
    trains = pulse_trains(duration_s, np.random.default_rng(1))
    step = round(BLOCK_S * TIMEBASE_HZ)
    for index in range(round(duration_s / BLOCK_S)):
        start, stop = index * step, (index + 1) * step
        blocks = {}
        for name, ticks in trains.items():
            first, last = np.searchsorted(ticks, (start, stop))
            blocks[name] = EdgeBlock(ticks[first:last].copy(), start, stop, TIMEBASE_HZ)
        yield blocks


def turning_effects() -> tuple[Effect, ...]:
    """Return effects of temperature, rotation and acceleration, fitted to a turning chain."""
    chain = make_rotating_chain("running-in", 1)
    found = fitted_chain(chain).stored
    part = FULL_SCALE_NM / chain.range_nm
    return tuple(_scaled(each, part) for each in found)


def _scaled(effect: Effect, part: float) -> Effect:
    """Return an effect scaled to another range: all torques are multiplied by `part`."""
    values = effect.specification()
    kind = values.pop("kind")
    scaled = {
        name: _times(value, part) if "_nm" in name and value else value
        for name, value in values.items()
    }
    return effect_from({"kind": kind, **scaled})


def _times(value: Any, part: float) -> Any:
    return [_times(each, part) for each in value] if isinstance(value, tuple) else part * value


def all_effects(description: BenchDescription) -> tuple[Effect, ...]:
    """Return every effect that a chain of the bench may have."""
    return (
        *chain_effects(description, "output", 23.0),
        *turning_effects(),
        Mounting("three positions", 0.01),
        Dynamics("steps", BLOCK_S, late_s=1e-3),
    )


def fitted_model() -> CompensationModel:
    """Fit the recommended model to a chain with hysteresis."""
    draw = np.random.default_rng(2)
    half = np.linspace(-FULL_SCALE_NM, FULL_SCALE_NM, 51)
    reading = np.concatenate((half, half[::-1]))
    branch = np.where(np.diff(np.abs(reading), append=FULL_SCALE_NM) > 0.0, 1, -1)
    extra = 4.0 * (reading / FULL_SCALE_NM) ** 2 + 0.3 * branch
    standard = reading + extra + draw.normal(0.0, 0.2, reading.size)
    return make_model(RECOMMENDED).fit(features(reading, branch), standard)


class Conditions(NamedTuple):
    """Readings of the instruments other than the counter card during a block."""

    celsius: float
    angle: Record

    @classmethod
    def of_block(cls, index: int) -> Conditions:
        """Return the conditions of one block while the shaft swings."""
        start_s = index * BLOCK_S
        time_s = start_s + np.arange(10, dtype=np.float64) * 1e-3
        celsius = 23.0 + 5.0 * float(np.sin(0.1 * start_s))
        counts = np.round(360_000 / 60.0 * 1200.0 * (1.0 - np.cos(0.5 * time_s)))
        return cls(celsius, Record({"time_s": time_s, "angle_counts": counts.astype(np.int64)}))


class LivePath:
    """Everything between the counter card and the journal, for eight channels."""

    def __init__(self, description: BenchDescription, compensated: int) -> None:
        drivers = replace(open_drivers(default_bench()), temperature=self)
        commands = CommandState()
        self.supervisor = SafetySupervisor(description, drivers, BenchClock(fast=False), commands)
        transducer = description.output.transducer
        chain = MeasuringChain(fitted_model()).with_effects(all_effects(description))
        self.chains = {name: ActiveChain(chain, "1", RECOMMENDED) for name in NAMES[:compensated]}
        for each in self.chains.values():
            each.zero = ZeroTaken(0.0, 23.0, 0.03)
        self.channels: dict[str, Channel] = {}
        for name in NAMES:
            counter = FrequencyCounter("regression", BLOCK_S, TIMEBASE_HZ, edge_jitter_s=JITTER_S)
            self.channels[name] = Channel(name, "output", False, transducer, counter, 0.25, None)
        self.evaluator = BlockEvaluator(description, drivers)
        self.index, self.celsius = 0, 23.0

    def temperatures(self) -> dict[str, float]:
        """Return the probes' temperatures, in place of an instrument."""
        return dict.fromkeys(PROBES, self.celsius)

    def push(self, edges: dict[str, EdgeBlock], conditions: Conditions) -> Block:
        """Turn edges into a checked and compensated block."""
        start_s, self.celsius = self.index * BLOCK_S, conditions.celsius
        angles = {angle_channel(side): conditions.angle for side in SIDES}
        measured = Block(start_s, start_s + BLOCK_S, edges, angles)
        block = self.evaluator.evaluate(measured, list(self.channels.values()))
        self.index += 1
        self.supervisor.check(block)
        modules: dict[Side, ActiveChain] = {
            side: self.chains[torque_channel(side)] for side in SIDES
        }
        further = list(self.chains.items())[len(SIDES) :]
        for (
            name,
            chain,
        ) in further:  # each is passed as an input module
            aside = {**block.records, torque_channel("input"): block.records[name]}
            self.evaluator.compensate([replace(block, records=aside)], {}, {"input": chain})
        return self.evaluator.compensate([block], self.channels, modules)


def measure(duration_s: float, compensated: int) -> NDArray[np.float64]:
    """Return each block's latency without and with journal and its processor time, ms, (3, n)."""
    description = default_bench()  # two modules of the larger range, without the limit of its speed
    limits = description.output.limits.model_copy(update={"speed_rpm": 1e4})
    module = description.output.model_copy(update={"limits": limits})
    description = description.model_copy(update={"input": module, "output": module})
    path = LivePath(description, compensated)
    viewer = Viewer(10)
    latencies = []
    with tempfile.TemporaryDirectory() as folder:
        writer = RunFolder.create(Path(folder), {}, kind="benchmark")
        journal = QueuedJournal(RunJournal(writer, PROBES, edges=True))
        gc.collect()
        for edges in edge_blocks(duration_s):
            conditions = Conditions.of_block(path.index)
            with collecting_later():
                begun, begun_s = time.perf_counter(), time.thread_time()
                block = path.push(edges, conditions)
                checked, own_s = time.perf_counter(), time.thread_time() - begun_s
                journal.write(block)
                viewer.put(block)
                done = time.perf_counter()
            latencies.append((checked - begun, done - begun, own_s))
            time.sleep(max(0.0, BLOCK_S - (done - begun)))
        journal.close()
        writer.close()
        written = sum(1 for _ in writer.folder.edges())
    if path.supervisor.alarm is not None:
        raise SystemExit(f"the supervisor tripped: {path.supervisor.alarm}")
    print(f"journal: {written} of {path.index * CHANNELS} blocks of edges kept")
    print(f"viewer that nobody empties: {viewer.dropped} of {path.index} blocks forgotten")
    if written != path.index * CHANNELS:
        raise SystemExit("the journal dropped blocks")
    return np.array(latencies[20:]).T * 1e3


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; 1 where the aim is missed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="ten seconds of edges, not sixty")
    parser.add_argument("--load", type=int, default=0, metavar="N", help="beside N busy programs")
    parser.add_argument(
        "--compensated", type=int, default=2, choices=range(2, CHANNELS + 1), metavar="N"
    )
    options = parser.parse_args(arguments)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    with threadpool_limits(1), other_programs(options.load), lift_process():
        priority = prefer_this_thread().description
        latencies = measure(10.0 if options.quick else 60.0, options.compensated)
    print(f"{CHANNELS} channels of 60 kHz, {options.compensated} of them compensated, one core,")
    print(f"{priority} priority, {options.load} busy programs, ms a block of {BLOCK_S * 1e3:g} ms:")
    titles = (
        "edges to checked, compensated torque",
        "with journal (edges) and viewer",
        "processor time of the first",
    )
    rows = [
        [title, *(f"{value:.3f}" for value in np.percentile(row, PERCENTILES))]
        for title, row in zip(titles, latencies, strict=True)
    ]
    console = Console()
    show(console, "ms a block", ["", "median", "90 %", "99 %", "worst"], rows)
    figures = {"block of 10 ms, 99 %, ms": float(np.percentile(latencies[1], 99.0))}
    return int(not judge(console, "live_path", figures)[1])
