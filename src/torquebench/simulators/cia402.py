"""A simulated CiA 402 drive: state machine, profile torque and velocity, heartbeat consumer."""

from __future__ import annotations

import struct
import time
import zlib
from typing import Any

import canopen

from torquebench.bench.drivers import cia402
from torquebench.bench.drivers.base import Side
from torquebench.simulators.misbehaviour import WireFaults
from torquebench.simulators.plant import Plant
from torquebench.units import RPM_PER_RAD_S

__all__ = ["Cia402Node", "serial_number"]

VOLTAGE_ENABLED = 0x10
STATUS = {name: value for _, value, name in cia402.STATES}
HEARTBEAT_ERROR = 0x8130


def serial_number(serial: str) -> int:
    """Return the number that a CANopen identity can hold for a serial: itself where it is one."""
    return int(serial) if serial.isdigit() else zlib.crc32(serial.encode())


class Cia402Node:
    """One drive of the simulated bench as a node on a CANopen bus.

    Parameters
    ----------
    plant : Plant
    side : {"input", "output"}
    node : int
    master : int
        Whose heartbeat feeds the watchdog.
    velocity_units_per_rpm : float
    faults : WireFaults
        For freezing and lying.
    """

    def __init__(
        self,
        plant: Plant,
        side: Side,
        node: int,
        master: int,
        velocity_units_per_rpm: float,
        faults: WireFaults,
    ) -> None:
        module = plant.description.module(side)
        self._plant = plant
        self._side: Side = side
        self._drive = plant.bench.drives[side]
        self._units = velocity_units_per_rpm * RPM_PER_RAD_S
        self._faults = faults
        self._master = master
        self._rated_nm = module.range_nm / 5.0
        self._maximum = 1.2 * module.limits.torque_nm, 1.2 * module.limits.speed_rpm
        self._state = "switch on disabled"
        self._mode = 0
        self._word = 0
        self._next: tuple[float, str] | None = None
        self._booted: float | None = None
        self._frozen: dict[int, int] = {}
        self.node = canopen.LocalNode(node, cia402.load_dictionary())
        self._identity = {1: 0x0, 2: 0x192, 3: 0x10000, 4: serial_number(module.drive.serial)}
        self.node.add_read_callback(self._read)
        self.node.add_write_callback(self._written)

    def join(self, network: Any) -> None:
        """Listen for the master's heartbeat on this bus."""
        network.subscribe(0x700 + self._master, self._fed)

    def _fed(self, can_id: int, data: bytearray, timestamp: float) -> None:
        del can_id, data, timestamp
        self._drive.feed_watchdog()

    # -- what a client reads ----------------------------------------------------------------

    def _read(self, index: int, subindex: int, od: Any) -> int | str | None:
        del od
        if index == cia402.IDENTITY and subindex:
            return self._identity[subindex]
        if index == 0x1008:
            return "simulated servo drive"
        if index == 0x100A:
            return "1.0"
        with self._plant.lock:
            value = self._value(index)
        if value is None:
            return None
        if self._faults.frozen:
            return self._frozen.setdefault(index, value)
        self._frozen.pop(index, None)
        return value

    def _value(self, index: int) -> int | None:
        state = self._drive.state()
        self._follow(state.enabled, bool(state.fault))
        lying = self._faults.lying
        if index == cia402.STATUSWORD:
            shown = self._state
            if lying:
                enabled = shown == "operation enabled"
                shown = "switch on disabled" if enabled else "operation enabled"
            return STATUS[shown] | VOLTAGE_ENABLED
        torque, speed = state.torque_nm or 0.0, state.speed_rad_s or 0.0
        values = {
            cia402.ERROR_CODE: HEARTBEAT_ERROR if state.fault else 0,
            cia402.MODE_DISPLAY: self._mode,
            cia402.TORQUE_DEMAND: 0 if lying else round(1e3 * torque / self._rated_nm),
            0x6077: round(1e3 * torque / self._rated_nm),
            cia402.VELOCITY_DEMAND: 0 if lying else round(speed * self._units),
            0x606C: round(speed * self._units),
            cia402.RATED_TORQUE: round(1e3 * self._rated_nm),
            cia402.MAXIMUM_TORQUE: round(1e3 * self._maximum[0] / self._rated_nm),
            cia402.MAXIMUM_SPEED: round(self._maximum[1]),
            0x6064: (self._plant.counts(self._side) + 2**31) % 2**32 - 2**31,
        }
        return values.get(index)

    def _follow(self, enabled: bool, fault: bool) -> None:
        """Take over what the drive has done by itself: its watchdog has acted."""
        self._arrive()
        enabled = enabled or self._drive.state().enabled
        if fault and self._state != "fault":
            self._state = "fault"
        elif not enabled and self._state == "operation enabled":
            self._state = "switch on disabled"

    # -- what a client writes ---------------------------------------------------------------

    def _written(self, index: int, subindex: int, od: Any, data: bytes) -> None:
        del subindex
        if index == 0x1017:
            return
        value = int(od.decode_raw(data))
        with self._plant.lock:
            if self._faults.ignoring:
                return
            if index == cia402.CONTROLWORD:
                self._control(value)
            elif index == cia402.MODE:
                self._switch_mode(value)
            elif self._drive.state().enabled:
                self._target(index, value)

    def _switch_mode(self, mode: int) -> None:
        """Control another quantity, from now on towards the target that is stored for it."""
        changed, self._mode = mode != self._mode, mode
        if changed and self._drive.state().enabled:
            self._follow_targets()

    def _follow_targets(self) -> None:
        for index, layout in ((cia402.TARGET_TORQUE, "<h"), (cia402.TARGET_VELOCITY, "<i")):
            self._target(index, self._stored(index, layout))

    def _control(self, word: int) -> None:
        state = self._drive.state()
        self._follow(state.enabled, bool(state.fault))
        resets = bool(word & ~self._word & cia402.FAULT_RESET)  # by its rising edge only
        self._word = word
        if self._state == "not ready to switch on":
            return
        if self._state == "fault":
            if resets:
                self._drive.disable()
                self._drive.enable()  # forgets the fault
                self._drive.disable()
                self._go("switch on disabled")
        elif not word & 0x02:
            self._off("switch on disabled")
        elif not word & 0x04:  # quick stop
            self._drive.ramp_to_zero(0.1)
            self._state = "quick stop active" if state.enabled else "switch on disabled"
        elif word & 0x0F == cia402.SHUT_DOWN:
            self._off("ready to switch on")
        elif word & 0x0F == cia402.SWITCH_ON and self._state != "switch on disabled":
            self._off("switched on")
        elif word & 0x0F == cia402.ENABLE_OPERATION and self._state == "switched on":
            self._go("operation enabled")

    def _off(self, state: str) -> None:
        if self._drive.state().enabled:
            self._drive.disable()
        if state == "switch on disabled":
            self._state, self._next = state, None
        else:
            self._go(state)

    def _go(self, state: str) -> None:
        """Go to a state: at once, or as slowly as ordered."""
        if self._state != state:
            self._next = (time.monotonic() + self._faults.slowness_s, state)
            self._arrive()

    def _arrive(self) -> None:
        """Take over the state that is due."""
        slowness_s = self._faults.slowness_s
        if not slowness_s:
            self._booted = None
            if self._state == "not ready to switch on":
                self._state = "switch on disabled"
        elif self._booted is None and self._state == "switch on disabled":
            self._booted, self._state = time.monotonic(), "not ready to switch on"
            self._next = (self._booted + slowness_s, "switch on disabled")
        if self._next is not None and time.monotonic() >= self._next[0]:
            self._state, self._next = self._next[1], None
            if self._state == "operation enabled":
                self._drive.enable()
                self._follow_targets()

    def _target(self, index: int, value: int) -> None:
        if index == cia402.TARGET_TORQUE and self._mode == cia402.PROFILE_TORQUE:
            slope = self._stored(cia402.TORQUE_SLOPE, "<I") * self._rated_nm / 1e3
            self._drive.command_torque(value * self._rated_nm / 1e3, max(slope, 1e-6))
        elif index == cia402.TARGET_VELOCITY and self._mode == cia402.PROFILE_VELOCITY:
            present = abs(self._drive.state().speed_rad_s or 0.0) * self._units
            growing = abs(value) > present
            ramp = self._stored(cia402.ACCELERATION if growing else cia402.DECELERATION, "<I")
            self._drive.command_speed(value / self._units, max(ramp / self._units, 1e-9))

    def _stored(self, index: int, layout: str) -> int:
        data = self.node.data_store.get(index, {}).get(0)
        return 0 if data is None else int(struct.unpack(layout, data)[0])
