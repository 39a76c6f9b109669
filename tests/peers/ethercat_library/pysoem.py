"""A fake of `pysoem`'s documented API, in front of `EthercatNetwork`: the adapter is its address.

Times, states, working counters and errors are those that the library documents. Nothing else of
the library is here; a test compares the names with the library's.
"""

# ruff: noqa: ARG002 - the library's own parameters
import contextlib
import json
import socket
import threading
from collections.abc import Callable
from typing import Any

NONE_STATE, INIT_STATE, PREOP_STATE, SAFEOP_STATE, OP_STATE = 0, 1, 2, 4, 8
STATE_ACK = STATE_ERROR = 0x10


class SdoError(Exception):
    def __init__(self, slave_pos: int, index: int, subindex: int, code: int, desc: str) -> None:
        self.slave_pos, self.index, self.subindex = slave_pos, index, subindex
        self.abort_code, self.desc = code, desc


class MailboxError(Exception):
    pass


class PacketError(Exception):
    pass


class ConfigMapError(Exception):
    pass


class WkcError(Exception):
    def __init__(self, message: str | None = None, wkc: int | None = None) -> None:
        self.message, self.wkc = message, wkc


class _Wire:
    """Requests and answers, one at a time."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._address, self._lock = address, threading.Lock()
        self._connect()

    def _connect(self) -> None:
        self._socket = socket.create_connection(self._address, 5.0)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._lines = self._socket.makefile("rb")

    def ask(self, timeout_us: float, **request: Any) -> dict[str, Any] | None:
        """Return the answer; None for no frame. A late answer is never taken for another one."""
        with self._lock:
            try:
                self._socket.settimeout(max(timeout_us / 1e6, 1.0 if timeout_us < 1e5 else 0.0))
                self._socket.sendall(json.dumps(request).encode() + b"\n")
                line = self._lines.readline()
                if not line:
                    raise OSError
                answer: dict[str, Any] = json.loads(line)
                return answer
            except OSError:
                self.close()
                with contextlib.suppress(OSError):
                    self._connect()
                return None

    def close(self) -> None:
        self._lines.close()
        self._socket.close()


class _Slave:
    def __init__(self, master: "Master", position: int) -> None:
        self._master, self._position = master, position
        self.config_func: Callable[[int], None] | None = None
        self.state = self._sizes = 0
        self.name, self.al_status = "drive of its own", 0
        self.output = self.input = b""
        self.callbacks: list[Callable[[Any], None]] = []

    def ask(self, name: str, timeout_us: float = 1e6, **request: Any) -> dict[str, Any]:
        answer = self._master.mailbox.ask(timeout_us, name=name, position=self._position, **request)
        if answer is None:
            raise WkcError(wkc=0)
        return answer

    def sdo_read(
        self,
        index: int,
        subindex: int,
        size: int = 0,
        ca: bool = False,
        *,
        release_gil: bool | None = None,
    ) -> bytes:
        answer = self.ask("sdo_read", self._master.sdo_read_timeout, index=index, subindex=subindex)
        self._check(index, subindex, answer)
        return bytes.fromhex(answer["data"])

    def sdo_write(
        self,
        index: int,
        subindex: int,
        data: bytes,
        ca: bool = False,
        *,
        release_gil: bool | None = None,
    ) -> None:
        timeout_us = self._master.sdo_write_timeout
        answer = self.ask("sdo_write", timeout_us, index=index, subindex=subindex, data=data.hex())
        self._check(index, subindex, answer)

    def _check(self, index: int, subindex: int, answer: dict[str, Any]) -> None:
        if "abort" in answer:
            code = answer["abort"]
            raise SdoError(self._position + 1, index, subindex, code, f"abort 0x{code:08X}")

    def set_watchdog(self, wd_type: str, wd_time_ms: float) -> None:
        if wd_type not in ("pdi", "processdata"):
            raise AttributeError
        if wd_time_ms > 6553.5:
            raise AttributeError("wd_time_ms is limited to 6553.5 ms")
        self.ask("watchdog", ms=wd_time_ms)

    def write_state(self) -> int:
        self.ask("request_state", state=self.state)
        return 1

    def state_check(self, expected_state: int, timeout: int = 2000) -> int:
        try:
            answer = self.ask("state")
        except WkcError:
            self.state = NONE_STATE
            return NONE_STATE
        self.state, self.al_status = answer["state"], answer["status"]
        return self.state

    def add_emergency_callback(self, callback: Callable[[Any], None]) -> None:
        self.callbacks.append(callback)

    def mbx_receive(self) -> int:
        return 0


class Master:
    def __init__(self) -> None:
        self.slaves: list[_Slave] = []
        self.sdo_read_timeout = self.sdo_write_timeout = 700_000
        self.expected_wkc = 0
        self.state = INIT_STATE
        self._sent = False

    def open(self, ifname: str) -> None:
        host, _, port = ifname.partition(":")
        try:
            self.mailbox = _Wire((host, int(port)))
            self._cyclic = _Wire((host, int(port)))
        except (OSError, ValueError):
            raise ConnectionError(f"could not open interface {ifname}") from None

    def close(self) -> None:
        for wire in ("mailbox", "_cyclic"):
            if hasattr(self, wire):
                getattr(self, wire).close()

    def config_init(self, usetable: bool = False, *, release_gil: bool | None = None) -> int:
        answer = self.mailbox.ask(1e6, name="count")
        if answer is None:
            return -1
        self.slaves = [_Slave(self, position) for position in range(answer["count"])]
        for slave in self.slaves:
            slave.state = PREOP_STATE
            slave.ask("request_state", state=INIT_STATE + STATE_ACK)
            slave.ask("request_state", state=PREOP_STATE)
        return len(self.slaves)

    def config_map(self) -> int:
        size = 0
        for position, slave in enumerate(self.slaves):
            if slave.config_func is not None:
                slave.config_func(position)
            slave.ask("request_state", state=SAFEOP_STATE)
            out, into = slave.ask("state")["sizes"]
            slave.output, slave.input = bytes(out), bytes(into)
            size += out + into
        self.expected_wkc = 3 * len(self.slaves)
        return size

    def state_check(self, expected_state: int, timeout: int = 50_000) -> int:
        return min(slave.state_check(expected_state) & 0xF for slave in self.slaves)

    def write_state(self) -> int:
        for slave in self.slaves:
            slave.ask("request_state", state=self.state)
        return 1

    def send_processdata(self, *, release_gil: bool | None = None) -> int:
        self._sent = True
        return 1

    def receive_processdata(self, timeout: int = 2000, *, release_gil: bool | None = None) -> int:
        outputs = [slave.output.hex() for slave in self.slaves]
        answer = self._cyclic.ask(timeout, name="cycle", out=outputs)
        if answer is None:
            return -1
        for slave, data in zip(self.slaves, answer["in"], strict=True):
            slave.input = bytes.fromhex(data)
        working: int = answer["working"]
        return working


def al_status_code_to_string(code: int) -> str:
    return {0: "No error", 0x1B: "Sync manager watchdog"}.get(code, "Unknown")
