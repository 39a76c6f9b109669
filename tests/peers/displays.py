r"""Torque displays on serial lines, after the manuals of their kinds.

- A pocket display (Norbar TST/TTT-like) answers each request character with a line such as
  ` 123.45 N.m`, and `OL` beyond its range; an unknown request gets no answer.
- A board with a load cell's converter (HX711) sends a line of counts by itself, ten or eighty times
  a second, from when it has power, whoever listens.
"""

import threading
import time
from collections.abc import Callable
from typing import Any, Self

from tests.peers.lines import LinePeer


class DisplayPeer(LinePeer):
    """Answers `P` with its torque; `torque_nm` returns it, NaN beyond its range."""

    ends = rb"\r"
    ending = b"\r"

    def __init__(
        self, torque_nm: Callable[[], float], *, comma: bool = False, serial: bool = True
    ) -> None:
        super().__init__(serial=serial)
        self.torque_nm = torque_nm
        self._comma = comma

    def answer(self, line: str) -> str | None:
        if line != "P":
            return None
        torque = self.torque_nm()
        text = "OL" if torque != torque else f"{torque:9.3f} N.m"
        return text.replace(".", ",", 1) if self._comma else text


class ScalePeer(LinePeer):
    """Sends counts by itself."""

    def __init__(self, counts: Callable[[], int], rate_hz: float = 80.0) -> None:
        super().__init__(serial=True)
        self.counts = counts
        self._period_s = 1.0 / rate_hz
        self._ending = threading.Event()

    def __enter__(self) -> Self:
        super().__enter__()
        self._sending = threading.Thread(target=self._send, daemon=True)
        self._sending.start()
        return self

    def __exit__(self, *ended: Any) -> None:
        self._ending.set()
        self._sending.join()
        super().__exit__(*ended)

    def _send(self) -> None:
        while not self._ending.wait(self._period_s):
            try:
                self.write(f"{self.counts()}\n".encode("ascii"))
            except OSError:
                return

    def answer(self, _line: str) -> str | None:
        return None

    def silence(self) -> None:
        """Stop sending."""
        self._ending.set()
        time.sleep(2.0 * self._period_s)
