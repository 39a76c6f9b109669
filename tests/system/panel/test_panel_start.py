"""The panel's start disturbs no thread of the bench."""

import subprocess
import sys
from pathlib import Path

import pytest

STARTING = """
import asyncio, sys, threading
from pathlib import Path
from torquebench.panel.address import Address
from torquebench.panel.server import create_app
from torquebench.panel.service import BenchService

ended, problems = threading.Event(), []

def build():
    while not ended.is_set():
        try:
            tuple(number for number in range(50))
        except SystemError as error:
            problems.append(error)

async def start(app):
    messages, begun = asyncio.Queue(), asyncio.Event()

    async def send(message):
        assert message["type"] == "lifespan.startup.complete", message
        begun.set()

    messages.put_nowait({"type": "lifespan.startup"})
    running = asyncio.ensure_future(app({"type": "lifespan", "state": {}}, messages.get, send))
    await begun.wait()
    running.cancel()

with BenchService.open(None, Path(sys.argv[1]), fast=True) as service:
    app = create_app(service, Address())
    threads = [threading.Thread(target=build) for _ in range(3)]
    for thread in threads:
        thread.start()
    asyncio.run(start(app))
    ended.set()
    for thread in threads:
        thread.join()
print(problems)
"""


@pytest.mark.nightly
def test_a_thread_that_builds_a_tuple_survives_the_start(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", STARTING, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.stdout.strip().endswith("[]"), done.stdout + done.stderr


SERVING = """
import sys
from pathlib import Path
from torquebench.panel.address import Address
from torquebench.panel.server import create_app
from torquebench.panel.service import BenchService

with BenchService.open(None, Path(sys.argv[1]), fast=True) as service:
    create_app(service, Address())
    print(*sys.modules)
"""
NOT_TO_SERVE = (
    *("matplotlib", "pandas", "sklearn", "openpyxl", "h5py", "skfem"),
    *("scipy.optimize", "scipy.signal", "scipy.sparse", "scipy.spatial", "scipy.stats"),
)


@pytest.mark.nightly
def test_a_server_that_nobody_uses_loads_what_it_needs(tmp_path: Path) -> None:
    """Each of these takes 10 to 60 MB for as long as the server runs."""
    done = subprocess.run(
        [sys.executable, "-c", SERVING, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    assert set(NOT_TO_SERVE).isdisjoint(done.stdout.split())
