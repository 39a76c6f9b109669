"""The greeting of a socketcand server whose bus is busy."""

import contextlib
import socket
import threading
from collections.abc import Iterable

import can
import pytest

from torquebench.bench.drivers.socketcand_bus import SocketcandBus

FRAME = b"< frame 061 1795926183.805382 0100000000000080 >"
GREETING = b"< hi >", b"< ok >", b"< ok >"


def greeted(parts: Iterable[bytes]) -> SocketcandBus:
    """Return a bus whose server sends these parts, each as a packet, whatever it is asked."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            client, _ = listener.accept()
            with client, contextlib.suppress(OSError):
                for part in parts:
                    client.sendall(part)
                while client.recv(64):
                    pass

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            return SocketcandBus("can0", "127.0.0.1", listener.getsockname()[1], 5.0)
        except can.CanError:
            thread.join()
            raise


@pytest.mark.parametrize("before", range(3))
@pytest.mark.parametrize("size", [1, 7, 1000])
def test_frames_may_come_at_any_time(before: int, size: int) -> None:
    said = b"".join((*GREETING[: before + 1], FRAME, *GREETING[before + 1 :], FRAME))
    bus = greeted(said[k : k + size] for k in range(0, len(said), size))
    try:
        message = bus.recv(5.0)
        assert message is not None
        assert (message.arbitration_id, bytes(message.data)) == (0x61, b"\1\0\0\0\0\0\0\x80")
    finally:
        bus.shutdown()


def test_a_server_of_something_else_is_refused() -> None:
    with pytest.raises(can.CanInitializationError, match="error"):
        greeted([b"< hi >", b"< error could not open bus >"])
