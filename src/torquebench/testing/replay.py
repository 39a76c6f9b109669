"""A device that answers as a recorded one did (`torquebench doctor --record`)."""

from __future__ import annotations

import json
import socketserver
import threading
from collections import defaultdict
from collections.abc import Iterable
from types import TracebackType
from typing import Self

__all__ = ["Replay"]


class Replay:
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
        self._answers: dict[str, list[list[str]]] = defaultdict(list)
        for event in map(json.loads, lines):
            if event.get("instrument") != instrument:
                continue
            if event["event"] == "sent":
                self._answers[event["text"]].append(last := [])
            elif event["event"] == "received" and self._answers:
                last.append(event["text"])
        replay = self

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                rest = b""
                while data := self.request.recv(4096):
                    *whole, rest = (rest + data).split(terminator)
                    for line in whole:
                        for answer in replay._answer(line.decode("ascii").strip()):
                            self.wfile.write(answer.encode("ascii") + terminator)

        class Server(socketserver.ThreadingTCPServer):
            daemon_threads = True

        self._server = Server(("127.0.0.1", 0), Handler)
        self.address = f"127.0.0.1:{self._server.server_address[1]}"

    def _answer(self, line: str) -> list[str]:
        answers = self._answers.get(line, [[]])
        return answers.pop(0) if len(answers) > 1 else answers[0]

    def __enter__(self) -> Self:
        """Begin to serve."""
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
