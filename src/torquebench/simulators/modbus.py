"""A Modbus TCP server (pymodbus) before one image of the simulated bench."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from torquebench.bench.drivers import modbus_map as registers
from torquebench.errors import BenchError, TorquebenchError
from torquebench.simulators.misbehaviour import WireFaults
from torquebench.simulators.modbus_images import Image
from torquebench.simulators.plant import Plant

__all__ = ["ModbusSimulator"]

REGISTERS = 960
CONTACTS = 32
START_TIMEOUT_S = 10.0


class ModbusSimulator:
    """One simulated instrument on Modbus TCP, served from a thread of its own.

    Parameters
    ----------
    plant : Plant
    image : Image
    faults : WireFaults
    host, port
        Port 0 takes a free one, which `port` then says.
    unit : int
    base : int
        Where the image's registers begin.
    """

    def __init__(
        self,
        plant: Plant,
        image: Image,
        faults: WireFaults,
        host: str,
        port: int,
        unit: int = 1,
        base: int = 0,
    ) -> None:
        self.host = host
        self.port = port
        self._plant = plant
        self._image = image
        self._faults = faults
        self._unit = unit
        self._base = base
        self._frozen: dict[int, list[int]] = {}
        self._loop = asyncio.new_event_loop()
        self._server: Any = None
        self._failure: BaseException | None = None
        self._started = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name=f"simulated-{faults.name}", daemon=True
        )
        faults.disconnect = self._disconnect
        self._thread.start()
        self._started.wait(START_TIMEOUT_S)
        if self._server is None:
            raise BenchError(
                f"{faults.name} can't be served on {host}:{port} ({self._failure})",
                "a free port",
                "end what uses it, or name another one",
            )

    # -- serving ----------------------------------------------------------------------------

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except Exception as error:
            self._failure = error
            self._started.set()
        finally:
            pending = asyncio.all_tasks(self._loop)
            for task in pending:
                task.cancel()
            if pending:
                self._loop.run_until_complete(asyncio.gather(*pending, return_exceptions=True))
            self._loop.close()

    async def _serve(self) -> None:
        bits = SimData(0, values=[False] * CONTACTS, datatype=DataType.BITS)
        words = SimData(0, count=self._base + REGISTERS, datatype=DataType.REGISTERS)
        memory = ([bits], [_copy(bits)], [words], [_copy(words)])
        device = SimDevice(self._unit, simdata=memory, action=self._action)
        server = ModbusTcpServer(
            device,
            address=(self.host, self.port),
            trace_packet=self._trace,
            trace_connect=self._connected,
        )
        await server.serve_forever(background=True)
        self.port = server.transport.sockets[0].getsockname()[1]
        self._server = server
        self._started.set()
        with contextlib.suppress(asyncio.CancelledError):
            await server.serving

    def _connected(self, connected: bool) -> None:
        if connected and self._faults.refusing:
            self._loop.call_soon(self._disconnect_now)

    def _disconnect(self) -> None:
        self._loop.call_soon_threadsafe(self._disconnect_now)

    def _disconnect_now(self) -> None:
        for connection in list(self._server.active_connections.values()):
            if connection.transport is not None:
                connection.transport.abort()

    def _trace(self, sending: bool, data: bytes) -> bytes:
        if not sending:
            return data
        return self._faults.outgoing(data) or b""

    async def _action(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        present: list[int],
        values: list[Any] | None,
    ) -> ExcCodes | None:
        """Refresh what is read, obey what is written."""
        del count, start
        if self._faults.busy:
            return ExcCodes.DEVICE_BUSY
        if values is not None and self._faults.ignoring:
            return None
        try:
            with self._plant.lock:
                if values is None:
                    self._refresh(function, present)
                elif function in (5, 15):
                    self._image.switched(address - self._base, list(values))
                else:
                    self._image.written(address - self._base, list(values))
        except (TorquebenchError, ValueError, IndexError):
            return ExcCodes.ILLEGAL_VALUE
        return None

    def _refresh(self, function: int, present: list[int]) -> None:
        if self._faults.frozen:
            present[:] = self._frozen.setdefault(function, self._fresh(function, present))
        else:
            self._frozen.pop(function, None)
            present[:] = self._fresh(function, present)

    def _fresh(self, function: int, present: list[int]) -> list[int]:
        fresh = list(present)
        lying = self._faults.lying
        if function == 2:
            for place, made in self._image.contacts(lying).items():
                word, bit = divmod(self._base + place, 16)
                fresh[word] = fresh[word] & ~(1 << bit) | (int(made) << bit)
        elif function == 4:
            plate = registers.IDENTITY
            fresh[plate : plate + len(self._image.plate)] = self._image.plate
            for place, value in self._image.inputs(lying).items():
                fresh[self._base + place] = value
        return fresh

    def close(self) -> None:
        """End the server. A second call does nothing."""
        if self._loop.is_closed():
            return
        asyncio.run_coroutine_threadsafe(self._server.shutdown(), self._loop)
        self._thread.join()


def _copy(data: SimData) -> SimData:
    return SimData(data.address, count=data.count, values=data.values, datatype=data.datatype)
