"""An NI gRPC Device Server with one simulated counter card before the simulated bench.

It serves what buffered period and encoder measurements use, by the servicer and the messages that
come with `nidaqmx`.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from concurrent import futures
from dataclasses import dataclass, field
from typing import Any

import grpc
import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2_grpc as services
from numpy.typing import NDArray

from torquebench.bench.roles import Side
from torquebench.errors import BenchError
from torquebench.simulators.misbehaviour import WireFaults
from torquebench.simulators.plant import AngleTap, EdgeTap, Plant

__all__ = ["DaqmxSimulator", "device_number"]

TIMEOUT_ERROR = -200284  # some or all of the samples requested have not yet been acquired
NO_SUCH_TASK = -200088
THREADS = 4
DRIVER_VERSION = 26
MODEL = "PXIe-6612 (simulated)"
ATTRIBUTE_SERIAL = 0x632


def device_number(serial: str) -> int:
    """Return a device's serial number from eight hexadecimal digits, 0 where it is none."""
    with contextlib.suppress(ValueError):
        return int(serial, 16) & 0xFFFFFFFF
    return 0


@dataclass
class _Task:
    """One counter's task."""

    name: str
    channel: str = ""
    tap: EdgeTap | AngleTap | None = None
    last_tick: int = 0
    waiting: NDArray[np.uint32] = field(default_factory=lambda: np.empty(0, dtype=np.uint32))
    read: int = 0
    rate_hz: float = 1000.0
    clock: bool = False
    frozen: NDArray[np.uint32] | None = None


class _Servicer(services.NiDAQmxServicer):
    """The calls that the driver makes."""

    def __init__(self, plant: Plant, wiring: dict[str, str], faults: WireFaults) -> None:
        self._plant = plant
        self._wiring = wiring
        self._faults = faults
        self._lock = threading.RLock()
        self._tasks: dict[str, _Task] = {}
        self._epoch_tick: int | None = None
        self._timebase_hz = plant.bench.timebase_hz
        self._serial = device_number(plant.description.counter.serial)

    def _task(self, request: Any, context: Any) -> _Task:
        task = self._tasks.get(request.task.name)
        if task is None:
            context.set_trailing_metadata((("ni-error", str(NO_SUCH_TASK)),))
            context.abort(grpc.StatusCode.NOT_FOUND, "Task specified is invalid or does not exist.")
            raise BenchError("unreachable")
        return task

    # -- tasks ------------------------------------------------------------------------------

    def CreateTask(self, request: Any, context: Any) -> Any:  # noqa: N802
        del context
        with self._lock:
            if not self._tasks:
                self._plant.reading(True)
            self._tasks[request.session_name] = _Task(request.session_name)
        return messages.CreateTaskResponse(
            task={"name": request.session_name}, new_session_initialized=True
        )

    def ClearTask(self, request: Any, context: Any) -> Any:  # noqa: N802
        del context
        with self._lock:
            self._clear(self._tasks.pop(request.task.name, None))
        return messages.ClearTaskResponse()

    def _clear(self, task: _Task | None) -> None:
        if task is None:
            return
        if task.tap is not None:
            self._plant.release(task.tap)
        if task.clock:
            self._epoch_tick = None
            self._plant.counting(False)
        if not self._tasks:
            self._plant.reading(False)

    def clear_all(self) -> None:
        """End every task: their client has gone."""
        with self._lock:
            while self._tasks:
                self._clear(self._tasks.popitem()[1])

    def CreateCIPeriodChan(self, request: Any, context: Any) -> Any:  # noqa: N802
        task = self._task(request, context)
        task.channel = request.counter
        task.tap = self._plant.tap_edges(self._wiring[request.counter])
        return messages.CreateCIPeriodChanResponse()

    def CreateCIAngEncoderChan(self, request: Any, context: Any) -> Any:  # noqa: N802
        task = self._task(request, context)
        task.channel = request.counter
        side: Side = "input" if self._wiring[request.counter] == "input" else "output"
        task.tap = self._plant.tap_angles(side)
        return messages.CreateCIAngEncoderChanResponse()

    def CreateCOPulseChanFreq(self, request: Any, context: Any) -> Any:  # noqa: N802
        task = self._task(request, context)
        task.clock, task.rate_hz = True, request.freq
        return messages.CreateCOPulseChanFreqResponse()

    def CfgImplicitTiming(self, request: Any, context: Any) -> Any:  # noqa: N802
        self._task(request, context)
        return messages.CfgImplicitTimingResponse()

    def CfgSampClkTiming(self, request: Any, context: Any) -> Any:  # noqa: N802
        self._task(request, context).rate_hz = request.rate
        return messages.CfgSampClkTimingResponse()

    def SetTrigAttributeInt32(self, request: Any, context: Any) -> Any:  # noqa: N802
        self._task(request, context)
        return messages.SetTrigAttributeInt32Response()

    def SetTrigAttributeString(self, request: Any, context: Any) -> Any:  # noqa: N802
        self._task(request, context)
        return messages.SetTrigAttributeStringResponse()

    def StartTask(self, request: Any, context: Any) -> Any:  # noqa: N802
        task = self._task(request, context)
        if task.clock:  # its first pulse arms all others, on the encoders' millisecond
            with self._plant.lock:
                self._plant.counting(True)
                millisecond = round(self._timebase_hz / 1e3)
                now_tick = round(self._plant.now_s * self._timebase_hz)
                self._epoch_tick = -(-now_tick // millisecond) * millisecond
                self._plant.epoch_s = self._epoch_tick / self._timebase_hz
                for other in self._tasks.values():
                    other.last_tick = self._epoch_tick
        return messages.StartTaskResponse()

    def StopTask(self, request: Any, context: Any) -> Any:  # noqa: N802
        self._task(request, context)
        return messages.StopTaskResponse()

    # -- attributes -------------------------------------------------------------------------

    def GetDeviceAttributeUInt32(self, request: Any, context: Any) -> Any:  # noqa: N802
        del context
        known = request.attribute_raw == ATTRIBUTE_SERIAL
        serial = self._serial ^ (0xFFFFFFFF if self._faults.lying else 0)
        return messages.GetDeviceAttributeUInt32Response(value=serial if known else 0)

    def GetDeviceAttributeString(self, request: Any, context: Any) -> Any:  # noqa: N802
        del request, context
        return messages.GetDeviceAttributeStringResponse(value=MODEL)

    def GetChanAttributeDouble(self, request: Any, context: Any) -> Any:  # noqa: N802
        self._task(request, context)
        return messages.GetChanAttributeDoubleResponse(value=self._timebase_hz)

    def GetTaskAttributeString(self, request: Any, context: Any) -> Any:  # noqa: N802
        task = self._task(request, context)
        return messages.GetTaskAttributeStringResponse(value=task.channel or task.name)

    def GetTaskAttributeUInt32(self, request: Any, context: Any) -> Any:  # noqa: N802
        self._task(request, context)
        return messages.GetTaskAttributeUInt32Response(value=1)

    def GetReadAttributeUInt32(self, request: Any, context: Any) -> Any:  # noqa: N802
        task = self._task(request, context)
        with self._lock:
            self._fill(task)
            return messages.GetReadAttributeUInt32Response(value=int(task.waiting.size))

    def GetSystemInfoAttributeUInt32(self, request: Any, context: Any) -> Any:  # noqa: N802
        """Return the version of the driver, which the client looks at."""
        del request, context
        return messages.GetSystemInfoAttributeUInt32Response(value=DRIVER_VERSION)

    def GetErrorString(self, request: Any, context: Any) -> Any:  # noqa: N802
        del context
        text = f"NI-DAQmx error {request.error_code} (simulated)"
        return messages.GetErrorStringResponse(error_string=text)

    # -- reading ----------------------------------------------------------------------------

    def _fill(self, task: _Task) -> None:
        """Take what the plant has made since the last time, from the first pulse on."""
        epoch = self._epoch_tick
        if epoch is None:
            return
        if isinstance(task.tap, EdgeTap):
            blocks = [block.ticks for block in task.tap.take()]
            ticks = np.concatenate(blocks) if blocks else np.empty(0, dtype=np.int64)
            ticks = ticks[ticks > task.last_tick]
            if ticks.size:
                periods = np.diff(ticks, prepend=task.last_tick).astype(np.uint32)
                task.last_tick = int(ticks[-1])
                task.waiting = np.concatenate((task.waiting, periods))
        elif isinstance(task.tap, AngleTap):
            time_s, counts = task.tap.take()
            fresh = counts[time_s > epoch / self._timebase_hz - 1e-7]
            task.waiting = np.concatenate((task.waiting, fresh.astype(np.int32).view(np.uint32)))

    def ReadCounterU32Ex(self, request: Any, context: Any) -> Any:  # noqa: N802
        task = self._task(request, context)
        count = request.num_samps_per_chan
        if isinstance(task.tap, AngleTap) and self._epoch_tick is not None:
            until_s = self._epoch_tick / self._timebase_hz + (task.read + count) / task.rate_hz
            self._plant.require(until_s, request.timeout)
        with self._lock:
            self._fill(task)
            if task.waiting.size < count:
                return messages.ReadCounterU32ExResponse(
                    status=TIMEOUT_ERROR, samps_per_chan_read=0
                )
            taken, task.waiting = task.waiting[:count], task.waiting[count:]
            task.read += count
            if self._faults.frozen:
                taken = self._standing(task, taken)
            else:
                task.frozen = None
        return messages.ReadCounterU32ExResponse(
            status=0, read_array=taken.tolist(), samps_per_chan_read=int(taken.size)
        )

    def _standing(self, task: _Task, taken: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Return as many samples of what was true when it froze."""
        if task.frozen is None or task.frozen.size == 0:
            task.frozen = taken[-1:].copy()
        return np.repeat(task.frozen, taken.size)[: taken.size]


class _Spoiler(grpc.ServerInterceptor):
    """Spoils answers as ordered, below the service."""

    def __init__(self, faults: WireFaults) -> None:
        self._faults = faults
        self._broken = threading.Event()
        faults.disconnect = self._broken.set

    def intercept_service(self, continuation: Callable[[Any], Any], details: Any) -> Any:
        """Wrap the call."""
        handler = continuation(details)
        if handler is None or handler.unary_unary is None:
            return handler
        faults = self._faults

        def spoilt(request: Any, context: Any) -> Any:
            if faults.refusing or self._broken.is_set():
                self._broken.clear()
                context.abort(grpc.StatusCode.UNAVAILABLE, "Socket closed")
            answer = handler.unary_unary(request, context)
            data = faults.outgoing(handler.response_serializer(answer))
            if data is None:  # as if the answer was lost on its way
                threading.Event().wait(context.time_remaining() or 0.0)
                context.abort(grpc.StatusCode.DEADLINE_EXCEEDED, "no answer")
            return data

        return grpc.unary_unary_rpc_method_handler(
            spoilt, request_deserializer=handler.request_deserializer
        )


class DaqmxSimulator:
    """The device server on a TCP port.

    Parameters
    ----------
    plant : Plant
    wiring : dict of counter to channel or side
        Such as `{"Dev1/ctr0": "input_torque", "Dev1/ctr4": "input"}`.
    faults : WireFaults
    host, port
        Port 0 takes a free one, which `port` then says.
    """

    def __init__(
        self, plant: Plant, wiring: dict[str, str], faults: WireFaults, host: str, port: int
    ) -> None:
        self.host = host
        self.port = port
        self._faults = faults
        self._servicer = _Servicer(plant, wiring, faults)
        self._pool = futures.ThreadPoolExecutor(THREADS, thread_name_prefix="simulated-daqmx")
        together = threading.Barrier(THREADS)
        for _ in range(THREADS):  # the pool's threads live as long as the server does
            self._pool.submit(together.wait)
        self._server = self._serve()

    def _serve(self) -> grpc.Server:
        server = grpc.server(
            self._pool, interceptors=[_Spoiler(self._faults)], options=[("grpc.so_reuseport", 0)]
        )
        services.add_NiDAQmxServicer_to_server(self._servicer, server)
        try:
            self.port = server.add_insecure_port(f"{self.host}:{self.port}")
        except RuntimeError as error:
            raise BenchError(
                f"{self._faults.name} can't be served on {self.host}:{self.port}",
                "a free port",
                "end what uses it, or name another one",
            ) from error
        server.start()
        return server

    def close(self) -> None:
        """End the server. A second call does nothing."""
        self._server.stop(0.0).wait()
        self._servicer.clear_all()
        self._pool.shutdown()
