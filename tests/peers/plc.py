"""A PLC whose program serves torque, probes, drives and a fixture, by ADS or S7.

The servers are those of pyads and python-snap7; the program below is written from
docs/reference/device-protocols.md.
"""

import contextlib
import ctypes
import itertools
import math
import os
import socket
import socketserver
import struct
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

import pyads
from pyads.testserver import AdvancedHandler, AmsResponseData, PLCVariable
from pyads.testserver.testserver import AdsClientConnection
from snap7.server import Server
from snap7.type import SrvArea
from tests.peers.motor import Motor

from torquebench.testing.cable import Cable

CYCLE_S = 0.002
NET_PORT = 48898
MAXIMUM_NM, MAXIMUM_RAD_S = {"Input": 60.0, "Output": 2500.0}, 150.0
DRIVE = (
    ("Control", "INT"),
    ("Value", "REAL"),
    ("Rate", "REAL"),
    ("WatchdogTime", "REAL"),
    ("Order", "DINT"),
    ("Life", "DINT"),
    ("Done", "DINT"),
    ("Status", "INT"),
    ("Fault", "INT"),
    ("LifeSeen", "DINT"),
    ("Torque", "REAL"),
    ("Speed", "REAL"),
    ("MaxTorque", "REAL"),
    ("MaxSpeed", "REAL"),
    ("Position", "DINT"),
)
FIXTURE = tuple(
    (name, "INT")
    for name in (
        *("InputDriven", "InputLocked", "OutputDriven", "OutputLocked"),
        *("Clamp", "Rail", "Contacts"),
    )
)
COUNTS = {"Input": 1048576, "Output": 8388608}
"""Of the encoders, per turn."""
SIZES = {"INT": ("h", 2), "DINT": ("i", 4), "REAL": ("f", 4)}


class Reducer:
    """A reducer between both flanges whose output is free: friction and ratio."""

    ratio = 121.0

    @staticmethod
    def friction_nm(speed_rad_s: float) -> float:
        """Return the torque at the input that keeps a speed."""
        return 0.2 * math.tanh(speed_rad_s / 0.1) + 0.002 * speed_rad_s


class Program:
    """The PLC's cyclic program on `memory`, which gets and sets fields by structure and name."""

    def __init__(self, memory: Any, values: dict[str, Callable[[], float]]) -> None:
        self.memory, self.values = memory, values
        self.motors = {"Input": Motor(), "Output": Motor()}
        self.running = True
        self.reducer: Reducer | None = None
        self._done = dict.fromkeys(self.motors, 0)
        self._life = dict.fromkeys(self.motors, 0)
        self._cycles = 0
        self._lock = threading.RLock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self.cycle()
        self._thread.start()

    def end(self) -> None:
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ending.wait(CYCLE_S):
            if self.running:
                self.cycle()

    def cycle(self) -> None:
        with self._lock:
            self._cycle()

    def _cycle(self) -> None:
        for name, motor in self.motors.items():
            with motor.lock:
                self._drive(name, motor)
        self._fixture()
        for name, value in self.values.items():
            self.memory.set("Values", name, value())
        self._cycles += 1
        self.memory.set("Values", "Cycles", self._cycles)

    def _drive(self, name: str, motor: Motor) -> None:
        get = lambda field: self.memory.get(name, field)  # noqa: E731
        motor.watchdog_s = get("WatchdogTime")
        life, order, refused = get("Life"), get("Order"), None
        if life != self._life[name]:
            self._life[name] = life
            motor.feed()
        motor.look()
        if order != self._done[name]:
            refused = self._obey(motor, MAXIMUM_NM[name], get)
            self._done[name] = order
        report = {
            "Status": motor.on | (8 if refused else get("Status") & 8 if refused is None else 0),
            "Fault": 1 if motor.tripped else 0,
            "LifeSeen": life,
            "Torque": motor.torque.present,
            "Speed": motor.speed.present,
            "MaxTorque": MAXIMUM_NM[name],
            "MaxSpeed": MAXIMUM_RAD_S,
            "Position": 4711 + round(COUNTS[name] * self._angle_rad(name) / math.tau),
            "Done": self._done[name],
        }
        for field, value in report.items():
            self.memory.set(name, field, value)

    def _angle_rad(self, name: str) -> float:
        """Return the angle of a side's shaft."""
        if self.reducer is None or name == "Input":
            return self.motors[name].angle_rad
        return self.motors["Input"].angle_rad / self.reducer.ratio

    def _obey(self, motor: Motor, most_nm: float, get: Callable[[str], Any]) -> bool:
        """Execute a command; return whether it is refused."""
        control, value, rate = get("Control"), get("Value"), get("Rate")
        if control == 0:
            motor.power(False)
        elif control == 1:
            motor.power(True)
        elif control == 5:
            motor.reset()
        elif control == 4:
            for ramp in (motor.torque, motor.speed):
                ramp.zero(rate)
        else:
            torque, speed = (motor.torque, most_nm), (motor.speed, MAXIMUM_RAD_S)
            chosen, largest = torque if control == 2 else speed
            if not motor.on or not abs(value) <= largest * 1.000001 or not rate > 0.0:
                return True
            chosen.go(value, rate)
        return False

    def _fixture(self) -> None:
        driven = [self.memory.get("Fixture", name) for name, _ in FIXTURE[:5]]
        bits = []
        for side in (driven[0:2], driven[2:4]):
            bits += [not side[0] and not side[1], bool(side[0]), bool(side[1])]
        bits += [bool(driven[4])] * 2 + [not driven[4]]
        word = sum(bit << k for k, bit in enumerate(bits))
        self.memory.set("Fixture", "Contacts", word)


class _Plc:
    """A PLC behind a cable; `start` and `heal` are those of the cable."""

    get: Callable[[str, str], Any]

    program: Program
    cable: Cable

    def start(self, endpoint: str, kind: str, **options: Any) -> None:
        self.cable.start(endpoint, kind, **options)

    def heal(self) -> None:
        self.cable.heal()

    def torque_nm(self, side: str) -> float:
        """Return the torque of a side's drive against the clamped standard or reducer."""
        motor = self.program.motors[side.capitalize()]
        with motor.lock:
            motor.look()
            if self.program.reducer is not None:
                speed = motor.speed.present if motor.on else 0.0
                return self.program.reducer.friction_nm(speed) if side == "input" else 0.0
            return motor.torque.present if motor.on and self.get("Fixture", "Clamp") else 0.0

    def _serve(self) -> None:
        raise NotImplementedError

    def _end(self) -> None:
        raise NotImplementedError

    def __enter__(self) -> Self:
        self._serve()
        self.program.start()
        self.cable.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.cable.__exit__(kind, error, traceback)
        self.program.end()
        self._end()


class _Symbols(AdvancedHandler):  # type: ignore[misc]
    """Symbols that aren't declared are refused, as TwinCAT does."""

    def get_variable_by_name(self, name: str) -> Any:
        for variable in self._data.values():
            if variable.name == name.strip("\x00"):
                return variable
        raise KeyError(name)

    def handle_request(self, request: Any) -> Any:
        try:
            return super().handle_request(request)
        except KeyError:
            state = struct.pack("<H", struct.unpack("<H", request.ams_header.state_flags)[0] | 1)
            return AmsResponseData(
                state, request.ams_header.error_code, struct.pack("<II", 1808, 0)
            )


class _AmsConnection(socketserver.StreamRequestHandler):
    """Answers the packets of all sections, which share one connection and may come together."""

    server: "_Router"

    def handle(self) -> None:
        with contextlib.suppress(OSError):
            while len(head := self.rfile.read(6)) == 6:
                packet = head + self.rfile.read(struct.unpack("<I", head[2:])[0])
                request = AdsClientConnection.construct_request(packet)
                if self.server.program.running:
                    self.server.program.cycle()  # no stale position
                response = self.server.handler.handle_request(request)
                self.wfile.write(AdsClientConnection.construct_response(response, request))


class _Router(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = True
    handler: Any
    program: Program


_NUMBERS = itertools.count(os.getpid() % 50_000 * 64)  # other processes are far away


class AdsPlc(_Plc):
    """TwinCAT: `GVL.stInput`, `GVL.stOutput`, `GVL.stFixture` and `GVL.<value>`.

    ADS has one port, so each peer has loopback addresses of its own.
    """

    def __init__(self, values: dict[str, Callable[[], float]]) -> None:
        number = next(_NUMBERS) * 2
        hosts = [
            f"127.{1 + k // 60000 % 250}.{k // 250 % 250}.{1 + k % 250}"
            for k in (number, number + 1)
        ]
        self.host, self._behind = hosts[0], hosts[1]
        self.net_id = f"{self.host}.1.1"
        self.address = f"{self.net_id}:851"
        self._handler = _Symbols()
        self._lock = threading.RLock()
        types = {
            "INT": (pyads.constants.ADST_INT16, ctypes.c_int16),
            "DINT": (pyads.constants.ADST_INT32, ctypes.c_int32),
            "REAL": (pyads.constants.ADST_REAL32, ctypes.c_float),
        }
        self._variables: dict[tuple[str, str], tuple[Any, str]] = {}
        found = [("Input", *field) for field in DRIVE] + [("Output", *field) for field in DRIVE]
        found += [("Fixture", *field) for field in FIXTURE]
        found += [("Values", name, "REAL") for name in values]
        for structure, name, kind in found:
            path = f"GVL.{name}" if structure == "Values" else f"GVL.st{structure}.{name}"
            self._add(structure, name, path, kind, types[kind][0])
        cycles = "TwinCAT_SystemInfoVarList._TaskInfo[1].CycleCount"
        self._add("Values", "Cycles", cycles, "DINT", types["DINT"][0])
        self.program = Program(self, values)
        self.cable = Cable(NET_PORT, self._behind, (self.host, NET_PORT))

    def _add(self, structure: str, name: str, path: str, kind: str, ads_type: int) -> None:
        variable = PLCVariable(path, struct.pack(f"<{SIZES[kind][0]}", 0), ads_type, kind)
        self._handler.add_variable(variable)
        self._variables[structure, name] = variable, f"<{SIZES[kind][0]}"

    def get(self, structure: str, name: str) -> Any:
        variable, form = self._variables[structure, name]
        return struct.unpack(form, variable.value)[0]

    def set(self, structure: str, name: str, value: float) -> None:
        variable, form = self._variables[structure, name]
        variable.value = struct.pack(form, value if form == "<f" else int(value))

    def section(self, **keys: Any) -> dict[str, Any]:
        return {"protocol": "ads", "address": self.address, "host": self.host, **keys}

    def variable(self, name: str) -> str:
        return f"GVL.{name}"

    def structure(self, name: str) -> str:
        return f"GVL.st{name}"

    def _serve(self) -> None:
        self._server = _Router((self._behind, NET_PORT), _AmsConnection)
        self._server.handler, self._server.program = self._handler, self.program
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def _end(self) -> None:
        self._server.shutdown()
        self._server.server_close()


class S7Plc(_Plc):
    """S7-1500: DB10 and DB11 are drives, DB12 the fixture, DB20 the values and the cycles."""

    BLOCKS = ("Input", "Output", "Fixture", "Values")
    NUMBERS = (10, 11, 12, 20)

    def __init__(self, values: dict[str, Callable[[], float]]) -> None:
        layouts = {
            "Input": DRIVE,
            "Output": DRIVE,
            "Fixture": FIXTURE,
            "Values": (*((name, "REAL") for name in values), ("Cycles", "DINT")),
        }
        self._places: dict[tuple[str, str], tuple[str, int]] = {}
        self._memory: dict[str, bytearray] = {}
        for block, fields in layouts.items():
            offset = 0
            for name, kind in fields:
                self._places[block, name] = kind, offset
                offset += SIZES[kind][1]
            self._memory[block] = bytearray(offset)
        with socket.create_server(("127.0.0.1", 0)) as free:
            self._port = free.getsockname()[1]
        self.cable = Cable(self._port)
        self.address = f"127.0.0.1:{self.cable.port}"
        self.program = Program(self, values)

    def get(self, structure: str, name: str) -> Any:
        kind, offset = self._places[structure, name]
        return struct.unpack_from(f">{SIZES[kind][0]}", self._memory[structure], offset)[0]

    def set(self, structure: str, name: str, value: float) -> None:
        kind, offset = self._places[structure, name]
        number = value if kind == "REAL" else int(value)
        struct.pack_into(f">{SIZES[kind][0]}", self._memory[structure], offset, number)

    def section(self, **keys: Any) -> dict[str, Any]:
        return {"protocol": "s7", "address": self.address, **keys}

    def variable(self, name: str) -> str:
        kind, offset = self._places["Values", name]
        return f"DB20.{kind}{offset}"

    def structure(self, name: str) -> str:
        return f"DB{dict(zip(self.BLOCKS, self.NUMBERS, strict=True))[name]}"

    def _serve(self) -> None:
        self._server = Server(log=False)
        for block, number in zip(self.BLOCKS, self.NUMBERS, strict=True):
            self._server.register_area(SrvArea.DB, number, self._memory[block])
        self._server.start_to("127.0.0.1", self._port)

    def _end(self) -> None:
        with contextlib.suppress(Exception):
            self._server.stop()
        self._server.destroy()
