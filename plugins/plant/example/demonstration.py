"""Demonstrate three simulated benches and a plant: the link is cut, and no record is lost.

make plant, or: python -m plugins.plant.example.demonstration

PostgreSQL comes from Debian's package (apt install postgresql) and runs in a folder of its own,
which is removed at the end. Only the benches are simulated.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from sqlalchemy import URL
from tests import postgresql_server

import torquebench as torquebench_package
from torquebench.records import Registry
from torquebench_plant import Plant, forward

BENCHES = ("Bench 1", "Bench 1", "Bench 2")  # two benches with the same name, in two halls
SIMULATED = Path(torquebench_package.__file__).parent / "bench" / "simulated.toml"
PLACES = ("Hall 1", "Hall 2", "Hall 2")


def torquebench(*words: object, may_fail: bool = False) -> int:
    """Print a command and run it as a user does."""
    said = [str(word) for word in words]
    print("\n$ torquebench", *said, flush=True)
    environment = {**os.environ, "TORQUEBENCH_OPERATOR": "demonstration"}
    code = subprocess.run(
        [sys.executable, "-m", "torquebench", *said], check=False, env=environment
    ).returncode
    if code and not may_fail:
        sys.exit(code)
    return code


def main() -> None:
    """Run the demonstration, and exit with 1 if a run was lost."""
    if postgresql_server.binaries() is None:
        sys.exit("PostgreSQL isn't installed. On Debian: apt install postgresql")
    with (
        tempfile.TemporaryDirectory(prefix="torquebench-plant-") as folder,
        postgresql_server.restartable(durable=True) as server,
    ):
        lost = demonstrate(server, Path(folder))
        if "--view" in sys.argv[1:]:
            print("\nThe plant view; Ctrl-C ends the demonstration.")
            torquebench("plant", "view", "--plant", server.url, may_fail=True)
    sys.exit(1 if lost else 0)


def demonstrate(server: postgresql_server.Server, place: Path) -> int:
    """Stop the plant's server and start it again; return how many runs the plant lacks."""
    (place / "share").mkdir()
    admin = ("--plant", server.url)
    torquebench("plant", "init", "--folders", f"file://{place}/share", *admin)
    links = []
    with Plant.open(server.url) as plant:
        for name, hall in zip(BENCHES, PLACES, strict=True):
            links.append(plant.register_bench(name, hall)[1])
    data = [place / f"bench-{number}" for number in (1, 2, 3)]

    described = []
    for number in (1, 2, 3):  # each bench has its own transducer and noise
        text = SIMULATED.read_text(encoding="utf-8").replace("SIM-T2000", f"SIM-T2000-{number}")
        described.append(place / f"bench-{number}.toml")
        described[-1].write_text(text.replace("seed = 1", f"seed = {number}"), encoding="utf-8")

    print("\n== Three benches calibrate, and send ==")
    settings = ("--step", 25, "--model", "polynomial")
    for folder, bench, link in zip(data, described, links, strict=True):
        torquebench("calibrate", "output", *settings, "--bench", bench, "--data", folder)
        push(folder, link)
    torquebench("plant", "status", *admin)

    print("\n== The link goes down; the benches go on ==")
    server.stop()
    for folder, bench in zip(data, described, strict=True):
        torquebench("check", "output", "--tolerance", 0.5, "--bench", bench, "--data", folder)
    print("\nbench 1 tries to send:", flush=True)
    try:
        push(data[0], links[0])
    except Exception as error:
        print(f"  {getattr(error, 'found', error)}")

    print("\n== The link is back ==")
    server.start()
    for folder, link in zip(data, links, strict=True):
        push(folder, link)
    torquebench("plant", "verify", "--folders", *admin)
    torquebench("plant", "runs", *admin)
    torquebench("plant", "drift", "SIM-T2000-1", *admin)
    torquebench("plant", "due", "--within", 400, *admin)
    return count(server, data)


def push(folder: Path, link: URL) -> None:
    """Send a bench's records that the plant lacks."""
    begin = time.perf_counter()
    with Registry.open(folder) as registry:
        done = forward(registry, link.render_as_string(hide_password=False))
    print(
        f"  bench {done.bench}: {done.entries} entries, {done.folders} folders sent "
        f"in {time.perf_counter() - begin:.1f} s",
        flush=True,
    )


def count(server: postgresql_server.Server, data: list[Path]) -> int:
    """Compare the runs of benches and plant; return how many runs the plant lacks."""
    with Plant.open(server.url) as plant:
        known = [(run.bench_key, run.run_id) for run in plant.runs(10_000) if run.url]
        heads = {state.number: state.head for state in plant.benches()}
    measured = 0
    for number, folder in enumerate(data, start=1):
        with Registry.open(folder) as registry:
            measured += registry.number_of_runs()
            assert registry.head() == heads[number]
    lost, twice = measured - len(set(known)), len(known) - len(set(known))
    print(
        f"\n{measured} runs were measured, {len(known)} are in the plant: "
        f"{lost} lost, {twice} twice; every chain ends as at its bench"
    )
    return lost + twice


if __name__ == "__main__":
    main()
