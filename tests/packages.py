"""Install packages with pip, and show which and how far: `python tests/packages.py PYTHON …`.

What follows the virtual environment's Python is given to `pip install`. Any Python 3 runs this file
before anything is installed. Modules are compiled when they are imported first: compiling all of
them takes longer than everything else, and most of them are never imported.
"""

from __future__ import annotations

import re
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

_LOOKED_UP = re.compile(r"Collecting ([\w.-]+)")
_FETCHED = re.compile(
    r"(?:Downloading|Using cached|Processing) (?:\S*/)?([\w.]+)-(\d[\w.]*)-\S*whl\b"
)
_SIZE = re.compile(r"\(([\d.]+) ([kMG]B)\)")
_UNPACKED = "Installing collected packages: "
_MB = {"kB": 1e-3, "MB": 1.0, "GB": 1e3}
_STEP = 20
"""Packages from one line to the next where no terminal shows each of them."""


class Display:
    """One line that changes on a terminal, a line now and then elsewhere."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._width = stream, 0

    def show(self, text: str, number: int, last: bool = False) -> None:
        """Show how far it is; `number` counts what has been done of this part."""
        if self._stream.isatty():
            print(f"\r{text[:79]:{self._width}}", end="\n" * last, file=self._stream, flush=True)
            self._width = 0 if last else min(len(text), 79)
        elif last or number % _STEP == 0:
            print(text, file=self._stream, flush=True)


class Installation:
    """What pip has said so far, in numbers."""

    def __init__(self, display: Display, environment: Path) -> None:
        self._display, self._environment = display, environment
        self._names: set[str] = set()
        self._fetched: set[str] = set()
        self._size_mb = 0.0
        self._unpacked = threading.Event()

    def _installed(self) -> int:
        return sum(1 for _ in self._environment.glob("lib/python*/site-packages/*.dist-info"))

    def _watch(self, number: int, before: int) -> None:
        """Count the packages that pip unpacks: it tells nothing of them."""
        while not self._unpacked.wait(0.5):
            done = min(max(self._installed() - before, 0), number)
            self._display.show(f"unpacking {done} of {number} packages", done or 1)

    def read(self, lines: TextIO, kept: list[str]) -> None:
        """Read what pip says to its end."""
        watching = None
        for line in lines:
            kept.append(line)
            if found := _LOOKED_UP.match(line.strip()):
                self._names.add(found[1])
                number = len(self._names)
                self._display.show(f"looking up package {number}: {found[1]}", number)
            elif (found := _FETCHED.search(line)) and ".metadata" not in line:
                if size := _SIZE.search(line):
                    self._size_mb += float(size[1]) * _MB[size[2]]
                self._fetched.add(found[1])
                number = len(self._fetched)
                of = f"{number} of {max(len(self._names), number)}"
                much = f" ({self._size_mb:.0f} MB)" if self._size_mb >= 1.0 else ""
                self._display.show(f"fetching {of}{much}: {found[1]} {found[2]}", number)
            elif line.startswith(_UNPACKED):
                number = line.count(",") + 1
                self._display.show(f"unpacking {number} packages", 0)
                watching = threading.Thread(target=self._watch, args=(number, self._installed()))
                watching.start()
        self._unpacked.set()
        if watching is not None:
            watching.join()


def main(python: str, arguments: Sequence[str]) -> int:
    """Install; return pip's exit code, with all that it said where that isn't 0."""
    display, begun = Display(sys.stdout), time.monotonic()
    environment = Path(python).parent.parent
    quiet = ("--no-compile", "--no-input", "--disable-pip-version-check", "--progress-bar", "off")
    kept: list[str] = []
    with subprocess.Popen(
        [python, "-m", "pip", "install", *quiet, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as pip:
        assert pip.stdout is not None
        Installation(display, environment).read(pip.stdout, kept)
    if pip.returncode:
        display.show("pip could not install the packages:", 0, last=True)
        sys.stderr.writelines(kept)
    else:
        taken = time.monotonic() - begun
        display.show(f"packages are installed in {environment} ({taken:.0f} s)", 0, last=True)
    return pip.returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
