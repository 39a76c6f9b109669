"""The operator panel in a real browser: ``python -m benchmarks.panel_browser [--quick]``.

Painted updates a second of the live page with eight lines, what the page costs the server, how
long the stop button takes there and back, and memory on both sides over an hour of simulated work
(ten minutes with ``--quick``). The server is `torquebench panel` in a process of its own; the
browser is Debian's Chromium without a graphics card, so its figures are the worst case. Exits
with 1 where an aim is missed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from torquebench.panel.service import Actor
from torquebench.panel.service.clients import Clients
from torquebench.panel.service.people import People
from torquebench.panel.service.store import PanelStore

UPDATES_AIM = 25.0
CPU_AIM = 0.20
STOP_AIM_MS = 100.0
GROWTH_AIM = 0.10
STOPS = 20
PASSWORD = "benchmark of the panel"
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--window-size=1440,900",
)


@dataclass
class Server:
    """A running panel."""

    url: str
    process: psutil.Process
    token: str

    def call(self, method: str, path: str, body: Any = None) -> Any:
        """Call the HTTP API."""
        request = urllib.request.Request(
            f"{self.url}/api/v1{path}",
            method=method,
            data=None if body is None else json.dumps(body).encode(),
            headers={
                "Authorization": f"Bearer {self.token}",
                "Content-Type": "application/json",
            },
        )
        with urllib.request.urlopen(request, timeout=60) as answer:
            content = answer.read()
        return json.loads(content) if content else None

    def busy_cores(self, seconds: float) -> float:
        """Return how many cores the server keeps busy."""
        before, started = self._cpu_s(), time.perf_counter()
        time.sleep(seconds)
        return (self._cpu_s() - before) / (time.perf_counter() - started)

    def _cpu_s(self) -> float:
        times = self.process.cpu_times()
        return float(times.user + times.system)


@contextlib.contextmanager
def served(folder: Path, *options: str) -> Iterator[Server]:
    """Serve a panel with one account and one client."""
    store = PanelStore(folder)
    people = People(store)
    people.set_up(str(people.setup_code), "Ana", PASSWORD, "benchmark")
    _, token = Clients(store).add(
        Actor("Ana", "administrator", "benchmark"), "benchmark", "metrologist"
    )
    people.close()
    store.close()
    command = Path(sys.executable).parent / "torquebench"
    process = subprocess.Popen(
        [str(command), "panel", "--data", str(folder), "--port", "0", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert process.stdout is not None
    try:
        line = next(each for each in process.stdout if "http://" in each)
        yield Server(line[line.index("http://") :].strip(), psutil.Process(process.pid), token)
    finally:
        process.terminate()
        process.communicate(timeout=60)


@contextlib.contextmanager
def browsing(server: Server, profile: Path) -> Iterator[webdriver.Chrome]:
    """Sign in with a fresh browser and look at the live page."""
    options = Options()
    options.binary_location = "/usr/bin/chromium"
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    driver = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
    try:
        driver.get(f"{server.url}/sign-in")
        driver.find_element(By.NAME, "name").send_keys("Ana")
        driver.find_element(By.NAME, "password").send_keys(PASSWORD)
        driver.find_element(By.CSS_SELECTOR, "form button[type=submit]").click()
        WebDriverWait(driver, 60).until(lambda _: painted(driver) > 10)
        yield driver
    finally:
        driver.quit()


def painted(driver: webdriver.Chrome) -> int:
    """How often the live page has been painted."""
    return int(driver.execute_script("return window.torquebench?.painted ?? 0"))


def heap_mb(driver: webdriver.Chrome) -> float:
    """Memory that the page's scripts hold after a collection, MB."""
    driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
    return float(driver.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"]) / 2**20


def measure_live(server: Server, profile: Path, seconds: float) -> tuple[float, float, float]:
    """Return painted updates a second, and the server's cores without and with a page."""
    idle = server.busy_cores(seconds)
    with browsing(server, profile) as driver:
        time.sleep(2.0)
        first, started = painted(driver), time.perf_counter()
        watched = server.busy_cores(seconds)
        updates = (painted(driver) - first) / (time.perf_counter() - started)
    return updates, idle, watched


def measure_stop(server: Server, profile: Path) -> list[float]:
    """Return how long the stop button takes until the drives are told, there and back, ms."""
    found = []
    with browsing(server, profile) as driver:
        for _ in range(STOPS):
            driver.execute_script("window.torquebench.stopMilliseconds = null")
            driver.find_element(By.CSS_SELECTOR, "[data-stop]").click()
            taken = WebDriverWait(driver, 10).until(
                lambda _: driver.execute_script("return window.torquebench.stopMilliseconds")
            )
            found.append(float(taken))
    return found


def soak(server: Server, profile: Path, seconds: float) -> list[tuple[float, float, float]]:
    """Work for so much bench time; return bench time, server's and page's memory on the way."""
    found = []
    with browsing(server, profile) as driver:
        began = _bench_time(server)
        while (passed := _bench_time(server) - began) < seconds:
            _calibrate(server)
            found.append((passed, server.process.memory_info().rss / 2**20, heap_mb(driver)))
    return found


def _bench_time(server: Server) -> float:
    return float(server.call("GET", "/bench")["bench_time_s"])


def _calibrate(server: Server) -> None:
    """Calibrate once and wait for the end."""
    job = server.call("POST", "/start/calibrate", {"side": "output", "models": ["polynomial-2"]})
    while job["finished"] is None:
        time.sleep(0.2)
        job = server.call("GET", f"/jobs/{job['job_id']}")
    if job["state"] != "done":
        raise SystemExit(f"a calibration ended {job['state']}: {job['problem']}")


def growth(values: list[float]) -> float:
    """Return by what share the last quarter exceeds the second one.

    Examples
    --------
    >>> growth([5.0, 9.0, 10.0, 10.0, 10.0, 10.0, 10.0, 12.0, 12.0])
    0.2
    """
    quarter = max(1, len(values) // 4)
    before = statistics.median(values[quarter : 2 * quarter] or values[:1])
    return round(statistics.median(values[-quarter:]) / before - 1.0, 4)


def main() -> int:
    """Measure, print and judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    quick = parser.parse_args().quick
    with tempfile.TemporaryDirectory() as scratch:
        folders = [Path(scratch) / name for name in ("live", "fast")]
        for folder in folders:
            folder.mkdir()
        with served(folders[0]) as server:
            seconds = 5.0 if quick else 30.0
            updates, idle, watched = measure_live(server, folders[0] / "one", seconds)
            stops = measure_stop(server, folders[0] / "two")
        with served(folders[1], "--fast") as server:
            memory = soak(server, folders[1] / "three", 600.0 if quick else 3600.0)
    page, stop = watched - idle, statistics.median(stops)
    server_growth = growth([each[1] for each in memory])
    page_growth = growth([each[2] for each in memory])
    print(f"cores: {os.cpu_count()}, load {os.getloadavg()[0]:.1f}")
    print(f"painted updates a second: {updates:.1f} (aim {UPDATES_AIM:g})")
    print(f"server without a page: {idle:.2f} cores, the simulated bench included")
    print(f"the page costs the server {page:.2f} cores (aim {CPU_AIM:g})")
    print(f"stop: median {stop:.0f} ms, worst {max(stops):.0f} ms (aim {STOP_AIM_MS:g})")
    print(f"memory over {memory[-1][0]:.0f} s of bench time, {len(memory)} calibrations:")
    for name, place, grown in (("server", 1, server_growth), ("page", 2, page_growth)):
        values = [each[place] for each in memory]
        print(f"  {name} {values[0]:.1f} to {values[-1]:.1f} MB, {grown:+.1%} "
              f"(aim {GROWTH_AIM:.0%})")  # fmt: skip
    good = updates >= UPDATES_AIM and page <= CPU_AIM and stop <= STOP_AIM_MS
    return 0 if good and max(server_growth, page_growth) <= GROWTH_AIM else 1


if __name__ == "__main__":
    sys.exit(main())
