"""Commands from a process that has imported everything: each in a process of its own, at once.

Importing what a command needs takes seconds of a processor and says nothing new the hundredth time.
So a process imports once and forks for every command: `PreparedCommands.run` is what
`subprocess.run` is otherwise. Run as a script, this file is that process.
"""

import gc
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path

ASKED_AT_MOST = 1 << 20


class PreparedCommands:
    """The process that forks, and how to ask it; it ends with its last asker."""

    def __init__(self, environment: dict[str, str]) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="torquebench-")
        address = str(Path(self._folder.name, "socket"))
        listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        listening.bind(address)
        listening.listen(16)
        self._address = address
        self._process = subprocess.Popen(
            [sys.executable, __file__, str(listening.fileno())],
            stdin=subprocess.PIPE,
            env=environment,
            pass_fds=[listening.fileno()],
        )
        listening.close()

    def run(
        self, command: list[str], cwd: Path, environment: dict[str, str], timeout_s: float
    ) -> subprocess.CompletedProcess[str]:
        """Run a command to its end, output and messages apart."""
        with (
            socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as connection,
            tempfile.TemporaryFile() as output,
            tempfile.TemporaryFile() as messages,
        ):
            connection.connect(self._address)
            asked = json.dumps({"command": command, "cwd": str(cwd), "environment": environment})
            streams = [output.fileno(), messages.fileno()]
            socket.send_fds(connection, [asked.encode()], streams)
            process = int(connection.recv(64))
            connection.settimeout(timeout_s)
            try:
                code = int(connection.recv(64))
            except TimeoutError as error:
                os.kill(process, signal.SIGKILL)
                raise subprocess.TimeoutExpired(command, timeout_s) from error
            texts = []
            for stream in (output, messages):
                stream.seek(0)
                texts.append(stream.read().decode().replace("\r\n", "\n"))
        return subprocess.CompletedProcess(command, code, *texts)

    def close(self) -> None:
        """End the process."""
        self._process.communicate()
        self._folder.cleanup()


def next_command(listening: socket.socket) -> list[str]:
    """Serve askers to the end of standard input; each command returns in a process of its own."""
    while True:
        ready, _, _ = select.select([listening, sys.stdin], [], [])
        if sys.stdin in ready:
            os._exit(0)
        connection, _ = listening.accept()
        if os.fork():
            connection.close()
            continue
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        data, streams, _, _ = socket.recv_fds(connection, ASKED_AT_MOST, 2)
        asked = json.loads(data)
        process = os.fork()
        if process:
            connection.send(str(process).encode())
            _, status = os.waitpid(process, 0)
            connection.send(str(os.waitstatus_to_exitcode(status)).encode())
            os._exit(0)
        for number, stream in enumerate((os.open(os.devnull, os.O_RDONLY), *streams)):
            os.dup2(stream, number)
            os.close(stream)
        connection.close()
        listening.close()
        os.chdir(asked["cwd"])
        os.environ.clear()
        os.environ.update(asked["environment"])
        command: list[str] = asked["command"]
        return command


if __name__ == "__main__":
    for module in ("campaign.demo", "campaign.reducers.tests", "reports", "reports.certificate"):
        import_module(f"torquebench.{module}")
    from torquebench.cli import main
    from torquebench.compensation import MODELS

    assert all(MODELS.values())  # every kind is imported
    gc.freeze()  # a collection at the end of a command would copy all pages
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for askers' processes
    sys.argv = next_command(socket.socket(fileno=int(sys.argv[1])))
    main()
