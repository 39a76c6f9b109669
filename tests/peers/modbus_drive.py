"""A drive on Modbus TCP, served by pymodbus."""

import asyncio
import contextlib
import math
import struct
import threading
from types import TracebackType
from typing import Any, Self

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
from tests.peers.motor import Motor

LARGEST_NM, LARGEST_RAD_S = 60.0, 150.0


def _words(value: float) -> list[int]:
    return list(struct.unpack(">2H", struct.pack(">f", value)))


def _number(words: list[int]) -> float:
    return float(struct.unpack(">f", struct.pack(">2H", *words))[0])


class ModbusDrivePeer:
    """One drive at `address`, from entering the context to leaving it."""

    def __init__(self, serial: str) -> None:
        self.motor = Motor()
        self.address = ""
        texts = ("peer works", "drive of its own", serial, "7.1")
        raw = b"".join(text.encode("ascii").ljust(16, b"\0") for text in texts)
        self._plate = list(struct.unpack(">32H", raw))
        self._holding = [0] * 14
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._ready.wait(120.0)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        asyncio.run_coroutine_threadsafe(self._server.shutdown(), self._loop)
        self._thread.join()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            pending = asyncio.all_tasks(self._loop)
            for task in pending:
                task.cancel()
            self._loop.run_until_complete(asyncio.gather(*pending, return_exceptions=True))
            self._loop.close()

    async def _serve(self) -> None:
        def block(count: int) -> SimData:
            return SimData(0, count=count, datatype=DataType.REGISTERS)

        def bits() -> SimData:
            return SimData(0, values=[False] * 16, datatype=DataType.BITS)

        memory = ([bits()], [bits()], [block(14)], [block(932)])
        device = SimDevice(1, simdata=memory, action=self._action)
        self._server: Any = ModbusTcpServer(device, address=("127.0.0.1", 0))
        await self._server.serve_forever(background=True)
        self.address = f"127.0.0.1:{self._server.transport.sockets[0].getsockname()[1]}"
        self._ready.set()
        with contextlib.suppress(asyncio.CancelledError):
            await self._server.serving

    async def _action(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        present: list[int],
        values: list[int] | None,
    ) -> ExcCodes | None:
        del start, count
        with self.motor.lock:
            self.motor.look()
            if function == 4:
                present[0:14] = self._report()
                present[900:932] = self._plate
            elif values is not None:
                try:
                    self._take(address, values)
                except ValueError:
                    return ExcCodes.ILLEGAL_VALUE
        return None

    def _report(self) -> list[int]:
        motor = self.motor
        status = motor.on | motor.tripped << 1 | motor.ramping << 2 | motor.tripped << 3
        return [
            *(status, 17 if motor.tripped else 0, self._holding[1]),
            *_words(motor.torque.present),
            *_words(motor.speed.present),
            0,
            *_words(LARGEST_NM),
            *_words(LARGEST_RAD_S),
            *(0, 4711),
        ]

    def _take(self, address: int, values: list[int]) -> None:
        holding = list(self._holding)
        touched = range(address, address + len(values))
        holding[address : touched.stop] = values
        if holding[0] & ~0x83 or holding[1] > 2:
            raise ValueError
        limits = ((2, LARGEST_NM), (4, math.inf), (6, LARGEST_RAD_S), (8, math.inf), (10, 1e3))
        for place, largest in limits:
            if place in touched or place + 1 in touched:
                value = _number(holding[place : place + 2])
                positive = place in (4, 8)
                if not math.isfinite(value) or abs(value) > largest or (positive and value <= 0.0):
                    raise ValueError
        self._holding = holding
        if 13 in touched:
            self.motor.watchdog_s = holding[13] / 1e3
        if 12 in touched:
            self.motor.feed()
        if 0 in touched:
            self._control(holding[0], holding[1])

    def _control(self, control: int, mode: int) -> None:
        motor = self.motor
        if control & 0x80:
            motor.reset()
        elif not control & 1:
            motor.power(False)
        elif control & 2:
            for ramp in (motor.torque, motor.speed):
                ramp.zero(_number(self._holding[10:12]))
        elif mode == 0:
            motor.power(True)
        elif motor.on:
            ramp, place = (motor.torque, 2) if mode == 1 else (motor.speed, 6)
            ramp.go(
                _number(self._holding[place : place + 2]),
                _number(self._holding[place + 2 : place + 4]),
            )
