"""Commands from a process that has imported everything: each in a process of its own, at once.

Importing what a command needs takes seconds of a processor, loading the kernels of the simulated
bench another; both say nothing new the hundredth time. So a process does it once and forks for
every command: `PreparedCommands.run` is what `subprocess.run` is otherwise, and
`PreparedCommands.start` what `subprocess.Popen` is. Commands are those of torquebench, and Python
with `-c`. Run as a script, this file is that process.
"""

import atexit
import fcntl
import gc
import json
import os
import pkgutil
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import IO

ASKED_AT_MOST = 1 << 20
SELDOM = (
    "__main__",
    "bench.drivers",
    "notebook",
    "records.export_mdf4",
    "records.registry.migrations",
    "simulators",
)
"""Modules that a command imports itself: few do, and some bring threads, which no fork takes."""


class RunningCommand:
    """A command under way, with what tests use of `subprocess.Popen`."""

    def __init__(
        self,
        command: list[str],
        connection: socket.socket,
        stdout: IO[str] | None = None,
        stderr: IO[str] | None = None,
    ) -> None:
        self.command, self.stdout, self.stderr = command, stdout, stderr
        self._connection = connection
        self.pid = int(connection.recv(64))
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit code, None while it runs."""
        if self.returncode is None and select.select([self._connection], [], [], 0.0)[0]:
            self.wait()
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end and return the exit code."""
        if self.returncode is None:
            self._connection.settimeout(timeout)
            try:
                self.returncode = int(self._connection.recv(64))
            except TimeoutError as error:
                raise subprocess.TimeoutExpired(self.command, timeout or 0.0) from error
            self._connection.close()
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send it a signal if it still runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it as nothing else does."""
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Read what it still says to its end; one that takes too long is killed."""
        with ThreadPoolExecutor(2) as pool:
            streams = (self.stdout, self.stderr)
            reading = [
                pool.submit(stream.read) for stream in streams if stream and not stream.closed
            ]
            try:
                self.wait(timeout)
            except subprocess.TimeoutExpired:
                self.kill()
                raise
        texts = [each.result() for each in reading]
        for stream in streams:
            if stream:
                stream.close()
        return (texts[0], texts[1]) if texts else ("", "")


class PreparedCommands:
    """The process that forks, and how to ask it; it ends with its last asker.

    All that name one folder share it; who comes first starts it.
    """

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self._address, pipe = folder / "socket", folder / "askers"
        with (folder / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not pipe.exists():
                os.mkfifo(pipe)
            try:
                self._asker = os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)
            except OSError:  # nobody serves
                askers = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
                self._asker = os.open(pipe, os.O_WRONLY)
                self._serve(askers, environment)

    def _serve(self, askers: int, environment: dict[str, str]) -> None:
        self._address.unlink(missing_ok=True)
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listening:
            listening.bind(str(self._address))
            listening.listen(64)
            number = listening.fileno()
            process = subprocess.Popen(
                [sys.executable, __file__, str(number)],
                stdin=askers,
                env=environment,
                pass_fds=[number],
            )
        os.close(askers)
        process.returncode = 0  # it goes on for others, and nobody waits for it

    def run(
        self, command: list[str], cwd: Path, environment: dict[str, str], timeout_s: float
    ) -> subprocess.CompletedProcess[str]:
        """Run a command to its end, output and messages apart."""
        with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as messages:
            running = RunningCommand(
                command, self._ask(command, cwd, environment, output, messages)
            )
            try:
                code = running.wait(timeout_s)
            except subprocess.TimeoutExpired:
                running.kill()
                running.wait()
                raise
            texts = []
            for stream in (output, messages):
                stream.seek(0)
                texts.append(stream.read().decode().replace("\r\n", "\n"))
        return subprocess.CompletedProcess(command, code, *texts)

    def start(
        self,
        command: list[str],
        cwd: Path,
        environment: dict[str, str],
        log: IO[bytes] | None = None,
    ) -> RunningCommand:
        """Start a command; output and messages are read apart, or go to a log together."""
        if log is not None:
            return RunningCommand(command, self._ask(command, cwd, environment, log, log))
        (output, told), (messages, said) = os.pipe(), os.pipe()
        with os.fdopen(told, "wb") as to_output, os.fdopen(said, "wb") as to_messages:
            connection = self._ask(command, cwd, environment, to_output, to_messages)
        stdout, stderr = os.fdopen(output, encoding="utf-8"), os.fdopen(messages, encoding="utf-8")
        return RunningCommand(command, connection, stdout, stderr)

    def start_at_terminal(
        self, command: list[str], cwd: Path, environment: dict[str, str], terminal: int
    ) -> RunningCommand:
        """Start a command at a terminal, which is its session's."""
        return RunningCommand(command, self._ask(command, cwd, environment, terminal))

    def _ask(
        self, command: list[str], cwd: Path, environment: dict[str, str], *streams: IO[bytes] | int
    ) -> socket.socket:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        connection.connect(str(self._address))
        asked = json.dumps({"command": command, "cwd": str(cwd), "environment": environment})
        files = [each if isinstance(each, int) else each.fileno() for each in streams]
        socket.send_fds(connection, [asked.encode()], files)
        return connection

    def close(self) -> None:
        """Ask no more."""
        os.close(self._asker)


def prepare() -> None:
    """Import what commands import on their way, and load the simulated bench's kernels."""
    import bluesky.plan_stubs as bps
    from tests.support.repeated import remember_schema

    import torquebench
    from torquebench.compensation import MODELS
    from torquebench.station import Station

    seldom = tuple(f"torquebench.{name}" for name in SELDOM)
    for module in pkgutil.walk_packages(torquebench.__path__, "torquebench."):
        if not module.name.startswith(seldom):
            import_module(module.name)
    assert all(MODELS.values())  # every kind is imported
    remember_schema()
    with tempfile.TemporaryDirectory() as folder, Station.open(None, Path(folder)) as station:
        station.run(bps.sleep(0.2), kind="warm-up")
    assert threading.active_count() == 1, threading.enumerate()
    gc.collect()
    gc.freeze()  # a collection at the end of a command would copy all pages


def next_command(listening: socket.socket) -> list[str]:
    """Serve askers to the end of standard input; each command returns in a process of its own."""
    running: dict[int, socket.socket] = {}
    ended, told = socket.socketpair()
    told.setblocking(False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(told.fileno())
    while True:
        ready, _, _ = select.select([listening, sys.stdin, ended], [], [])
        if sys.stdin in ready:  # interrupted tests leave no command behind
            for process in running:
                os.kill(process, signal.SIGKILL)
            os._exit(0)
        if ended in ready:
            ended.recv(4096)
            report_ended(running)
        if listening not in ready:
            continue
        connection, _ = listening.accept()
        data, streams, _, _ = socket.recv_fds(connection, ASKED_AT_MOST, 2)
        process = os.fork()
        if process:
            for stream in streams:  # its reader waits for the end of the last writer
                os.close(stream)
            connection.send(str(process).encode())
            running[process] = connection
            continue
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        if len(streams) == 1:
            os.login_tty(streams[0])
            sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr] # it is a file here
        else:
            for number, stream in enumerate((os.open(os.devnull, os.O_RDONLY), *streams)):
                os.dup2(stream, number)
                os.close(stream)
        for each in (listening, ended, told, connection, *running.values()):
            each.close()
        asked = json.loads(data)
        os.chdir(asked["cwd"])
        os.environ.clear()
        os.environ.update(asked["environment"])
        vars(OPERATIONS).pop("_added", None)  # the environment may name files with others
        command: list[str] = asked["command"]
        return command


def report_ended(running: dict[int, socket.socket]) -> None:
    """Tell those who asked for commands that have ended."""
    while running:
        process, status = os.waitpid(-1, os.WNOHANG)
        if not process:
            break
        with running.pop(process) as connection, suppress(BrokenPipeError):  # nobody asks any more
            connection.send(str(os.waitstatus_to_exitcode(status)).encode())


def leave(code: int) -> None:
    """End as a process does, but free no object: that copies the page of each."""
    threading._shutdown()  # type: ignore[attr-defined] # what the interpreter does at its end
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    from torquebench.cli import main
    from torquebench.operations import OPERATIONS

    prepare()
    sys.argv = next_command(socket.socket(fileno=int(sys.argv[1])))
    try:
        if sys.argv[:2] == [sys.executable, "-c"]:
            code = sys.argv[2]
            sys.argv[:3] = ["-c"]
            exec(code, {"__name__": "__main__"})
            leave(0)
        main()
    except SystemExit as end:
        leave(int(end.code or 0))
