"""CiA 402 servo drives on EtherCAT (CoE) by `pysoem`: one cyclic thread for each network adapter.

Controlword, mode and set points go out, statusword, mode and position come back in every cycle;
all other objects are read by SDO. Each drive's process-data watchdog removes its power once the
cycles end, and they end when a drive that has power isn't fed.
"""

from __future__ import annotations

import contextlib
import struct
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from pydantic import Field

from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.cia402 import (
    CONTROLWORD,
    MODE,
    MODE_DISPLAY,
    POSITION,
    STATUSWORD,
    TARGET_TORQUE,
    TARGET_VELOCITY,
    TIMED_OUT,
    Cia402Drive,
    DriveOptions,
    ObjectLink,
)
from torquebench.bench.drivers.links import (
    LONGEST_TIME_OUT_S,
    POLL_S,
    WireError,
)
from torquebench.bench.drivers.plugins import DriverPlugin, InstrumentRequest, require_library
from torquebench.bench.roles import Side
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import MS_PER_S

OUTPUTS = {CONTROLWORD: "H", TARGET_TORQUE: "h", TARGET_VELOCITY: "i", MODE: "b"}
INPUTS = {STATUSWORD: "H", POSITION: "i", MODE_DISPLAY: "b"}
"""Objects in each cycle, with their formats: the drive's process data are set to these."""
RECEIVE_PDO, TRANSMIT_PDO, RECEIVE_ASSIGNED, TRANSMIT_ASSIGNED = 0x1600, 0x1A00, 0x1C12, 0x1C13
STALE_CYCLES, STALE_S = 10, 0.05
"""Cycles, and at least a time, after which inputs that didn't come back are no longer taken."""
STATE_TIME_US, ANSWER_US, KEPT_CYCLES = 50_000, 2_000, 10_000

Result = TypeVar("Result")


class EthercatOptions(DriveOptions):
    """One drive on a network: `position` counts the devices from the adapter on, from 0."""

    adapter: Annotated[str, Field(min_length=1, max_length=200)]
    position: Annotated[int, Field(ge=0, le=199)]
    cycle_s: Annotated[float, Field(ge=0.0005, le=0.02, description="s")] = 0.002


class Bus:
    """The drives on one network adapter, and the thread that exchanges their process data.

    Parameters
    ----------
    positions : tuple of int
        Positions of all drives; other devices keep their process data.
    half_watchdog_s : float
        Time without feeding after which the cycles end, and time without cycles after which a
        drive's watchdog acts.
    """

    _buses: ClassVar[dict[str, Bus]] = {}
    _opening: ClassVar[threading.Lock] = threading.Lock()

    def __init__(
        self, adapter: str, positions: tuple[int, ...], cycle_s: float, half_watchdog_s: float
    ) -> None:
        self._soem = require_library("pysoem", "ethercat")
        self._adapter, self._cycle_s, self._half_watchdog_s = adapter, cycle_s, half_watchdog_s
        self._users = 0
        self.lock = threading.RLock()
        self.out = {position: _nothing() for position in positions}
        self.fed_s: dict[int, float] = {}
        """When each drive that has power was fed."""
        self._completed_s = float("-inf")
        self._late_s: deque[float] = deque(maxlen=KEPT_CYCLES)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ethercat", daemon=True)
        self.master = self._soem.Master()
        try:
            self.master.open(adapter)
            self._configure(positions)
            self._thread.start()
            self.operate()
        except BaseException:
            self._end()
            raise

    @classmethod
    def shared(cls, adapter: str, *settings: Any) -> Bus:
        """Return the adapter's bus, opened if it isn't yet."""
        with cls._opening:
            bus = cls._buses.get(adapter)
            if bus is None or bus._ending.is_set():
                bus = cls._buses[adapter] = cls(adapter, *settings)
            bus._users += 1
            return bus

    def release(self) -> None:
        """End the cycles with the last user."""
        with self._opening:
            self._users -= 1
            if self._users > 0:
                return
            self._buses.pop(self._adapter, None)
            self._end()

    def _end(self) -> None:
        """End the cycles, and leave the devices without process data."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()
        with contextlib.suppress(Exception):  # the devices' watchdogs act in any case
            self.master.state = self._soem.INIT_STATE
            self.master.write_state()
        self.master.close()

    def _configure(self, positions: tuple[int, ...]) -> None:
        """Find all devices, set the drives' process data and watchdogs, and go to SAFE-OP."""
        count = self.master.config_init()
        if count <= max(positions):
            raise WireError(
                Message("{count} devices on {adapter}, none at position {position}",
                        max(count, 0), self._adapter, max(positions))
            )  # fmt: skip
        drives = [self.master.slaves[position] for position in positions]
        for drive in drives:
            drive.config_func = partial(_set_process_data, drive)
        self.master.config_map()
        wanted = self._soem.SAFEOP_STATE
        if self.master.state_check(wanted, 20 * STATE_TIME_US) != wanted:
            raise WireError(Message("devices on {adapter} don't reach SAFE-OP", self._adapter))
        for drive in drives:
            drive.set_watchdog("processdata", self._half_watchdog_s * MS_PER_S)

    def operate(self) -> None:
        """Bring all drives to the state OP, out of the state that a watchdog has left them in."""
        soem, deadline = self._soem, time.monotonic() + 20 * STATE_TIME_US / 1e6
        for position in tuple(self.out):
            device = self.master.slaves[position]
            while (state := device.state_check(soem.OP_STATE, STATE_TIME_US)) != soem.OP_STATE:
                if time.monotonic() > deadline:
                    raise WireError(self._not_operating(device))
                with self.lock:  # it has lost its power: its old set point is void
                    self.out[position] = _nothing()
                    self.fed_s.pop(position, None)
                failed = state & soem.STATE_ERROR
                device.state = soem.SAFEOP_STATE + soem.STATE_ACK if failed else soem.OP_STATE
                device.write_state()

    def restart(self, position: int) -> None:
        """Bring a drive to OP without power; if the cycles had ended, all drives."""
        with self.lock:
            now_s = time.monotonic()
            if any(now_s - fed_s >= self._half_watchdog_s for fed_s in self.fed_s.values()):
                self.out = {each: _nothing() for each in self.out}
                self.fed_s.clear()
            self.out[position] = _nothing()
            self.fed_s.pop(position, None)
        time.sleep(POLL_S)
        self.operate()

    def _not_operating(self, device: Any) -> str:
        reason = self._soem.al_status_code_to_string(device.al_status)
        return Message("{device} doesn't reach OP: {reason}", device.name, reason)

    @property
    def current(self) -> bool:
        """Whether the last cycles came back complete."""
        longest_s = max(STALE_CYCLES * self._cycle_s, STALE_S)
        return time.monotonic() - self._completed_s < longest_s

    def jitter(self) -> str:
        """Return how late the cycles began, for the record."""
        late_us = 1e6 * np.array(self._late_s or [np.nan])
        middle, most = np.percentile(late_us, [50.0, 99.0])
        return (
            f"{MS_PER_S * self._cycle_s:g} ms, late by {middle:.0f} µs (median), "
            f"{most:.0f} µs (99 %), {late_us.max():.0f} µs (most) in {late_us.size} cycles"
        )

    def _run(self) -> None:
        """Exchange process data in cycles while every drive's set points are fed."""
        due_s = time.monotonic()
        while not self._ending.is_set():
            late_s = time.monotonic() - due_s
            if late_s < 0.0:
                time.sleep(-late_s)
                late_s = max(time.monotonic() - due_s, 0.0)
            self._late_s.append(late_s)
            due_s = max(due_s + self._cycle_s, time.monotonic())
            longest_s = self._half_watchdog_s
            if all(time.monotonic() - fed_s < longest_s for fed_s in list(self.fed_s.values())):
                self._cycle()

    def _cycle(self) -> None:
        """Exchange process data once."""
        with self.lock:
            for position, values in self.out.items():
                self.master.slaves[position].output = b"".join(values.values())
        self.master.send_processdata(release_gil=True)
        complete = self.master.receive_processdata(ANSWER_US, release_gil=True)
        if complete >= self.master.expected_wkc:
            self._completed_s = time.monotonic()

    def input(self, position: int, index: int) -> int:
        """Return an object from the last cycle."""
        layout, data = "<" + "".join(INPUTS.values()), self.master.slaves[position].input
        return int(dict(zip(INPUTS, struct.unpack_from(layout, data), strict=True))[index])


def _nothing() -> dict[int, bytes]:
    """Return process data without power and set points."""
    return {index: bytes(struct.calcsize(layout)) for index, layout in OUTPUTS.items()}


def _set_process_data(device: Any, _position: int) -> None:
    """Map and assign a drive's process data (ETG.1000: 0x1600, 0x1A00, 0x1C12, 0x1C13)."""
    for pdo, assigned, objects in (
        (RECEIVE_PDO, RECEIVE_ASSIGNED, OUTPUTS),
        (TRANSMIT_PDO, TRANSMIT_ASSIGNED, INPUTS),
    ):
        device.sdo_write(assigned, 0, b"\0")
        device.sdo_write(pdo, 0, b"\0")
        for number, (index, layout) in enumerate(objects.items(), 1):
            bits = 8 * struct.calcsize(layout)
            device.sdo_write(pdo, number, struct.pack("<I", index << 16 | bits))
        device.sdo_write(pdo, 0, bytes([len(objects)]))
        device.sdo_write(assigned, 1, struct.pack("<H", pdo))
        device.sdo_write(assigned, 0, b"\1")


class EthercatLink(ObjectLink):
    """One drive on an EtherCAT network."""

    def __init__(
        self, name: str, options: EthercatOptions, positions: tuple[int, ...], watchdog_s: float
    ) -> None:
        timeout_s = LONGEST_TIME_OUT_S if options.timeout_s is None else options.timeout_s
        super().__init__(name, f"position {options.position} on {options.adapter}", timeout_s)
        self._soem = require_library("pysoem", "ethercat")
        self._options, self._positions, self._watchdog_s = options, positions, watchdog_s
        self._emergency = ""

    def _open(self) -> Bus:
        """Join the adapter's bus, which all drives on it share."""
        options, soem = self._options, self._soem
        try:
            bus = Bus.shared(
                options.adapter, self._positions, options.cycle_s, 0.5 * self._watchdog_s
            )
        except (soem.SdoError, soem.ConfigMapError, soem.MailboxError, soem.WkcError) as error:
            raise WireError(_in_words(error)) from error
        bus.master.sdo_read_timeout = bus.master.sdo_write_timeout = round(1e6 * self.timeout_s)
        self._device(bus).add_emergency_callback(self._note_emergency)
        return bus

    def _close(self, connection: Bus) -> None:
        connection.fed_s.pop(self._options.position, None)
        connection.release()

    def _device(self, bus: Bus) -> Any:
        return bus.master.slaves[self._options.position]

    def _note_emergency(self, message: Any) -> None:
        self._emergency = f"EMCY 0x{message.error_code:04X}" if message.error_code else ""

    def exchange(self, ask: Callable[[Bus], Result], what: str) -> Result:
        """Communicate with the drive; `what` names the request in messages."""
        soem, canopen = self._soem, require_library("canopen", "ethercat")

        def question(bus: Bus) -> Result:
            """Return the drive's answer to a question; translate the library's errors."""
            try:
                return ask(bus)
            except soem.SdoError as error:
                if error.abort_code == TIMED_OUT:
                    raise WireError(Message("{what}: {failure}", what, error.desc)) from error
                raise self.refused(what, error.desc, error.abort_code) from error
            except (soem.MailboxError, soem.PacketError, soem.WkcError) as error:
                raise WireError(Message("{what}: {failure}", what, _in_words(error))) from error
            except (struct.error, ValueError, canopen.ObjectDictionaryError) as error:
                raise WireError(Message("{what}: garbled answer ({error})", what, error)) from error

        return self.call(question)

    def upload(self, connection: Bus, index: int, subindex: int) -> Any:
        """Return an object's value, from the last cycle if that came back and has it."""
        if index in INPUTS and connection.current:
            return connection.input(self._options.position, index)
        data = self._device(connection).sdo_read(index, subindex, release_gil=True)
        return self.variable(index, subindex).decode_raw(data)

    def download(self, connection: Bus, index: int, subindex: int, value: int) -> None:
        """Write an object's value, by the next cycle if it has it and the cycles come back."""
        if index in OUTPUTS:
            data = struct.pack(f"<{OUTPUTS[index]}", value)
            with connection.lock:
                connection.out[self._options.position][index] = data
            if connection.current:
                time.sleep(2.0 * self._options.cycle_s)  # until the drive has it
                return
            if index in (TARGET_TORQUE, TARGET_VELOCITY):
                return  # without cycles its watchdog removes the power: no set point beside them
        data = self.variable(index, subindex).encode_raw(value)
        self._device(connection).sdo_write(index, subindex, data, release_gil=True)

    def beat(self) -> None:
        """Let the cycles go on for the watchdog's time."""

        def ask(bus: Bus) -> None:
            if self._options.position in bus.fed_s:
                bus.fed_s[self._options.position] = time.monotonic()

        self.exchange(ask, "to feed its watchdog")

    def start_node(self) -> None:
        """Bring the drive to the state OP."""
        self.exchange(lambda bus: bus.restart(self._options.position), "to start the device")

    def watch(self, write: Callable[[int, int, int], None], watchdog_s: float) -> None:
        """Make the cycles depend on feeding; the drive's own watchdog was set at the opening."""
        del write, watchdog_s

        def ask(bus: Bus) -> None:
            bus.fed_s[self._options.position] = time.monotonic()

        self.exchange(ask, "to start its watchdog")

    def rest(self) -> None:
        """Let the cycles go on without feeding, as the drive has no power."""
        self.exchange(
            lambda bus: bus.fed_s.pop(self._options.position, None), "to end its watchdog"
        )

    def emergency(self) -> str:
        """Return the last emergency message (EMCY) that wasn't reset; empty without one."""
        self.exchange(lambda bus: self._device(bus).mbx_receive(), "to read its emergencies")
        return self._emergency

    def jitter(self) -> str:
        """Return how late the cycles began."""
        return self.exchange(lambda bus: bus.jitter(), "to read its cycles")


def _in_words(error: Exception) -> str:
    """Return the text of an error of the library, which keeps it in attributes."""
    return str(getattr(error, "desc", "") or str(error) or type(error).__name__)


class EthercatDrive(Cia402Drive):
    """A CiA 402 drive whose set points are process data."""

    _link: EthercatLink

    def identity(self) -> Identity:
        """Read the drive's identity, and how late the cycles began."""
        found = super().identity()
        return replace(found, details={**found.details, "cycle": self._link.jitter()})

    def disable(self) -> None:
        """Switch off the motor's power; the cycles go on."""
        super().disable()
        self._link.rest()


def _drive(request: InstrumentRequest) -> EthercatDrive:
    """Open a side's drive, with a time-out that its watchdog allows."""
    assert request.side is not None
    options: EthercatOptions = request.read(EthercatOptions)
    watchdog_s, timeout_s = request.drive_times(options.timeout_s)
    options = options.model_copy(update={"timeout_s": timeout_s})
    positions, shortest_s = _on_adapter(request, options.adapter)
    with EthercatLink(request.name, options, positions, shortest_s).kept() as link:
        return EthercatDrive(link, request.side, options, watchdog_s)


def _on_adapter(request: InstrumentRequest, adapter: str) -> tuple[tuple[int, ...], float]:
    """Return the positions of all drives on an adapter, and their shortest watchdog time.

    Raises
    ------
    InputError
        Two drives have the same position.
    """
    positions: list[int] = []
    watchdogs_s: list[float] = []
    sides: tuple[Side, ...] = ("input", "output")
    for side in sides:
        section = request.description.driver.get(f"{side}_drive", {})
        if section.get("protocol") == "ethercat" and section.get("adapter") == adapter:
            positions.append(int(section.get("position", 0)))
            watchdogs_s.append(request.description.module(side).drive.watchdog_s)
    if len(set(positions)) < len(positions):
        raise InputError(
            Message("both drives at position {position} on {adapter}", positions[0], adapter),
            "a position of its own for each drive",
            "correct `position` in the sections of the drives",
        )
    return tuple(positions), min(watchdogs_s)


PLUGIN = DriverPlugin("ethercat", {"drive": _drive})
"""Plug-in for `protocol = "ethercat"`."""
