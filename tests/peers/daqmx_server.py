"""A counter card behind the NI gRPC Device Server's service, by its own messages."""
# ruff: noqa: ARG002, N802 - names and parameters are the service's

import math
import threading
import time
from collections.abc import Callable
from concurrent import futures
from itertools import pairwise
from types import TracebackType
from typing import Any, NoReturn, Self

import grpc
import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2_grpc as services

TIMEBASE_HZ = 100_000_000
STEP_S, KEPT = 0.001, 2000
"""Distance of the times at which the phase of a changing frequency is known, and their number."""
RESERVED, NO_TASK, NO_CHANNEL = -50103, -200088, -200170


class _Task:
    def __init__(self) -> None:
        self.counter = ""
        self.kind = ""
        self.handed = 0
        self.rate_hz = 1000.0
        self.started = False
        self.inputs: list[tuple[str, str]] = []
        self.triggers: list[str] = []
        self.phases = [(0.0, 0.0)]
        self.seen_hz: float | None = None


class CounterCardPeer(services.NiDAQmxServicer):
    """Edges of `frequency_hz` on every channel, encoders that turn at `counts_per_s`.

    A callable `frequency_hz` gives the present frequency of a counter. Edge n comes at n / f,
    counted from the clock's first pulse. `inputs` are the volts, or mV/V, of the analogue inputs by
    their terminal, over the time.
    """

    def __init__(
        self,
        serial: int,
        frequency_hz: float | Callable[[str], float],
        counts_per_s: float,
        inputs: dict[str, Callable[[float], float]] | None = None,
    ) -> None:
        self.inputs = inputs or {}
        self.serial = serial
        self.frequency_hz = frequency_hz
        self.counts_per_s = counts_per_s
        self.counts: Callable[[str], float] | None = None  # present counts of an encoder
        self.tasks: dict[str, _Task] = {}
        self._begun: float | None = None
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        self._pool = futures.ThreadPoolExecutor(4)
        self._server = grpc.server(self._pool)
        services.add_NiDAQmxServicer_to_server(self, self._server)
        self.address = f"127.0.0.1:{self._server.add_insecure_port('127.0.0.1:0')}"
        self._server.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._server.stop(0.0).wait()
        self._pool.shutdown()

    def _fail(self, context: Any, code: int) -> NoReturn:
        context.set_trailing_metadata((("ni-error", str(code)),))
        context.abort(grpc.StatusCode.UNKNOWN, "failed")
        raise AssertionError

    def _task(self, request: Any, context: Any) -> _Task:
        task = self.tasks.get(request.task.name)
        if task is None:
            self._fail(context, NO_TASK)
        return task

    def _passed_s(self) -> float:
        return 0.0 if self._begun is None else time.monotonic() - self._begun

    def _there(self, task: _Task) -> int:
        """Return how many samples there have been since the clock began."""
        if task.kind == "period":
            if not callable(self.frequency_hz):
                return int(self._passed_s() * self.frequency_hz)
            now_s, found_hz = self._passed_s(), self.frequency_hz(task.counter)
            since_s, phase = task.phases[-1]
            before_hz = found_hz if task.seen_hz is None else task.seen_hz
            # A reader that comes late, or seldom, doesn't find a ramp in steps.
            passed_s = (now_s - since_s) * np.linspace(
                0.0, 1.0, 1 + math.ceil((now_s - since_s) / STEP_S)
            )[1:]
            mean_hz = before_hz + 0.5 * (found_hz - before_hz) * passed_s / (now_s - since_s)
            task.phases += zip(since_s + passed_s, phase + mean_hz * passed_s, strict=True)
            task.seen_hz = found_hz
            return int(task.phases[-1][1])
        if task.kind == "encoder" and self.counts is not None:
            task.phases.append((self._passed_s(), self.counts(task.counter)))
        return 0 if self._begun is None else int(self._passed_s() * task.rate_hz) + 1

    def GetSystemInfoAttributeUInt32(self, request: Any, context: Any) -> Any:
        return messages.GetSystemInfoAttributeUInt32Response(value=26)

    def GetDeviceAttributeString(self, request: Any, context: Any) -> Any:
        return messages.GetDeviceAttributeStringResponse(value="card of its own")

    def GetDeviceAttributeUInt32(self, request: Any, context: Any) -> Any:
        value = self.serial if request.attribute_raw == 0x632 else 0
        return messages.GetDeviceAttributeUInt32Response(value=value)

    def CreateTask(self, request: Any, context: Any) -> Any:
        self.tasks[request.session_name] = _Task()
        return messages.CreateTaskResponse(
            task={"name": request.session_name}, new_session_initialized=True
        )

    def ClearTask(self, request: Any, context: Any) -> Any:
        self.tasks.pop(request.task.name, None)
        return messages.ClearTaskResponse()

    def StopTask(self, request: Any, context: Any) -> Any:
        self._task(request, context).started = False
        return messages.StopTaskResponse()

    def CreateCIPeriodChan(self, request: Any, context: Any) -> Any:
        task = self._task(request, context)
        task.counter, task.kind = request.counter, "period"
        return messages.CreateCIPeriodChanResponse()

    def CreateCIAngEncoderChan(self, request: Any, context: Any) -> Any:
        task = self._task(request, context)
        task.counter, task.kind = request.counter, "encoder"
        return messages.CreateCIAngEncoderChanResponse()

    def CreateAIVoltageChan(self, request: Any, context: Any) -> Any:
        self._add_input(request, context, f"±{request.max_val:g} V")
        return messages.CreateAIVoltageChanResponse()

    def CreateAIBridgeChan(self, request: Any, context: Any) -> Any:
        unit = {15897: "mV/V", 15896: "V/V"}[request.units_raw]
        excited = f"{request.voltage_excit_val:g} V, {request.nominal_bridge_resistance:g} ohm"
        self._add_input(request, context, f"±{request.max_val:g} {unit} at {excited}")
        return messages.CreateAIBridgeChanResponse()

    def _add_input(self, request: Any, context: Any, setting: str) -> None:
        if request.physical_channel not in self.inputs:
            self._fail(context, NO_CHANNEL)
        task = self._task(request, context)
        task.counter, task.kind = "ai", "clock"
        task.inputs.append((request.physical_channel, setting))

    def CreateCOPulseChanFreq(self, request: Any, context: Any) -> Any:
        task = self._task(request, context)
        task.counter, task.kind = request.counter, "clock"
        return messages.CreateCOPulseChanFreqResponse()

    def CfgImplicitTiming(self, request: Any, context: Any) -> Any:
        self._task(request, context)
        return messages.CfgImplicitTimingResponse()

    def CfgSampClkTiming(self, request: Any, context: Any) -> Any:
        self._task(request, context).rate_hz = request.rate
        self._task(request, context).triggers.append(request.source)
        return messages.CfgSampClkTimingResponse()

    def SetTrigAttributeInt32(self, request: Any, context: Any) -> Any:
        return messages.SetTrigAttributeInt32Response()

    def SetTrigAttributeString(self, request: Any, context: Any) -> Any:
        self._task(request, context).triggers.append(request.value)
        return messages.SetTrigAttributeStringResponse()

    def StartTask(self, request: Any, context: Any) -> Any:
        task = self._task(request, context)
        with self._lock:
            others = [each for each in self.tasks.values() if each is not task and each.started]
            if any(each.counter == task.counter for each in others):
                self._fail(context, RESERVED)
            task.started = True
            if task.kind == "clock":
                self._begun = time.monotonic()
        return messages.StartTaskResponse()

    def GetChanAttributeDouble(self, request: Any, context: Any) -> Any:
        return messages.GetChanAttributeDoubleResponse(value=float(TIMEBASE_HZ))

    def GetTaskAttributeString(self, request: Any, context: Any) -> Any:
        value = self._task(request, context).counter
        return messages.GetTaskAttributeStringResponse(value=value)

    def GetTaskAttributeUInt32(self, request: Any, context: Any) -> Any:
        return messages.GetTaskAttributeUInt32Response(value=1)

    def GetReadAttributeUInt32(self, request: Any, context: Any) -> Any:
        task = self._task(request, context)
        return messages.GetReadAttributeUInt32Response(value=self._there(task) - task.handed)

    def _await(self, task: _Task, count: int, timeout_s: float) -> range | None:
        """Return the numbers of the next samples; None if they don't come in time."""
        deadline = time.monotonic() + timeout_s
        while self._there(task) - task.handed < count:
            if time.monotonic() > deadline:
                return None
            time.sleep(0.001)
        numbers = range(task.handed, task.handed + count)
        task.handed += count
        return numbers

    def _ticks(self, task: _Task, numbers: range) -> list[int]:
        """Return the times of edges."""
        if not callable(self.frequency_hz):
            return [round(n / self.frequency_hz * TIMEBASE_HZ) for n in numbers]
        times, phases = np.array(task.phases).T
        del task.phases[:-KEPT]
        found: list[int] = (
            np.rint(np.interp(numbers, phases, times) * TIMEBASE_HZ).astype(int).tolist()
        )
        return found

    def ReadAnalogF64(self, request: Any, context: Any) -> Any:
        task, count = self._task(request, context), request.num_samps_per_chan
        numbers = self._await(task, count, request.timeout)
        if numbers is None:
            return messages.ReadAnalogF64Response(status=-200284)
        values = [self.inputs[port](n / task.rate_hz) for port, _ in task.inputs for n in numbers]
        return messages.ReadAnalogF64Response(read_array=values, samps_per_chan_read=count)

    def ReadCounterU32Ex(self, request: Any, context: Any) -> Any:
        task, count = self._task(request, context), request.num_samps_per_chan
        numbers = self._await(task, count, request.timeout)
        if numbers is None:
            return messages.ReadCounterU32ExResponse(status=-200284)
        if task.kind == "period":
            ticks = self._ticks(task, range(numbers.start, numbers.stop + 1))
            values = [after - before for before, after in pairwise(ticks)]
        elif self.counts is None:
            values = [round(n / task.rate_hz * self.counts_per_s) % 2**32 for n in numbers]
        else:
            times_s, counts = np.array(task.phases).T
            del task.phases[:-KEPT]
            found = np.interp(np.array(numbers) / task.rate_hz, times_s, counts)
            values = [int(count) % 2**32 for count in np.rint(found)]
        return messages.ReadCounterU32ExResponse(
            status=0, read_array=values, samps_per_chan_read=count
        )
