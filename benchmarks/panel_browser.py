"""Speed and memory of the operator panel in a real browser.

Measured are the live page's painted updates per second with eight lines, the processor time that
the page costs the server, the time from pressing the stop button to the answer, and the memory of
server and browser over an hour of bench time (ten minutes with ``--quick``), which the simulated
bench runs through as fast as it can while the page keeps painting. ``--stop N`` measures N stops
only, under load: five browsers, twenty watchers and a flood of sign-in requests; one of the
browsers and a program without a page stop the bench in turn, which separates the server's time from
the browser's. ``--soak MINUTES`` measures memory in real time: one browser opens all pages every
minute, another stays on the live page, and every minute the bench records and calibrates. The
server is `torquebench panel` in a process of its own; the browser is Debian's Chromium without a
graphics card, so its figures are the worst case.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait
from tests.programs import program

from benchmarks.reporting import AIMS, BENCHMARKS, write_section
from torquebench.panel.service import Actor
from torquebench.panel.service.access.clients import Clients
from torquebench.panel.service.access.people import People
from torquebench.panel.service.store import PanelStore

_AIMS = AIMS["panel_browser"]
UPDATES_AIM = _AIMS["painted updates a second, eight lines"].low
CPU_AIM = _AIMS["what the page adds, cores"].high
STOP_AIM_MS = _AIMS["stop, ms"].high
GROWTH_AIM = _AIMS["growth of memory"].high
STOPS = 60
"""Number of stops of a bench at rest."""
LOADED_STOPS = 8
"""Number of stops while a calibration loads the bench."""
BROWSERS, WATCHERS = 5, 20
"""Numbers of browsers and watchers in the crowd; one of the browsers presses the stop button."""
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
    log: list[str] = field(default_factory=list)

    def call(self, method: str, path: str, body: Any = None) -> Any:
        """Return the answer of a request to the HTTP API."""
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
        """Return how many processor cores the server uses on average."""
        before, started = self._cpu_s(), time.perf_counter()
        time.sleep(seconds)
        return (self._cpu_s() - before) / (time.perf_counter() - started)

    def _cpu_s(self) -> float:
        times = self.process.cpu_times()
        return float(times.user + times.system)


@contextlib.contextmanager
def served(folder: Path, *options: str) -> Iterator[Server]:
    """Start a panel with one account and one client; stop it at the end."""
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
        address = line[line.index("http://") :].strip()
        server = Server(address, psutil.Process(process.pid), token)
        # A full pipe that nobody reads would block the server.
        threading.Thread(target=server.log.extend, args=(process.stdout,), daemon=True).start()
        yield server
    finally:
        process.terminate()
        process.wait(timeout=60)


@contextlib.contextmanager
def browsing(server: Server, profile: Path) -> Iterator[webdriver.Chrome]:
    """Sign in with a fresh browser and open the live page."""
    options = Options()
    options.binary_location = str(program("chromium"))
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    driver = webdriver.Chrome(options=options, service=Service(str(program("chromedriver"))))
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
    """Return how often the live page has been painted."""
    return int(driver.execute_script("return window.torquebench?.painted ?? 0"))


def heap_mb(driver: webdriver.Chrome) -> float:
    """Return the memory that the page's scripts hold after a garbage collection, MB."""
    driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
    return float(driver.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"]) / 2**20


def measure_live(server: Server, profile: Path, seconds: float) -> tuple[float, float, float]:
    """Return painted updates per second, and the server's cores without and with a live page."""
    idle = server.busy_cores(seconds)
    with browsing(server, profile) as driver:
        time.sleep(2.0)
        first, started = painted(driver), time.perf_counter()
        watched = server.busy_cores(seconds)
        updates = (painted(driver) - first) / (time.perf_counter() - started)
    return updates, idle, watched


@dataclass(frozen=True)
class Press:
    """Times from a press of the stop button to the drives' command and to the answer, ms."""

    told: float
    back: float


def measure_stop(
    server: Server, profile: Path, stops: int = STOPS, loaded: int = LOADED_STOPS
) -> list[Press]:
    """Return the times of all presses of the stop button.

    Before every press the bench runs again; before the last ones it is loaded.
    """
    found = []
    with browsing(server, profile) as driver:
        for press in range(stops + loaded):
            _acknowledge(server)
            if press >= stops:
                _load(server)
            found.append(_press(driver))
    return found


def _press(driver: webdriver.Chrome) -> Press:
    """Press the stop button of a page."""
    driver.execute_script("window.torquebench.toldMilliseconds = null")
    driver.find_element(By.CSS_SELECTOR, "[data-stop]").click()
    asked = "const {toldMilliseconds: told, stopMilliseconds: back} = window.torquebench;"
    told, back = WebDriverWait(driver, 10).until(
        lambda _: driver.execute_script(f"{asked} return told === null ? null : [told, back]")
    )
    return Press(float(told), float(back))


def _press_without_page(server: Server) -> Press:
    """Send a stop as a page does, from a program that does nothing else."""
    connection = http.client.HTTPConnection(server.url.removeprefix("http://"), timeout=60)
    with contextlib.closing(connection):
        began = time.time()
        connection.request("POST", "/panel/stop", headers={"X-Torquebench": "panel"})
        content = json.loads(connection.getresponse().read())
        return Press(1000.0 * (content["at"] - began), 1000.0 * (time.time() - began))


def measure_crowded_stop(
    server: Server, folder: Path, stops: int
) -> tuple[list[Press], list[Press]]:
    """Return presses of a browser's stop button, and stops by a program, in a crowd.

    Five browsers, twenty watchers and endless requests for the sign-in page run in processes and
    threads of their own on the same computer, and so compete with the server for its cores.
    """
    ended, counts = threading.Event(), [0] * WATCHERS
    pages, programs = [], []
    with contextlib.ExitStack() as crowd:
        for number in range(BROWSERS - 1):
            crowd.enter_context(browsing(server, folder / f"browser-{number}"))
        flood = subprocess.Popen([sys.executable, "-m", "benchmarks", "panel_browser", "--flood",
                                  f"{server.url}/sign-in"])  # fmt: skip
        crowd.callback(flood.kill)
        crowd.callback(ended.set)
        for number in range(WATCHERS):
            watch = threading.Thread(
                target=_watch, args=(f"{server.url}/api/v1", server.token, ended, counts, number)
            )
            watch.daemon = True
            watch.start()
        driver = crowd.enter_context(browsing(server, folder / "presses"))
        for _ in range(stops):
            _acknowledge(server)
            programs.append(_press_without_page(server))
            _acknowledge(server)
            pages.append(_press(driver))
    return pages, programs


def _watch(url: str, token: str, ended: threading.Event, counts: list[int], number: int) -> None:
    """Receive all events of the bench as a program does."""
    request = urllib.request.Request(f"{url}/events", headers={"Authorization": f"Bearer {token}"})
    with urllib.request.urlopen(request, timeout=600) as events:
        while not ended.is_set() and events.readline():
            counts[number] += 1


def flood(page: str) -> None:
    """Request the sign-in page from four threads until killed."""

    def again() -> None:
        while True:
            with contextlib.suppress(OSError), urllib.request.urlopen(page, timeout=60) as answer:
                answer.read()

    for _ in range(4):
        threading.Thread(target=again).start()


def _acknowledge(server: Server) -> None:
    """Acknowledge the alarm, once the bench is safe and its job has ended."""
    for _ in range(300):
        if not server.call("GET", "/bench")["stopped"]:
            return
        with contextlib.suppress(urllib.error.HTTPError):  # the drives still ramp to zero
            server.call("POST", "/alarms/acknowledge")
            continue
        time.sleep(0.1)
    raise SystemExit("the bench stays stopped")


def _load(server: Server) -> None:
    """Begin a calibration and wait until it has taken points under torque."""
    server.call("POST", "/operations/calibrate", {"side": "output", "models": ["polynomial-2"]})
    for _ in range(600):
        if server.call("GET", "/jobs")[0]["points"] > 4:
            return
        time.sleep(0.1)
    raise SystemExit("a calibration took no points")


@dataclass(frozen=True)
class Moment:
    """One measurement of the memory, MB, with bench time and wall time since the beginning, s."""

    bench_s: float
    wall_s: float
    server_mb: float
    page_mb: float
    tab_mb: float


def soak(server: Server, profile: Path, seconds: float) -> list[Moment]:
    """Calibrate for `seconds` of bench time beside a live page; return the memory over time.

    On a slow or busy computer, end after `seconds` of wall time.
    """
    found: list[Moment] = []
    with browsing(server, profile) as driver:
        began, started = _bench_time(server), time.perf_counter()
        while not found or (found[-1].bench_s < seconds and found[-1].wall_s < seconds):
            _calibrate(server)
            found.append(
                Moment(
                    _bench_time(server) - began,
                    time.perf_counter() - started,
                    server.process.memory_info().rss / 2**20,
                    heap_mb(driver),
                    _tab_mb(driver),
                )
            )
    return found


SAMPLED_S = 20.0
"""Time between two samples of a soak in real time, s."""
QUICK_CALIBRATION = {
    "side": "output",
    "models": ["polynomial-2"],
    "profile": "staircase",
    "step_percent": 25,
    "repeats": 1,
}
PAGES = ("/calibrate", "/reducer", "/records", "/settings", "/alarms", "/")


@dataclass(frozen=True)
class Sample:
    """Resources that server and browsers hold at one moment."""

    wall_s: float
    server_mb: float
    threads: int
    files: int
    sockets: int
    page_mb: float
    tab_mb: float
    nodes: int
    staying_page_mb: float
    staying_tab_mb: float
    staying_nodes: int
    log_lines: int


QUANTITIES = {
    "server_mb": "server, MB",
    "threads": "server, threads",
    "files": "server, open files",
    "sockets": "server, connections",
    "page_mb": "page just opened: scripts, MB",
    "tab_mb": "its tab, MB",
    "nodes": "its nodes",
    "staying_page_mb": "page open all the time: scripts, MB",
    "staying_tab_mb": "its tab, MB",
    "staying_nodes": "its nodes",
}
"""Attributes of a sample that must not grow, and their names in the table."""


def soak_in_real_time(
    server: Server, profile: Path, seconds: float, troubles: list[str]
) -> list[Sample]:
    """Run jobs and open pages as a person does; print and return the held resources over time."""
    found: list[Sample] = []
    ended = threading.Event()
    work = threading.Thread(target=_work, args=(server, ended, troubles), daemon=True)
    with (
        browsing(server, profile / "goes") as driver,
        browsing(server, profile / "stays") as staying,
    ):
        work.start()
        started = time.perf_counter()
        with contextlib.suppress(KeyboardInterrupt):  # keep the samples so far
            while (passed := time.perf_counter() - started) < seconds:
                if not work.is_alive():
                    raise SystemExit("the work before the browser has ended")
                if len(found) % 3 == 0:
                    for page in PAGES:
                        driver.get(server.url + page)
                        time.sleep(1.0)
                process = server.process
                found.append(
                    Sample(
                        passed,
                        process.memory_info().rss / 2**20,
                        process.num_threads(),
                        process.num_fds(),
                        len(process.net_connections()),
                        *_held(driver),
                        *_held(staying),
                        len(server.log),
                    )
                )
                print(*(f"{value:.1f}" for value in vars(found[-1]).values()), sep="\t", flush=True)
                ended.wait(max(0.0, SAMPLED_S * len(found) - (time.perf_counter() - started)))
        ended.set()
        work.join(timeout=120.0)
    return found


def _held(driver: webdriver.Chrome) -> tuple[float, float, int]:
    """Return the memory of a page's scripts and of its tab, MB, and its number of DOM nodes."""
    heap = heap_mb(driver)
    counts = driver.execute_cdp_cmd("Memory.getDOMCounters", {})
    return heap, _tab_mb(driver), int(counts["nodes"])


def _work(server: Server, ended: threading.Event, troubles: list[str]) -> None:
    """Record and calibrate once a minute; of two calibrations, abort one and complete one.

    An alarm, such as a stall of the acquisition on a busy computer, is added to `troubles` and
    acknowledged.
    """
    number = 0
    while not ended.is_set():
        started, number = time.perf_counter(), number + 1
        try:
            _record_and_calibrate(server, ended, number)
        except urllib.error.HTTPError as error:
            alarms = [each["found"] for each in server.call("GET", "/alarms?active=true")]
            troubles.append(f"{error.code}: {'; '.join(alarms) or error.reason}")
            print(troubles[-1], file=sys.stderr, flush=True)
        _acknowledge(server)
        ended.wait(max(0.0, 60.0 - (time.perf_counter() - started)))


def _record_and_calibrate(server: Server, ended: threading.Event, number: int) -> None:
    started = time.perf_counter()
    job = server.call("POST", "/operations/record", {"name": f"soak {number}"})
    ended.wait(5.0)
    server.call("POST", f"/jobs/{job['job_id']}/finish")
    _until_ended(server, job)
    job = server.call("POST", "/operations/calibrate", QUICK_CALIBRATION)
    patience = 15.0 if number % 2 else 600.0
    while job["finished"] is None and time.perf_counter() < started + patience:
        ended.wait(1.0)
        patience = 0.0 if ended.is_set() else patience
        job = server.call("GET", f"/jobs/{job['job_id']}")
    with contextlib.suppress(urllib.error.HTTPError):  # the calibration may have ended
        server.call("POST", f"/jobs/{job['job_id']}/abort", {"reason": "soak"})
    _until_ended(server, job)


def _until_ended(server: Server, job: Any) -> Any:
    while job["finished"] is None:
        time.sleep(0.2)
        job = server.call("GET", f"/jobs/{job['job_id']}")
    return job


def soaked(minutes: float, *, write: bool) -> int:
    """Soak in real time; print the growth of each quantity; 1 where the aim is missed."""
    with tempfile.TemporaryDirectory() as scratch:
        (data := Path(scratch) / "data").mkdir()
        print(*(each.name for each in fields(Sample)), sep="\t")
        troubles: list[str] = []
        with served(data) as server:
            samples = soak_in_real_time(server, Path(scratch) / "browser", 60.0 * minutes, troubles)
            jobs = server.call("GET", "/jobs")
            tracebacks = sum("Traceback" in line for line in server.log)
    print(f"last jobs: {[each['state'] for each in jobs]}")
    grown = {name: growth([float(getattr(each, name)) for each in samples]) for name in QUANTITIES}
    lines = [
        f"Chromium {chromium_version()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} "
        "at the end; simulated bench.",
        "",
        "| real time, two browsers, a recording and a calibration a minute | begin | end "
        "| last quarter over the second | aim |",
        "| --- | --- | --- | --- | --- |",
        f"| minutes | 0 | {samples[-1].wall_s / 60.0:.0f} | – | – |",
        f"| times that work ended by itself | 0 | {len(troubles)} | – | – |",
        f"| tracebacks in the server's log | 0 | {tracebacks} | – | 0 |",
    ]
    for name, title in QUANTITIES.items():
        begin, end = (getattr(samples[at], name) for at in (0, -1))
        decimals = 0 if isinstance(begin, int) else 1
        lines.append(f"| {title} | {begin:.{decimals}f} | {end:.{decimals}f} | "
                     f"{grown[name]:+.1%} | ≤ {GROWTH_AIM:.0%} |")  # fmt: skip
    print("\n".join(lines))
    if write:
        write_section(BENCHMARKS, "panel-soak", "\n".join(lines))
    return 0 if tracebacks == 0 and max(grown.values()) <= GROWTH_AIM else 1


def _tab_mb(driver: webdriver.Chrome) -> float:
    """Return the memory that the browser's page processes don't share with others, MB."""
    children = psutil.Process(driver.service.process.pid).children(recursive=True)
    pages = [each for each in children if "--type=renderer" in " ".join(each.cmdline())]
    return float(sum(each.memory_full_info().uss for each in pages)) / 2**20


def _bench_time(server: Server) -> float:
    return float(server.call("GET", "/bench")["bench_time_s"])


def _calibrate(server: Server) -> None:
    """Calibrate once and wait for the end."""
    job = _until_ended(
        server,
        server.call(
            "POST", "/operations/calibrate", {"side": "output", "models": ["polynomial-2"]}
        ),
    )
    if job["state"] != "done":
        raise SystemExit(f"a calibration ended {job['state']}: {job['problem']}")


def growth(values: list[float]) -> float:
    """Return the relative growth from the second quarter of the values to the last one.

    Examples
    --------
    >>> growth([5.0, 9.0, 10.0, 10.0, 10.0, 10.0, 10.0, 12.0, 12.0])
    0.2
    """
    quarter = max(1, len(values) // 4)
    before = statistics.median(values[quarter : 2 * quarter] or values[:1])
    return round(statistics.median(values[-quarter:]) / before - 1.0, 4)


@dataclass(frozen=True)
class Found:
    """All results of a run."""

    updates: float
    idle: float
    watched: float
    stops: list[Press]
    memory: list[Moment]
    load: float

    @property
    def rows(self) -> list[tuple[str, str, str, bool]]:
        """Rows of the table: quantity, its value, its aim, and whether the aim is met."""
        page = self.watched - self.idle
        stops = [press.back for press in self.stops]
        median, high = statistics.median(stops), float(np.percentile(stops, 99))
        end = self.memory[-1]
        rows = [
            ("painted updates a second, eight lines", f"{self.updates:.1f}",
             f"≥ {UPDATES_AIM:g}", self.updates >= UPDATES_AIM),
            ("server with the simulated bench, no page, cores", f"{self.idle:.2f}", "", True),
            ("what the page adds, cores", f"{page:.2f}", f"≤ {CPU_AIM:g}", page <= CPU_AIM),
            (f"stop, {len(self.stops)} presses, {LOADED_STOPS} of them under torque: median, ms",
             f"{median:.0f}", f"≤ {STOP_AIM_MS:g}", median <= STOP_AIM_MS),
            ("stop: 99 %, ms", f"{high:.0f}", f"≤ {STOP_AIM_MS:g}", high <= STOP_AIM_MS),
            ("stop: worst, ms", f"{max(stops):.0f}", "", True),
            ("simulated work, s of bench time", f"{end.bench_s:.0f}", "", True),
            ("times as fast as a real bench", f"{end.bench_s / end.wall_s:.1f}", "", True),
        ]  # fmt: skip
        for name, part in (("server", "server_mb"), ("the page's scripts", "page_mb"),
                           ("the browser's tab", "tab_mb")):  # fmt: skip
            values = [getattr(each, part) for each in self.memory]
            grown = growth(values)
            rows.append(
                (f"memory, {name}, MB: begin, end, growth of the last quarter over the second",
                 f"{values[0]:.1f}, {values[-1]:.1f}, {grown:+.1%}", f"≤ {GROWTH_AIM:.0%}",
                 grown <= GROWTH_AIM)
            )  # fmt: skip
        return rows

    def table(self) -> str:
        """Return the rows as Markdown."""
        lines = [
            f"Chromium {chromium_version()} without a graphics card, {os.cpu_count()} cores, "
            f"load {self.load:.1f} at the end; simulated bench.",
            "",
            "| | measured | aim |",
            "| --- | --- | --- |",
        ]
        lines += [f"| {name} | {value} | {aim or '–'} |" for name, value, aim, _ in self.rows]
        return "\n".join(lines)


def chromium_version() -> str:
    """Return the browser's main version."""
    said = subprocess.run(
        [str(program("chromium")), "--version"], capture_output=True, text=True, check=True
    ).stdout
    return next((word.partition(".")[0] for word in said.split() if word[0].isdigit()), "?")


def crowded(stops: int) -> int:
    """Measure stops in a crowd and print them; return 1 where the aim is missed."""
    with tempfile.TemporaryDirectory() as scratch:
        (data := Path(scratch) / "data").mkdir()
        with served(data) as server:
            pages, programs = measure_crowded_stop(server, Path(scratch), stops)
    print(
        f"stop, {BROWSERS} browsers, {WATCHERS} watchers, a flood of sign-in pages, {stops} "
        f"presses each; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; simulated bench"
    )
    for who, presses in (("a browser", pages), ("a program", programs)):
        for what, part in (("the drives are told", "told"), ("that is known", "back")):
            taken = [getattr(press, part) for press in presses]
            print(
                f"{who}, until {what}: median {statistics.median(taken):.0f} ms, "
                f"99 % {np.percentile(taken, 99):.0f} ms, worst {max(taken):.0f} ms"
            )
    high = float(np.percentile([press.told for press in pages], 99))
    print(f"aim: a browser's press tells the drives within {STOP_AIM_MS:g} ms at 99 %")
    return 0 if high <= STOP_AIM_MS else 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; return 1 where an aim is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="ten minutes instead of an hour")
    parser.add_argument("--write", action="store_true", help="put the table into the document")
    parser.add_argument("--stop", type=int, metavar="N", help="only N stops in a crowd")
    parser.add_argument("--soak", type=float, metavar="MINUTES", help="only a soak in real time")
    parser.add_argument("--flood", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.flood:
        flood(options.flood)
        return 0
    if options.soak:
        return soaked(options.soak, write=options.write)
    if options.stop:
        return crowded(options.stop)
    with tempfile.TemporaryDirectory() as scratch:
        folders = [Path(scratch) / name for name in ("live", "fast")]
        for folder in folders:
            folder.mkdir()
        with served(folders[0]) as server:
            seconds = 5.0 if options.quick else 30.0
            updates, idle, watched = measure_live(server, folders[0] / "one", seconds)
            stops = measure_stop(server, folders[0] / "two")
        with served(folders[1], "--fast") as server:
            memory = soak(server, folders[1] / "three", 600.0 if options.quick else 3600.0)
    found = Found(updates, idle, watched, stops, memory, os.getloadavg()[0])
    print(found.table())
    if options.write:
        write_section(BENCHMARKS, "panel", found.table())
    return 0 if all(met for _, _, _, met in found.rows) else 1
