"""A client of `socketcand`, a CAN bus over TCP, for python-can.

It replaces python-can's own client, which tries to connect for 10 s if no server listens, leaves
its socket open when the greeting fails, and loops without waiting after the server has closed.
"""

from __future__ import annotations

import select
import socket
import time
from collections import deque

import can

LONGEST_FRAME = 200


class SocketcandBus(can.BusABC):
    """A CAN bus behind a socketcand server or gateway.

    Parameters
    ----------
    channel : str
        Name of the bus at the server.
    timeout_s : float
        Time-out for connecting and for each answer of the greeting.

    Raises
    ------
    OSError
        No server listens.
    can.CanInitializationError
        The server's greeting isn't that of socketcand.
    """

    def __init__(self, channel: str, host: str, port: int, timeout_s: float) -> None:
        self.channel_info = f"socketcand on {channel}@{host}:{port}"
        self._frames: deque[can.Message] = deque()
        self._rest = b""
        self.gone = False
        self._socket = socket.create_connection((host, port), timeout_s)
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._greet(channel, time.monotonic() + timeout_s)
        except BaseException:
            self._socket.close()
            self._is_shutdown = True
            raise
        super().__init__(channel=channel)

    def _greet(self, channel: str, deadline: float) -> None:
        """Open the channel in raw mode on the server; refuse an unexpected answer."""
        for request, wanted in (
            (b"", b"< hi >"),
            (b"< open " + channel.encode() + b" >", b"< ok >"),
            (b"< rawmode >", b"< ok >"),
        ):
            self._socket.sendall(request)
            answer = self._answered()
            while answer.startswith(b"< frame") and time.monotonic() < deadline:
                answer = self._answered()  # the bus doesn't wait for the greeting
            if answer != wanted:
                raise can.CanInitializationError(f"socketcand answered {answer!r}, not {wanted!r}")
        self._split()

    def _answered(self) -> bytes:
        """Return the server's next text; what arrived after it is kept."""
        while b">" not in self._rest:
            data = self._socket.recv(4096)
            if not data or len(self._rest) > LONGEST_FRAME:
                said = f"said {self._rest!r}" if data else "closed the connection"
                raise can.CanInitializationError(f"socketcand {said}")
            self._rest += data
        answer, end, self._rest = self._rest.partition(b">")
        return answer.lstrip() + end

    def _split(self) -> None:
        """Queue the frames that have arrived whole."""
        while b">" in self._rest:
            line, _, self._rest = self._rest.partition(b">")
            self._take(line)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Return the next frame, if one arrives in time; False: the frames aren't filtered yet."""
        if self._frames:
            return self._frames.popleft(), False
        if self.gone:  # the next sender gets the error
            time.sleep(timeout or 0.0)
            return None, False
        try:
            if not select.select([self._socket], [], [], timeout)[0]:
                return None, False
            data = self._socket.recv(4096)
        except (OSError, ValueError):
            data = b""
        if not data:
            self.gone = True
            return None, False
        self._rest += data
        self._split()
        if len(self._rest) > LONGEST_FRAME:
            self._rest = b""
        return (self._frames.popleft() if self._frames else None), False

    def _take(self, line: bytes) -> None:
        """Queue a frame; other text is dropped."""
        words = line.rpartition(b"<")[2].split()
        if len(words) < 3 or words[0] != b"frame":
            return
        try:
            can_id = int(words[1], 16)
            data = bytes.fromhex(b"".join(words[3:]).decode("ascii"))
            taken = float(words[2])
        except ValueError:
            return
        if can_id > 0x1FFFFFFF or len(data) > 8:
            return
        self._frames.append(
            can.Message(
                timestamp=taken,
                arbitration_id=can_id,
                is_extended_id=len(words[1]) > 3,
                data=data,
                is_rx=True,
            )
        )

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; raises `can.CanOperationError` if the server has closed."""
        del timeout
        identifier = (
            f"{msg.arbitration_id:08X}" if msg.is_extended_id else (f"{msg.arbitration_id:03X}")
        )
        data = " ".join(f"{byte:02X}" for byte in msg.data)
        try:
            if self.gone:
                raise OSError("the server has closed the connection")
            self._socket.sendall(f"< send {identifier} {len(msg.data)} {data} >".encode("ascii"))
        except OSError as error:
            raise can.CanOperationError(str(error)) from error

    def shutdown(self) -> None:
        """Leave the bus. A second call does nothing."""
        super().shutdown()
        self._socket.close()
