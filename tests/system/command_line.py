"""Starts the installed `torquebench` command as a user does: real processes, real terminals."""

import atexit
import contextlib
import errno
import fcntl
import functools
import os
import re
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path

from tests.system.prepared_commands import PreparedCommands, RunningCommand

from torquebench.bench.description import DEFAULT_BENCH

COMMAND = str(Path(sys.executable).parent / "torquebench")
TIMEOUT_S = 240.0
ROOT = Path(__file__).resolve().parents[2]


def environment(**changes: str) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    return {**kept, "OMP_NUM_THREADS": "1", "PYTHONUTF8": "1", **changes}


@functools.cache
def prepared() -> PreparedCommands:
    ours = {k: v for k, v in environment().items() if not k.startswith("TORQUEBENCH_")}
    before = ours.get("PYTHONPATH")
    ours["PYTHONPATH"] = os.pathsep.join([str(ROOT), *([before] if before else [])])  # of tests
    ours["TORQUEBENCH_PRIORITY"] = "usual"  # whoever asks first
    commands = PreparedCommands(Path(os.environ["PREPARED_COMMANDS"]), ours)
    atexit.register(commands.close)
    return commands


def run(*arguments: object, cwd: Path, **changes: str) -> subprocess.CompletedProcess[str]:
    """Run the command to its end, from a process that has imported everything.

    Output and messages are apart; `changes` are those of its environment.
    """
    command = [COMMAND, *map(str, arguments)]
    return prepared().run(command, cwd, environment(**changes), TIMEOUT_S)


def run_python(code: str, *arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run Python's code to its end, from the process that commands come from."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return prepared().run(command, cwd, environment(), TIMEOUT_S)


def laboratory(data: Path, *, people: str = "", policy: str = "state") -> None:
    """Write what a data directory says of its laboratory."""
    data.mkdir(parents=True, exist_ok=True)
    named = f'[laboratory]\nname = "Lab"\ncity = "Ulm"\ncountry = "DE"\npeople = ["{people}"]\n'
    text = (named if people else "") + f'[policy]\nunreviewed = "{policy}"\n'
    (data / "laboratory.toml").write_text(text, encoding="utf-8")


def patient_bench(folder: Path, safety: str = "") -> Path:
    """Describe the simulated bench for real time on a busy computer, which may stand for seconds.

    More lines of its section `[safety]` may be given.
    """
    text = (resources.files("torquebench.bench") / DEFAULT_BENCH).read_text(encoding="utf-8")
    assert "[safety]" not in text
    assert "watchdog_s" not in text
    text = re.sub(r"^\[\w+\.drive\].*$", r"\g<0>\nwatchdog_s = 10", text, flags=re.MULTILINE)
    bench = folder / "bench.toml"
    bench.write_text(f"{text}\n[safety]\nstall_s = 60\n{safety}\n", encoding="utf-8")
    return bench


@contextlib.contextmanager
def started(
    *arguments: object, cwd: Path, fresh: bool = False, python: bool = False
) -> Iterator[RunningCommand | subprocess.Popen[str]]:
    """Start the command without a terminal; it is gone when the block ends.

    It is prepared as `run` is, unless it is to be started afresh, as a user does. With `python` the
    first argument is Python's code.
    """
    command = [sys.executable, "-c"] if python else [COMMAND]
    command += map(str, arguments)
    process = (
        subprocess.Popen(
            command,
            cwd=cwd,
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        if fresh
        else prepared().start(command, cwd, environment())
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def wait_until(condition: Callable[[], bool], what: str) -> None:
    """Wait for something that the process brings about."""
    deadline = time.monotonic() + TIMEOUT_S
    while not condition():
        if time.monotonic() > deadline:
            raise AssertionError(f"waited in vain for {what}")
        time.sleep(0.05)


def at_terminal(*arguments: object, cwd: Path, dialogue: list[tuple[str, str]]) -> tuple[int, str]:
    """Run the command at a terminal of 80 columns and answer what it shows.

    Each pair of `dialogue` waits for a text and then types an answer ("\\x03" is Ctrl-C).
    """
    terminal, its_end = os.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 80, 0, 0))
    command = [COMMAND, *map(str, arguments)]
    process = prepared().start_at_terminal(command, cwd, environment(TERM="xterm"), its_end)
    os.close(its_end)
    shown, answered, waiting = b"", 0, list(dialogue)
    deadline = time.monotonic() + TIMEOUT_S
    try:
        while time.monotonic() < deadline:
            ready, _, _ = select.select([terminal], [], [], 0.2)
            if ready:
                try:
                    fresh = os.read(terminal, 65536)
                except OSError as error:  # Linux's way to say that the other end is gone
                    if error.errno != errno.EIO:
                        raise
                    break
                if not fresh:
                    break
                shown += fresh
            if waiting and waiting[0][0].encode() in shown[answered:]:
                os.write(terminal, waiting.pop(0)[1].encode())
                answered = len(shown)
        else:
            process.kill()
    finally:
        code = process.wait()
        os.close(terminal)
    return code, shown.decode()


def widest_line(text: str) -> int:
    """Return the number of columns of the widest line."""
    return max((len(line.rstrip()) for line in text.splitlines()), default=0)
