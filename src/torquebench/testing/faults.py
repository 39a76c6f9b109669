"""Faults of a device or a cable, which last for some answers or some time."""

from __future__ import annotations

import time


class Faults:
    """What misbehaves by kind.

    "drop" loses an answer, "cut" sends its first half, "delay" sends it `amount` seconds late,
    "garble" sends what nobody understands, "disconnect" closes every connection. A fault lasts for
    a number of `replies`, for `duration_s`, or until `heal`.
    """

    def __init__(self) -> None:
        self._faults: dict[str, tuple[float, int | None, float]] = {}

    def disconnect(self) -> None:
        """Close every connection."""
        raise NotImplementedError

    def garbled(self, data: bytes) -> bytes:
        """Return data that nobody understands."""
        raise NotImplementedError

    def start(
        self,
        _endpoint: str,
        kind: str,
        *,
        amount: float = 0.0,
        replies: int | None = None,
        duration_s: float | None = None,
    ) -> None:
        """Delay, drop, cut or garble what is sent, or disconnect."""
        until = float("inf") if duration_s is None else time.monotonic() + duration_s
        if kind != "disconnect" or duration_s is not None:
            self._faults[kind] = amount, replies, until
        if kind == "disconnect":
            self.disconnect()

    def heal(self) -> None:
        """Behave again."""
        self._faults.clear()

    def fault(self, kind: str) -> float | None:
        """Return the amount of a fault that happens now; None without one."""
        amount, replies, until = self._faults.get(kind, (0.0, 0, 0.0))
        if replies == 0 or time.monotonic() > until:
            return None
        if replies is not None:
            self._faults[kind] = amount, replies - 1, until
        return amount

    def spoiled(self, data: bytes) -> bytes:
        """Return what is sent in place of data, perhaps late; empty for nothing."""
        late_s = self.fault("delay")
        if late_s is not None:
            time.sleep(late_s)
        if self.fault("drop") is not None:
            return b""
        if self.fault("cut") is not None:
            return data[: len(data) // 2]
        return data if self.fault("garble") is None else self.garbled(data)
