"""A device that answers as a recorded one did (`torquebench doctor --record`)."""

from __future__ import annotations

import json
import socket
from collections import defaultdict
from collections.abc import Iterable

from torquebench.testing.cable import TcpPort

__all__ = ["Replay"]


class Replay(TcpPort):
    """A device on TCP at `address` that gives the recorded lines to the recorded questions.

    Each line that was sent has the lines that came before the next one as its answer; asked more
    often than recorded, the last answer is repeated. A question that wasn't recorded gets none.

    Parameters
    ----------
    lines : iterable of str
        Lines of the file.
    instrument : str
        Name of the instrument in the file, such as "counter".
    terminator : bytes
        What ends a line.
    """

    def __init__(self, lines: Iterable[str], instrument: str, terminator: bytes = b"\n") -> None:
        super().__init__()
        self._answers: dict[str, list[list[str]]] = defaultdict(list)
        for event in map(json.loads, lines):
            if event.get("instrument") != instrument:
                continue
            if event["event"] == "sent":
                self._answers[event["text"]].append(last := [])
            elif event["event"] == "received" and self._answers:
                last.append(event["text"])
        self._terminator = terminator

    def serve(self, client: socket.socket) -> None:
        """Answer a client's questions."""
        rest = b""
        while data := client.recv(4096):
            *whole, rest = (rest + data).split(self._terminator)
            for line in whole:
                for answer in self._answer(line.decode("ascii").strip()):
                    client.sendall(answer.encode("ascii") + self._terminator)

    def _answer(self, line: str) -> list[str]:
        answers = self._answers.get(line, [[]])
        return answers.pop(0) if len(answers) > 1 else answers[0]
