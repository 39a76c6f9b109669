"""Writes runs in child processes and kills each at a random moment; run as a script.

Imports once, then forks a child for every run. A child tells after every block what was
acknowledged; what the last whole line says before SIGKILL is printed as JSON. Moments are counted
from the fork, from the first acknowledged edges, or from the end of writing, when sealing begins,
so that a slow disk moves them along.
"""

import json
import os
import random
import signal
import sys
import time
from pathlib import Path

import numpy as np

from torquebench.records import RunFolder
from torquebench.records.streams import arrow_stream
from torquebench.signals import EdgeBlock

BLOCK_TICKS = 100_000
CHANNELS = ("input_torque", "output_torque")
ROWS = 3
LONGEST_S = 0.1
"""How long after its moment a child is killed at the latest."""
SHORT = 8
"""Blocks of a run that is killed while it is sealed."""


def edges(index: int) -> dict[str, EdgeBlock]:
    """Edges of a block: jittered, with a channel that is silent now and then."""
    draw = np.random.default_rng(index)
    start, stop = index * BLOCK_TICKS, (index + 1) * BLOCK_TICKS
    blocks = {}
    for number, name in enumerate(CHANNELS):
        ticks = start + 10 + np.cumsum(draw.integers(1600, 1730, 55))
        silent = (index + number) % 7 == 0
        blocks[name] = EdgeBlock(ticks[:0] if silent else ticks, start, stop, 100e6)
    return blocks


def samples(index: int) -> dict[str, np.ndarray]:
    """Derived samples of a block."""
    time_s = (index * ROWS + np.arange(ROWS)) * 1e-3
    return {"time_s": time_s, "torque_nm": np.sin(time_s)}


def write(runs: Path, name: str, pipe: int, last: int) -> None:
    """Write a run as fast as it goes, telling what is acknowledged; seal it at the end."""
    writer = RunFolder.create(runs, {}, kind="kill", run_id=name)
    for index in range(last):
        writer.samples(samples(index))
        writer.edges(edges(index))
        writer.document("event", {"seq_num": index})
        said = [index + 1, writer.acknowledged_rows, writer.acknowledged_tick or 0]
        os.write(pipe, (json.dumps(said) + "\n").encode())
    writer.seal()


def main(runs: Path, count: int, seed: int) -> None:
    """Write and kill so many runs."""
    arrow_stream.FLUSH_INTERVAL_S = 0.004
    draw = random.Random(seed)
    acknowledged = {}
    for number in range(count):
        name, moment = f"killed-{number}", number % 5
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            try:
                write(runs, name, writing, SHORT if moment == 0 else 1_000_000)
            finally:
                os._exit(0)
        os.close(writing)
        with os.fdopen(reading, "rb") as pipe:
            said = [0, 0, 0]
            while moment != 1 and not (said[0] == SHORT if moment == 0 else said[2] > 0):
                said = json.loads(pipe.readline())
            time.sleep(draw.uniform(0.0, LONGEST_S))
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            for line in pipe:
                if line.endswith(b"\n"):
                    said = json.loads(line)
        acknowledged[name] = said
    print(json.dumps(acknowledged))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
