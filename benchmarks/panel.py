"""What the panel costs beside the bench: live rows for watchers, and how fast a stop acts.

Starts `torquebench panel` on the simulated bench in real time and measures its processor time
with no watcher, with one and with four, each of eight channels; then stops a loaded bench over
HTTP again and again. Run it with ``python -m benchmarks.panel``.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import psutil  # type: ignore[import-untyped]
from websockets.sync.client import connect

CHANNELS = [
    f"{side}_{name}"
    for side in ("input", "output")
    for name in ("raw_nm", "torque_nm", "speed_rpm", "temperature_c")
]
SECONDS = 20.0
STOPS = 10
COMMAND = str(Path(sys.executable).parent / "torquebench")


@contextlib.contextmanager
def _panel(folder: Path, *options: str) -> Iterator[tuple[psutil.Process, httpx.Client, str]]:
    process = subprocess.Popen(
        [COMMAND, "panel", "--port", "0", "--data", str(folder), *options],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    url = code = ""
    while not code:
        line = process.stdout.readline()
        url = line.split()[-1] if line.startswith("Panel:") else url
        code = line.split()[-1] if "code" in line else code
    account = {"name": "Admin", "password": "correct horse battery"}
    client = httpx.Client(base_url=f"{url}/api/v1", timeout=60)
    token = client.post("/setup", json={"code": code, **account}).json()["token"]
    client.headers["Authorization"] = f"Bearer {token}"
    try:
        yield psutil.Process(process.pid), client, token
    finally:
        client.close()
        process.terminate()
        process.wait()


def _watch(url: str, token: str, ended: threading.Event, counts: list[int]) -> None:
    with connect(url.replace("http", "ws", 1) + "stream") as socket:
        socket.send(json.dumps({"token": token, "signals": CHANNELS, "rate": 50}))
        updates = 0
        while not ended.is_set():
            socket.recv()
            updates += 1
    counts.append(updates)


def _share(
    server: psutil.Process, client: httpx.Client, token: str, watchers: int
) -> tuple[float, float]:
    """Return the share of one core, %, and updates a second for each watcher."""
    ended, counts = threading.Event(), [0] * 0
    threads = [
        threading.Thread(target=_watch, args=(str(client.base_url), token, ended, counts))
        for _ in range(watchers)
    ]
    for thread in threads:
        thread.start()
    time.sleep(2.0)
    before, started = server.cpu_times(), time.monotonic()
    time.sleep(SECONDS)
    after, seconds = server.cpu_times(), time.monotonic() - started
    ended.set()
    for thread in threads:
        thread.join()
    used = after.user + after.system - before.user - before.system
    rate = sum(counts) / watchers / (seconds + 2.0) if watchers else 0.0
    return 100.0 * used / seconds, rate


def _stops(client: httpx.Client) -> tuple[list[float], list[float]]:
    """Return times of stops in ms: within the server, and from request to answer."""
    inside, outside = [], []
    for _ in range(STOPS):
        client.post("/start/calibrate", json={"side": "output", "step_percent": 10})
        while client.get("/bench").json()["job_id"] is None:
            time.sleep(0.05)
        time.sleep(3.0)
        started = time.perf_counter()
        report = client.post("/stop", json={"reason": "benchmark"}).json()
        outside.append(1e3 * (time.perf_counter() - started))
        inside.append(1e3 * report["seconds"])
        while client.post("/alarms/acknowledge").status_code != 200:
            time.sleep(0.1)
    return inside, outside


def main() -> None:
    """Measure and print."""
    with (
        tempfile.TemporaryDirectory() as scratch,
        _panel(Path(scratch)) as (server, client, token),
    ):
        alone, _ = _share(server, client, token, 0)
        print(f"no watcher: {alone:.1f} % of one core (the simulated bench itself, mostly)")
        for watchers in (1, 4):
            share, rate = _share(server, client, token, watchers)
            print(
                f"{watchers} watcher(s) of {len(CHANNELS)} channels: {rate:.1f} updates/s each, "
                f"{share - alone:.1f} % of one core more"
            )
        inside, outside = _stops(client)
    print(
        f"stop: {max(inside):.2f} ms at most from the service to both drives' zero command, "
        f"{max(outside):.1f} ms at most from request to answer ({STOPS} stops)"
    )


if __name__ == "__main__":
    main()
