"""How fast the simulated bench runs its procedures, beside a reference version of the program.

    python -m benchmarks.simulated_bench [--reference 8a12dd5] [--procedure "test hysteresis"]

Each procedure is a whole command in a process of its own, this version and the reference one after
the other, with compiled kernels warm. Bench time is the time of the samples that the runs recorded;
the ratio is bench time by processor time (user and system, all threads), which a busy computer
changes less than wall time. 8a12dd5 is the last version of 0.1.0.
"""

import argparse
import os
import subprocess
import sys
import tarfile
import tempfile
import time
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

HERE = Path(__file__).resolve().parents[1]
REFERENCE = "8a12dd5"
PROCEDURES = ("test hysteresis --yes", "test full --short --yes", "demo --quick")
COMMAND = "import sys; sys.argv[0] = 'torquebench'; from torquebench.cli import main; main()"


def exported(revision: str, folder: Path) -> Path:
    """Write the source of a revision into a folder; return it."""
    archive = subprocess.run(
        ["git", "archive", revision, "src"], cwd=HERE, check=True, capture_output=True
    ).stdout
    with tarfile.open(fileobj=BytesIO(archive)) as packed:
        packed.extractall(folder, filter="data")
    return folder / "src"


def bench_time_s(data: Path) -> float:
    """Return the bench time that the runs of a data directory recorded, s."""
    total = 0.0
    for file in sorted(data.glob("runs/*/raw.parquet")):
        time_s = np.asarray(pq.read_table(file, columns=["time_s"])["time_s"])
        total += float(time_s[-1] - time_s[0])
    return total


def measured(source: Path, procedure: str) -> tuple[float, float, float]:
    """Return bench time, processor time and wall time of a procedure by a version, all in s."""
    environment = {**os.environ, "PYTHONPATH": str(source)}
    command = [sys.executable, "-c", COMMAND, *procedure.split()]
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        _, status, usage = os.wait4(process.pid, 0)
        wall_s = time.perf_counter() - started
        if os.waitstatus_to_exitcode(status) not in (0, 1):  # 1: the verdict is a failure
            raise SystemExit(f"{procedure} ended with {os.waitstatus_to_exitcode(status)}")
        return (
            bench_time_s(Path(folder) / "torquebench-data"),
            usage.ru_utime + usage.ru_stime,
            (wall_s),
        )


def main() -> None:
    """Measure and print a row a procedure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reference", default=REFERENCE)
    parser.add_argument("--procedure", action="append")
    asked = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.0f}, reference {asked.reference}")
    print("| procedure | bench time, s | processor time, s | of the reference, s | faster |")
    print("| --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        old = exported(asked.reference, Path(folder))
        for procedure in asked.procedure or PROCEDURES:
            measured(HERE / "src", procedure)  # compiles
            measured(old, procedure)
            bench_s, processor_s, _ = measured(HERE / "src", procedure)
            reference_bench_s, reference_s, _ = measured(old, procedure)
            faster = (bench_s / processor_s) / (reference_bench_s / reference_s)
            print(
                f"| `{procedure}` | {bench_s:.0f} | {processor_s:.1f} | {reference_s:.1f} "
                f"({reference_bench_s:.0f} s of bench time) | {faster:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
