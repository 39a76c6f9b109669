"""`torquebench apply` compared with PyArrow reading and writing the same table, as whole processes.

PyArrow only reads the table and writes it again, the least that any program has to do with it.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from statistics import median

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from rich.console import Console

from benchmarks.reporting import judge
from torquebench.campaign.fitting import store_model
from torquebench.compensation import RECOMMENDED, make_model
from torquebench.tables import read_calibration

RANGE_NM = 2000.0
PYARROW = """
import sys
import pyarrow, pyarrow.csv, pyarrow.parquet as pq
source, target = sys.argv[1:]
if source.endswith(".csv"):
    pyarrow.csv.write_csv(pyarrow.csv.read_csv(source), target)
else:
    pq.write_table(pq.read_table(source), target)
"""


def make_readings(folder: Path, rows: int) -> dict[str, Path]:
    """Write a record of the torque over an hour as CSV and as Parquet."""
    time_s = np.round(1e-3 * np.arange(rows), 3)
    rng = np.random.default_rng(1)
    reading = 0.95 * RANGE_NM * np.sin(0.05 * time_s) + rng.normal(0.0, 0.2, rows)
    table = pa.table({"time_s": time_s, "reading_nm": np.round(reading, 3)})
    files = {ending: folder / f"readings.{ending}" for ending in ("csv", "parquet")}
    pyarrow.csv.write_csv(table, files["csv"])
    pyarrow.parquet.write_table(table, files["parquet"])
    return files


def make_chain(file: Path) -> None:
    """Fit the default model to the examples' simulated calibration; write its model file."""
    data = read_calibration(Path("examples/calibration-output.csv"), range_nm=RANGE_NM)
    model = make_model(RECOMMENDED, range_nm=RANGE_NM).fit(data.features(), data.standard_nm)
    store_model(file, model, data, {})


def measured(command: list[str]) -> tuple[float, float, float]:
    """Return the wall time and the processor time of a process in s, and its memory in MB."""
    started = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{command} ended with {status}")
    wall = time.perf_counter() - started
    return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print one line for each format; return 1 where an aim is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the rows, one pair")
    parser.add_argument("--rows", type=int, default=10_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    asked = parser.parse_args(arguments)
    if asked.quick:
        asked.rows, asked.repeats = asked.rows // 10, 1
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        chain = folder / "chain.json"
        make_chain(chain)
        print(f"{asked.rows} rows, {os.cpu_count()} cores, median of {asked.repeats} pairs")
        # in a process of its own, because the memory of a large parent would count for its
        # children
        with ProcessPoolExecutor(1) as aside:
            files = aside.submit(make_readings, folder, asked.rows).result()
        for ending, source in files.items():
            target = folder / f"torque.{ending}"
            ours = [sys.executable, "-c", "from torquebench.cli import main; main()", "apply"]
            ours += [str(chain), str(source), "--out", str(target)]
            alone = [sys.executable, "-c", PYARROW, str(source), str(target)]
            pairs = [(measured(ours), measured(alone)) for _ in range(asked.repeats)]
            ratio = median(mine[0] / theirs[0] for mine, theirs in pairs)
            seconds = [median(each[side][0] for each in pairs) for side in (0, 1)]
            worked = [median(each[side][1] for each in pairs) for side in (0, 1)]
            memory = [max(each[side][2] for each in pairs) for side in (0, 1)]
            figures[f"{ending}, wall time / PyArrow's"] = ratio
            figures[f"memory, MB, {ending}"] = memory[0]
            print(
                f"{ending} -> {ending}: {ratio:.2f} times PyArrow "
                f"({seconds[0]:.1f} s and {seconds[1]:.1f} s; "
                f"of processor time {worked[0]:.1f} s and {worked[1]:.1f} s; "
                f"{memory[0]:.0f} MB and {memory[1]:.0f} MB)",
                flush=True,
            )
    return int(not judge(Console(), "apply", figures)[1])
