"""A simulated CiA 402 drive: state machine, profile torque and velocity, NMT, heartbeats, EMCY."""

from __future__ import annotations

import math
import time
import zlib
from typing import Any

import canopen

from torquebench.bench.drivers import cia402
from torquebench.bench.roles import Side
from torquebench.simulators.misbehaviour import WireFaults
from torquebench.simulators.plant import Plant
from torquebench.units import MS_PER_S, RPM_PER_RAD_S

VOLTAGE_ENABLED, TARGET_REACHED = 0x010, 0x400
COMMUNICATION_ERROR = 0x11
"""Error register: generic and communication."""
SENDS_BOOT_UP, ENTERS_PRE_OPERATIONAL = 129, 128
VALUE_NOT_ALLOWED, VALUE_TOO_HIGH, VALUE_TOO_LOW = 0x06090030, 0x06090031, 0x06090032
QUICK_STOP_S = 0.1
STATUS = {name: value for _, value, name in cia402.STATES}
HEARTBEAT_ERROR, NMT_ERROR = 0x8130, 0x8100
RAMPS = (
    cia402.TORQUE_SLOPE,
    cia402.ACCELERATION,
    cia402.DECELERATION,
    cia402.QUICK_STOP_DECELERATION,
)


def serial_number(serial: str) -> int:
    """Return the number for a serial in a CANopen identity: the serial itself, if numeric."""
    return int(serial) if serial.isdigit() else zlib.crc32(serial.encode())


class Cia402Node:
    """One drive of the simulated bench as a node on a CANopen bus.

    Parameters
    ----------
    side : {"input", "output"}
    faults : WireFaults
        Faults such as freezing and lying.
    """

    def __init__(
        self,
        plant: Plant,
        side: Side,
        node: int,
        velocity_units_per_rpm: float,
        faults: WireFaults,
    ) -> None:
        module = plant.description.module(side)
        self._plant = plant
        self._side: Side = side
        self._drive = plant.bench.drives[side]
        self._units = velocity_units_per_rpm * RPM_PER_RAD_S
        self._faults = faults
        self._drive.watchdog_s = math.inf
        self._rated_nm = module.range_nm / 5.0
        self._maximum = 1.2 * module.limits.torque_nm, 1.2 * module.limits.speed_rpm
        self._state = "switch on disabled"
        self._emergency = self._sent_code = 0
        self._consumed: tuple[int, float] | None = None
        self._next: tuple[float, str] | None = None
        self._booted: float | None = None
        self._power_up()
        self._frozen: dict[int, int] = {}
        self.node = canopen.LocalNode(node, cia402.load_dictionary())
        self._identity = {1: 0x0, 2: 0x192, 3: 0x10000, 4: serial_number(module.drive.serial)}
        self.node.add_read_callback(self._read)
        self.node.add_write_callback(self._written)

    def _power_up(self) -> None:
        """Begin as after switching on: no mode, no set points."""
        self._mode = self._word = 0
        self._targets = {cia402.TARGET_TORQUE: 0, cia402.TARGET_VELOCITY: 0}
        self._ramps = dict.fromkeys(RAMPS, 1)

    # -- on the bus -------------------------------------------------------------------------

    def join(self, network: Any) -> None:
        """Boot on this bus: answer SDO requests unless stopped, and follow NMT commands."""
        network.add_node(self.node)
        sdo = self.node.sdo
        network.unsubscribe(sdo.rx_cobid, sdo.on_request)
        network.subscribe(sdo.rx_cobid, self._asked)
        network.subscribe(0, self._managed)
        self._network = network
        self._boot()

    def _boot(self) -> None:
        self.node.nmt.send_command(SENDS_BOOT_UP)
        self.node.nmt.send_command(ENTERS_PRE_OPERATIONAL)

    def _asked(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Answer a request for an object, unless the node is stopped."""
        if self.node.nmt.state not in ("STOPPED", "INITIALISING"):
            self.node.sdo.on_request(can_id, data, timestamp)

    def _managed(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Handle an NMT command; the node's state has already changed."""
        del can_id, timestamp
        if len(data) < 2 or data[1] not in (0, self.node.id) or self._faults.ignoring:
            return
        with self._plant.lock:
            if data[0] in (129, 130):
                self._consume(0)
                self.node.data_store.clear()
                if data[0] == 129:
                    self._off("switch on disabled")
                    self._power_up()
                self._boot()
            elif data[0] in (2, 128) and self._drive.state().enabled:
                self._off("fault")
                self._emergency = NMT_ERROR

    def _consume(self, value: int) -> None:
        """Monitor the heartbeat of object 0x1016, from the first one on."""
        master, period_s = value >> 16, (value & 0xFFFF) / MS_PER_S
        if master > 127:
            raise canopen.SdoAbortedError(VALUE_NOT_ALLOWED)
        if self._consumed is not None:
            self._network.unsubscribe(0x700 + self._consumed[0], self._fed)
        self._drive.watchdog_s, self._consumed = math.inf, None
        if master and period_s:
            self._consumed = master, period_s
            self._network.subscribe(0x700 + master, self._fed)

    def _fed(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Feed the drive's watchdog by a heartbeat of the bench."""
        del can_id, data, timestamp
        if self._consumed is not None and self._stored(cia402.ABORT_OPTION) != 0:
            self._drive.watchdog_s = self._consumed[1]
        self._drive.feed_watchdog()

    def tick(self) -> None:
        """Send an emergency message when a fault has occurred or is over."""
        with self._plant.lock:
            state = self._drive.state()
            self._follow(state.enabled, bool(state.fault))
            code = self._error_code()
        if code == self._sent_code:
            return
        self._sent_code = code
        if code:
            self.node.emcy.send(code, COMMUNICATION_ERROR)
        else:
            self.node.emcy.reset()

    def _error_code(self) -> int:
        if self._state != "fault":
            return 0
        return self._emergency or HEARTBEAT_ERROR

    # -- read by a client -------------------------------------------------------------------

    def _read(self, index: int, subindex: int, od: Any) -> int | str | None:
        """Return an object's value; while frozen, the value that it had then."""
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
        """Return an object's present value from the drive's state, with the faults on command."""
        state = self._drive.state()
        self._follow(state.enabled, bool(state.fault))
        lying = self._faults.lying
        if index == cia402.STATUSWORD:
            state_name = self._state
            if lying:
                enabled = state_name == "operation enabled"
                state_name = "switch on disabled" if enabled else "operation enabled"
            reached = 0 if self._drive.ramping else TARGET_REACHED
            remote = 0 if self._faults.local else cia402.REMOTE
            return STATUS[state_name] | VOLTAGE_ENABLED | remote | reached
        scale = 1.0 / max(self._faults.scale, 1e-9)
        torque, speed = scale * (state.torque_nm or 0.0), scale * (state.speed_rad_s or 0.0)
        values = {
            0x1001: COMMUNICATION_ERROR if self._error_code() else 0,
            cia402.ERROR_CODE: self._error_code(),
            cia402.CONTROLWORD: self._word,
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
        """Update the state after the drive's watchdog has tripped."""
        self._arrive()
        enabled = enabled or self._drive.state().enabled
        if fault and self._state != "fault":
            self._state = "fault"
        elif not enabled and self._state == "operation enabled":
            self._state = "switch on disabled"

    # -- written by a client ----------------------------------------------------------------

    def _written(self, index: int, subindex: int, od: Any, data: bytes) -> None:
        """Take a written object: refuse wrong values, and pursue the new mode or target."""
        value = int(od.decode_raw(data))
        if self._faults.not_yet:
            raise canopen.SdoAbortedError(cia402.NOT_IN_THIS_STATE)
        if self._faults.ignoring or (self._faults.local and index != cia402.HEARTBEAT_CONSUMER):
            return
        with self._plant.lock:
            if index == cia402.HEARTBEAT_CONSUMER and subindex:
                self._consume(value)
            elif index == cia402.ABORT_OPTION:
                _check(value, 0, 1)
            elif index == cia402.CONTROLWORD:
                self._control(value)
            elif index == cia402.MODE:
                if value not in (0, cia402.PROFILE_VELOCITY, cia402.PROFILE_TORQUE):
                    raise canopen.SdoAbortedError(VALUE_NOT_ALLOWED)
                self._mode = value
                self._pursue()
            elif index in self._ramps:
                _check(value, 1, cia402.LARGEST_SLOPE)
                self._ramps[index] = value
            elif index in self._targets:
                torque = index == cia402.TARGET_TORQUE
                highest = (
                    1e3 * self._maximum[0] / self._rated_nm
                    if torque
                    else self._maximum[1] * self._units / RPM_PER_RAD_S
                )
                _check(value, -math.ceil(highest), math.ceil(highest))
                self._targets[index] = value
                self._pursue()

    def _control(self, word: int) -> None:
        """Change the drive's state as its control word asks."""
        state = self._drive.state()
        self._follow(state.enabled, bool(state.fault))
        rising, self._word = word & ~self._word, word
        if self._state == "not ready to switch on":
            return
        if self._state == "fault":
            if rising & cia402.FAULT_RESET:
                self._drive.reset_fault()
                self._emergency = 0
                self._go("switch on disabled")
        elif not word & 0x02:
            self._off("switch on disabled")
        elif not word & 0x04:  # quick stop
            self._drive.ramp_to_zero(QUICK_STOP_S)
            self._state = "quick stop active" if state.enabled else "switch on disabled"
        elif word & 0x0F == cia402.SHUT_DOWN and self._state != "quick stop active":
            self._off("ready to switch on")
        elif word & 0x0F == cia402.SWITCH_ON and self._state in (
            "ready to switch on",
            "operation enabled",
        ):
            self._off("switched on")
        elif word & 0x0F == cia402.ENABLE_OPERATION and self._state == "switched on":
            self._go("operation enabled")

    def _off(self, state: str) -> None:
        """Switch the power off and go to a state without it."""
        if self._drive.state().enabled:
            self._drive.disable()
        if state in ("switch on disabled", "fault"):
            self._state, self._next = state, None
        else:
            self._go(state)

    def _go(self, state: str) -> None:
        """Enter a state, at once or after the delay of an injected fault."""
        if self._state != state:
            self._next = (time.monotonic() + self._faults.slowness_s, state)
            self._arrive()

    def _arrive(self) -> None:
        """Enter the state whose delay is over."""
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
                if any(self._targets.values()):
                    self._pursue()

    def _pursue(self) -> None:
        """Ramp to the target of the present mode."""
        if self._state != "operation enabled" or not self._drive.state().enabled:
            return
        scale = self._faults.scale
        if self._mode == cia402.PROFILE_TORQUE:
            torque_nm = self._targets[cia402.TARGET_TORQUE] * self._rated_nm / 1e3
            rate = self._ramps[cia402.TORQUE_SLOPE] * self._rated_nm / 1e3
            self._drive.command_torque(scale * torque_nm, rate)
        elif self._mode == cia402.PROFILE_VELOCITY:
            target = self._targets[cia402.TARGET_VELOCITY]
            present = abs(self._drive.state().speed_rad_s or 0.0) * self._units
            growing = abs(target) > present
            ramp = self._ramps[cia402.ACCELERATION if growing else cia402.DECELERATION]
            self._drive.command_speed(scale * target / self._units, ramp / self._units)

    def _stored(self, index: int) -> int:
        return int(self.node.object_dictionary[index].decode_raw(self.node.get_data(index, 0)))


def _check(value: int, lowest: int, highest: int) -> None:
    """Refuse an invalid value with its abort code."""
    if value > highest:
        raise canopen.SdoAbortedError(VALUE_TOO_HIGH)
    if value < lowest:
        raise canopen.SdoAbortedError(VALUE_TOO_LOW)
