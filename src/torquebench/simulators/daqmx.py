"""An NI gRPC Device Server with a simulated counter card of the simulated bench.

It provides buffered period and encoder measurements, with the servicer and the messages of
`nidaqmx`.
"""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable
from concurrent import futures
from dataclasses import dataclass, field
from typing import Any, NoReturn

import grpc
import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2_grpc as services
from numpy.typing import NDArray

from torquebench.bench.roles import Side
from torquebench.errors import BenchError
from torquebench.simulators.line_server import LineServer
from torquebench.simulators.misbehaviour import WireFaults
from torquebench.simulators.plant import AngleTap, EdgeTap, Plant

TIMEOUT_ERROR = -200284  # some or all of the samples requested have not yet been acquired
OVERRUN = -200279  # the samples were overwritten before they were read
RESERVED = -50103
NO_SUCH_TASK = -200088
NO_SUCH_COUNTER = -200170
NOT_STARTED = -200983
WRONG_VALUE = -200077
MESSAGES = {
    TIMEOUT_ERROR: "Some or all of the samples requested have not yet been acquired.",
    OVERRUN: "The samples attempted to be read are no longer available: they were overwritten.",
    RESERVED: "The specified resource is reserved.",
    NO_SUCH_TASK: "Task specified is invalid or does not exist.",
    NO_SUCH_COUNTER: "Physical channel specified does not exist on this device.",
    NOT_STARTED: "The task isn't started.",
    WRONG_VALUE: "Requested value is not a supported value for this property.",
}
DEFAULT_BUFFER = 100_000
"""Default number of samples in a buffer."""
WAIT_STEP_S = 0.005
LONGEST_WAIT_S = 60.0
ALL_THERE_ARE = -1
THREADS = 6
DRIVER_VERSION = 26
MODEL = "PXIe-6612 (simulated)"
ATTRIBUTE_SERIAL = 0x632


def device_number(serial: str) -> int:
    """Return a device's serial number from eight hexadecimal digits, or 0."""
    with contextlib.suppress(ValueError):
        return int(serial, 16) & 0xFFFFFFFF
    return 0


@dataclass
class _Task:
    """The task of one counter."""

    name: str
    client: str = ""
    buffer: int = DEFAULT_BUFFER
    started: bool = False
    overrun: bool = False
    channel: str = ""
    tap: EdgeTap | AngleTap | None = None
    last_tick: int = 0
    waiting: NDArray[np.uint32] = field(default_factory=lambda: np.empty(0, dtype=np.uint32))
    read: int = 0
    rate_hz: float = 1000.0
    clock: bool = False
    frozen: NDArray[np.uint32] | None = None


class _Servicer(services.NiDAQmxServicer):
    """Service with the calls of the driver."""

    def __init__(self, plant: Plant, wiring: dict[str, str], faults: WireFaults) -> None:
        self._plant = plant
        self._wiring = wiring
        self._faults = faults
        self._lock = threading.RLock()
        self._tasks: dict[str, _Task] = {}
        self._epoch_tick: int | None = None
        self._timebase_hz = plant.bench.timebase_hz
        self._serial = device_number(plant.description.counter.serial)

    def _fail(self, context: Any, code: int) -> NoReturn:
        """End a call with an error of the driver, like the device server."""
        context.set_trailing_metadata((("ni-error", str(code)),))
        context.abort(grpc.StatusCode.UNKNOWN, f"{MESSAGES[code]} Status code: {code}")
        raise BenchError("unreachable")

    def _task(self, request: Any, context: Any) -> _Task:
        """Return a request's task; fail if there is none."""
        task = self._tasks.get(request.task.name)
        if task is None:
            self._fail(context, NO_SUCH_TASK)
        return task

    def _wired(self, counter: str, context: Any) -> str:
        """Return what is wired to a counter; fail if nothing is."""
        wired = self._wiring.get(counter)
        if wired is None:
            self._fail(context, NO_SUCH_COUNTER)
        return wired

    # -- tasks ------------------------------------------------------------------------------

    def CreateTask(self, request: Any, context: Any) -> Any:  # noqa: N802
        """Create a task; the first one starts the plant's reading."""
        with self._lock:
            if not self._tasks:
                self._plant.reading(True)
            self._tasks[request.session_name] = _Task(request.session_name, context.peer())
        return messages.CreateTaskResponse(
            task={"name": request.session_name}, new_session_initialized=True
        )

    def ClearTask(self, request: Any, context: Any) -> Any:  # noqa: N802
        del context
        with self._lock:
            self._clear(self._tasks.pop(request.task.name, None))
        return messages.ClearTaskResponse()

    def _clear(self, task: _Task | None) -> None:
        """End what a removed task did: edges, sample clock, the plant's reading."""
        if task is None:
            return
        if task.tap is not None:
            self._plant.release(task.tap)
        if task.clock:
            self._epoch_tick = None
            self._plant.counting(False)
        if not self._tasks:
            self._plant.reading(False)

    def clear_of(self, client: str | None = None) -> None:
        """End every task of a client that has disconnected, or of all clients."""
        with self._lock:
            gone = [task for task in self._tasks.values() if client in (None, task.client)]
            for task in gone:
                self._clear(self._tasks.pop(task.name))

    def CreateCIPeriodChan(self, request: Any, context: Any) -> Any:  # noqa: N802
        task = self._task(request, context)
        wired = self._wired(request.counter, context)
        task.channel = request.counter
        task.tap = self._plant.tap_edges(wired)
        return messages.CreateCIPeriodChanResponse()

    def CreateCIAngEncoderChan(self, request: Any, context: Any) -> Any:  # noqa: N802
        task = self._task(request, context)
        side: Side = "input" if self._wired(request.counter, context) == "input" else "output"
        task.channel = request.counter
        task.tap = self._plant.tap_angles(side)
        return messages.CreateCIAngEncoderChanResponse()

    def CreateCOPulseChanFreq(self, request: Any, context: Any) -> Any:  # noqa: N802
        """Make a task the sample clock of a frequency."""
        task = self._task(request, context)
        if not 0.0 < request.freq <= self._timebase_hz / 4.0:
            self._fail(context, WRONG_VALUE)
        task.channel = request.counter
        task.clock, task.rate_hz = True, request.freq
        return messages.CreateCOPulseChanFreqResponse()

    def CfgImplicitTiming(self, request: Any, context: Any) -> Any:  # noqa: N802
        self._task(request, context).buffer = int(request.samps_per_chan) or DEFAULT_BUFFER
        return messages.CfgImplicitTimingResponse()

    def CfgSampClkTiming(self, request: Any, context: Any) -> Any:  # noqa: N802
        """Set a task's sample rate and buffer."""
        task = self._task(request, context)
        if not 0.0 < request.rate <= self._timebase_hz:
            self._fail(context, WRONG_VALUE)
        task.rate_hz = request.rate
        task.buffer = int(request.samps_per_chan) or DEFAULT_BUFFER
        return messages.CfgSampClkTimingResponse()

    def SetTrigAttributeInt32(self, request: Any, context: Any) -> Any:  # noqa: N802
        self._task(request, context)
        return messages.SetTrigAttributeInt32Response()

    def SetTrigAttributeString(self, request: Any, context: Any) -> Any:  # noqa: N802
        self._task(request, context)
        return messages.SetTrigAttributeStringResponse()

    def StartTask(self, request: Any, context: Any) -> Any:  # noqa: N802
        """Start a task; the sample clock's first pulse starts the time of all others."""
        task = self._task(request, context)
        with self._lock:
            others = [each for each in self._tasks.values() if each is not task]
            if any(each.started and each.channel == task.channel for each in others):
                self._fail(context, RESERVED)
            task.started = True
        if task.clock:  # its first pulse arms all others, on the encoders' millisecond grid
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
        self._task(request, context).started = False
        return messages.StopTaskResponse()

    # -- attributes -------------------------------------------------------------------------

    def GetDeviceAttributeUInt32(self, request: Any, context: Any) -> Any:  # noqa: N802
        del context
        serial_requested = request.attribute_raw == ATTRIBUTE_SERIAL
        serial = self._serial ^ (0xFFFFFFFF if self._faults.lying else 0)
        return messages.GetDeviceAttributeUInt32Response(value=serial if serial_requested else 0)

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
        """Return the number of waiting samples; fail after an overrun."""
        task = self._task(request, context)
        with self._lock:
            self._fill(task)
            if task.overrun:
                self._fail(context, OVERRUN)
            return messages.GetReadAttributeUInt32Response(value=int(task.waiting.size))

    def GetSystemInfoAttributeUInt32(self, request: Any, context: Any) -> Any:  # noqa: N802
        """Return the version of the driver, which the client checks."""
        del request, context
        return messages.GetSystemInfoAttributeUInt32Response(value=DRIVER_VERSION)

    def GetErrorString(self, request: Any, context: Any) -> Any:  # noqa: N802
        del context
        text = MESSAGES.get(request.error_code, f"NI-DAQmx error {request.error_code} (simulated)")
        return messages.GetErrorStringResponse(error_string=text)

    # -- reading ----------------------------------------------------------------------------

    def _fill(self, task: _Task) -> None:
        """Append the plant's new data, from the first pulse on."""
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
            if self._faults.scale != 1.0:
                fresh = np.rint(self._faults.scale * fresh)
            task.waiting = np.concatenate((task.waiting, fresh.astype(np.int32).view(np.uint32)))
        task.overrun |= task.waiting.size > task.buffer

    def ReadCounterU32Ex(self, request: Any, context: Any) -> Any:  # noqa: N802
        """Return the wanted samples of a task as soon as they exist."""
        task = self._task(request, context)
        if not task.started:
            self._fail(context, NOT_STARTED)
        timeout_s = LONGEST_WAIT_S if request.timeout < 0.0 else request.timeout
        count = self._await(task, request.num_samps_per_chan, timeout_s, context)
        if task.name not in self._tasks:  # ended meanwhile
            self._fail(context, NO_SUCH_TASK)
        with self._lock:
            if task.overrun:
                self._fail(context, OVERRUN)
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

    def _await(self, task: _Task, count: int, timeout_s: float, context: Any) -> int:
        """Wait for a number of samples in the plant's time; return the number of requested ones."""
        age_s = self._faults.age_s()
        if count == ALL_THERE_ARE:
            timeout_s = 0.0
        elif isinstance(task.tap, AngleTap) and self._epoch_tick is not None:
            due_s = self._epoch_tick / self._timebase_hz + (task.read + count) / task.rate_hz
            if due_s - self._plant.now_s <= timeout_s:
                self._plant.require(due_s + age_s, timeout_s + age_s)
        deadline_s = self._plant.now_s + timeout_s
        while True:
            with self._lock:
                self._fill(task)
                there = task.waiting.size
            if count == ALL_THERE_ARE:
                return int(there)
            left_s = deadline_s - self._plant.now_s
            if there >= count or task.overrun or left_s <= 1e-9 or not context.is_active():
                return count
            step_s = min(WAIT_STEP_S, left_s)
            if not self._plant.require(self._plant.now_s + step_s, LONGEST_WAIT_S):
                return count

    def _standing(self, task: _Task, taken: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Return a number of samples with the values at the time of the freeze."""
        if task.frozen is None or task.frozen.size == 0:
            task.frozen = taken[-1:].copy()
        return np.repeat(task.frozen, taken.size)[: taken.size]


class _Spoiler(grpc.ServerInterceptor):
    """Interceptor that causes the injected faults in answers, below the service."""

    def __init__(self, faults: WireFaults) -> None:
        self._faults = faults

    def intercept_service(self, continuation: Callable[[Any], Any], details: Any) -> Any:
        """Wrap the call."""
        handler = continuation(details)
        if handler is None or handler.unary_unary is None:
            return handler
        faults = self._faults

        def spoilt(request: Any, context: Any) -> Any:
            """Answer with what the misbehaviour makes of the answer: altered, late or lost."""
            answer = handler.unary_unary(request, context)
            data = faults.outgoing(handler.response_serializer(answer))
            if data is None:  # as if the answer was lost
                threading.Event().wait(context.time_remaining() or 0.0)
                context.abort(grpc.StatusCode.DEADLINE_EXCEEDED, "no answer")
            return data

        return grpc.unary_unary_rpc_method_handler(
            spoilt, request_deserializer=handler.request_deserializer
        )


class DaqmxSimulator(LineServer):
    """The device server on a TCP port.

    gRPC doesn't tell its service that a client has disconnected. Clients are therefore forwarded to
    it one by one, so that their tasks end with the connection, as with a local driver.

    Parameters
    ----------
    wiring : dict of counter to channel or side
        Such as `{"Dev1/ctr0": "input_torque", "Dev1/ctr4": "input"}`.
    host, port
        With port 0, a free port is chosen, which `port` then holds.
    """

    def __init__(
        self, plant: Plant, wiring: dict[str, str], faults: WireFaults, host: str, port: int
    ) -> None:
        self._servicer = _Servicer(plant, wiring, faults)
        self._pool = futures.ThreadPoolExecutor(THREADS, thread_name_prefix="simulated-daqmx")
        together = threading.Barrier(THREADS)
        for _ in range(THREADS):  # the pool's threads live as long as the server
            self._pool.submit(together.wait)
        self._server = grpc.server(self._pool, interceptors=[_Spoiler(faults)])
        services.add_NiDAQmxServicer_to_server(self._servicer, self._server)
        self._inner = "127.0.0.1", self._server.add_insecure_port("127.0.0.1:0")
        self._server.start()
        try:
            super().__init__(faults, host, port)
        except BaseException:
            self._end()
            raise

    def attend(self, connection: socket.socket) -> None:
        """Forward one client's bytes until it disconnects, then end its tasks."""
        with socket.create_connection(self._inner) as inner:
            inner.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            host, port = inner.getsockname()
            back = threading.Thread(target=_pass_on, args=(inner, connection), daemon=True)
            back.start()
            _pass_on(connection, inner)
            back.join()
        self._servicer.clear_of(f"ipv4:{host}:{port}")

    def _end(self) -> None:
        self._server.stop(0.0).wait()
        self._servicer.clear_of()
        self._pool.shutdown()

    def close(self) -> None:
        """End the server. A second call does nothing."""
        super().close()
        self._end()


def _pass_on(source: socket.socket, target: socket.socket) -> None:
    """Forward bytes until one side closes; then close both."""
    with contextlib.suppress(OSError):
        while data := source.recv(65536):
            target.sendall(data)
    for connection in (source, target):
        with contextlib.suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)
