"""Modbus images of the simulated bench: registers, coils and contacts."""

from __future__ import annotations

import math
import time
from abc import ABC
from collections.abc import Mapping

from torquebench.bench.drivers.modbus import register_map
from torquebench.bench.drivers.modbus.register_map import (
    Coil,
    Contact,
    DriveCommand,
    DriveControl,
    DriveMode,
    DriveReport,
    DriveStatus,
)
from torquebench.bench.roles import SIDES, Mode, Side
from torquebench.errors import TorquebenchError
from torquebench.simulators.misbehaviour import WireFaults
from torquebench.simulators.plant import Plant
from torquebench.units import MS_PER_S, RPM_PER_RAD_S

LIE_K = 20.0
LONGEST_ZERO_RAMP_S = 60.0
_MODES: tuple[Mode, ...] = ("free", "driven", "locked")


class Image(ABC):  # noqa: B024 - no instrument has every table
    """The registers and bits of one instrument by address; other addresses are illegal.

    Parameters
    ----------
    faults : WireFaults
        Injected faults of its values and actions.
    model, serial : str
        Model and serial number of the name plate.
    """

    def __init__(self, plant: Plant, faults: WireFaults, model: str, serial: str) -> None:
        self.plant = plant
        self.faults = faults
        texts = ["simulated", model, serial, "1.0"]
        words = [word for text in texts for word in register_map.from_text(text)]
        self.plate = {register_map.IDENTITY + offset: word for offset, word in enumerate(words)}

    def inputs(self) -> dict[int, int]:
        """Return input registers."""
        return {}

    def holding(self) -> dict[int, int]:
        """Return holding registers."""
        return {}

    def contacts(self) -> dict[int, int]:
        """Return discrete inputs."""
        return {}

    def coils(self) -> dict[int, int]:
        """Return coils."""
        return {}

    def written(self, address: int, values: list[int]) -> None:
        """Accept a write to holding registers, either completely or not at all.

        Raises
        ------
        IndexError
            There is no such register.
        ValueError
            A value that isn't allowed.
        """
        raise IndexError(address + len(values))

    def switched(self, address: int, values: list[int]) -> None:
        """Accept a write to coils, like `written`."""
        raise IndexError(address + len(values))


def _placed(words: Mapping[int, list[int]]) -> dict[int, int]:
    """Return words by the address of each, from blocks by their first address."""
    return {
        first + offset: word for first, block in words.items() for offset, word in enumerate(block)
    }


class DriveImage(Image):
    """A drive with torque and speed control, and a watchdog that is off until its time is set."""

    def __init__(self, plant: Plant, faults: WireFaults, side: Side) -> None:
        module = plant.description.module(side)
        super().__init__(plant, faults, "servo drive", module.drive.serial)
        self._side = side
        self._drive = plant.bench.drives[side]
        self._drive.watchdog_s = math.inf
        self._holding = [0] * (DriveCommand.WATCHDOG_TIME + 1)
        self._power_at = math.inf
        torque_nm = 1.2 * module.limits.torque_nm
        speed_rad_s = 1.2 * module.limits.speed_rpm / RPM_PER_RAD_S
        self._maximum = torque_nm, speed_rad_s
        rounded = 1.0 + 1e-6  # rounded to a 32-bit float
        self._allowed = {
            DriveCommand.TORQUE: (-rounded * torque_nm, rounded * torque_nm),
            DriveCommand.SPEED: (-rounded * speed_rad_s, rounded * speed_rad_s),
            DriveCommand.TORQUE_RATE: (1e-9, 1e9),
            DriveCommand.SPEED_RATE: (1e-9, 1e9),
            DriveCommand.ZERO_RAMP: (0.0, LONGEST_ZERO_RAMP_S),
        }

    def inputs(self) -> dict[int, int]:
        """Return status, set points, limits and position."""
        self._power_if_due()
        state, lying = self._drive.state(), self.faults.lying
        status = DriveStatus.ENABLED if state.enabled != lying else DriveStatus(0)
        if self._drive.ramping:
            status |= DriveStatus.RAMPING
        if state.fault:
            status |= DriveStatus.FAULT
            if "watchdog" in state.fault:
                status |= DriveStatus.WATCHDOG
        scale = 1.0 / max(self.faults.scale, 1e-9)
        torque, speed = scale * (state.torque_nm or 0.0), scale * (state.speed_rad_s or 0.0)
        words = {
            DriveReport.STATUS: [int(status), 1 if state.fault else 0],
            DriveReport.MODE: [self._holding[DriveCommand.MODE]],
            DriveReport.TORQUE: register_map.from_float(0.0 if lying else torque),
            DriveReport.SPEED: register_map.from_float(0.0 if lying else speed),
            DriveReport.MAXIMUM_TORQUE: register_map.from_float(self._maximum[0]),
            DriveReport.MAXIMUM_SPEED: register_map.from_float(self._maximum[1]),
            DriveReport.POSITION: register_map.from_integer(
                _wrapped(self.plant.counts(self._side))
            ),
        }
        reserved = dict.fromkeys(range(DriveReport.POSITION), 0)
        return reserved | _placed({int(address): block for address, block in words.items()})

    def holding(self) -> dict[int, int]:
        """Return the last written values."""
        return dict(enumerate(self._holding))

    def written(self, address: int, values: list[int]) -> None:
        """Execute the written commands, or refuse the whole request."""
        touched = range(address, address + len(values))
        if touched.stop > len(self._holding):
            raise IndexError(touched.stop)
        holding = list(self._holding)
        holding[touched.start : touched.stop] = values
        self._check(holding, touched)
        self._holding = holding
        if DriveCommand.WATCHDOG_TIME in touched:
            self._drive.watchdog_s = holding[DriveCommand.WATCHDOG_TIME] / MS_PER_S or math.inf
        if DriveCommand.WATCHDOG in touched:
            self._drive.feed_watchdog()
        if DriveCommand.CONTROL in touched:
            self._obey(DriveControl(holding[DriveCommand.CONTROL]))

    def _check(self, holding: list[int], touched: range) -> None:
        """Refuse written registers with unknown codes, numbers out of range, or half a number."""
        known = DriveControl.ENABLE | DriveControl.ZERO | DriveControl.RESET
        if holding[DriveCommand.CONTROL] & ~int(known):
            raise ValueError("control")
        DriveMode(holding[DriveCommand.MODE])
        for address, (lowest, highest) in self._allowed.items():
            written = {address, address + 1} & set(touched)
            if not written:
                continue
            value = register_map.float_of(holding[address : address + 2])
            if len(written) < 2 or not lowest <= value <= highest:
                raise ValueError(address.name)

    def _power_if_due(self) -> None:
        """Switch the drive on when its delay is over."""
        if time.monotonic() >= self._power_at:
            self._power_at = math.inf
            self._drive.enable()

    def _obey(self, control: DriveControl) -> None:
        """Obey a written control word: reset, power, ramp to zero, torque or speed."""
        self._power_if_due()
        state = self._drive.state()
        if control & DriveControl.RESET:
            self._power_at = math.inf
            self._drive.disable()
            self._drive.reset_fault()
            return
        if not control & DriveControl.ENABLE:
            self._power_at = math.inf
            if state.enabled:
                self._drive.disable()
            return
        if control & DriveControl.ZERO:
            self._drive.ramp_to_zero(self._number(DriveCommand.ZERO_RAMP))
            return
        mode, scale = self._holding[DriveCommand.MODE], self.faults.scale
        if mode == DriveMode.NONE and not state.enabled and not state.fault:
            self._power_at = min(self._power_at, time.monotonic() + self.faults.slowness_s)
            self._power_if_due()
        elif mode == DriveMode.TORQUE and state.enabled:
            torque_nm, rate = (
                self._number(address) for address in (DriveCommand.TORQUE, DriveCommand.TORQUE_RATE)
            )
            if rate > 0.0:
                self._drive.command_torque(scale * torque_nm, rate)
        elif mode == DriveMode.SPEED and state.enabled:
            speed_rad_s, rate = (
                self._number(address) for address in (DriveCommand.SPEED, DriveCommand.SPEED_RATE)
            )
            if rate > 0.0:
                self._drive.command_speed(scale * speed_rad_s, rate)

    def _number(self, command: DriveCommand) -> float:
        return register_map.float_of(self._holding[command : command + 2])


def _wrapped(counts: int) -> int:
    """Return counts as the device's signed number of 32 bits, which wraps around."""
    return (counts + 2**31) % 2**32 - 2**31


class ProbesImage(Image):
    """A module of temperature probes."""

    def __init__(self, plant: Plant, faults: WireFaults, probes: Mapping[str, int]) -> None:
        super().__init__(plant, faults, "probe module", "SIM-TEMP-1")
        self._probes = probes

    def inputs(self) -> dict[int, int]:
        """Return temperatures in hundredths of a degree."""
        present = self.plant.bench.temperatures()
        lie_k, scale = LIE_K if self.faults.lying else 0.0, self.faults.scale
        broken = register_map.PROBE_BROKEN % 65536
        stated = dict.fromkeys(range(max(self._probes.values()) + 1), broken)
        return stated | {
            address: round(100.0 * (scale * present[name] + lie_k)) % 65536
            for name, address in self._probes.items()
            if name in present
        }


class AnglesImage(Image):
    """Encoder positions."""

    def __init__(self, plant: Plant, faults: WireFaults, places: Mapping[str, int]) -> None:
        super().__init__(plant, faults, "encoder gateway", "SIM-GATE-1")
        self._places = places

    def inputs(self) -> dict[int, int]:
        """Return signed counts."""
        factor = -self.faults.scale if self.faults.lying else self.faults.scale
        age_s = self.faults.age_s()
        counts = {side: round(factor * self.plant.counts(side, age_s)) for side in SIDES}
        return _placed(
            {
                self._places[side]: register_map.from_integer(_wrapped(counts[side]))
                for side in SIDES
            }
        )


class ReadoutImage(Image):
    """A calibrator's amplifier."""

    def __init__(self, plant: Plant, faults: WireFaults) -> None:
        super().__init__(plant, faults, "torque amplifier", "SIM-AMP-1")

    def inputs(self) -> dict[int, int]:
        """Return both blocks of samples."""
        words: dict[int, list[int]] = {}
        factor = -self.faults.scale if self.faults.lying else self.faults.scale
        period_s = self.plant.window_s
        late = round(self.faults.age_s() / period_s)
        for number, side in enumerate(SIDES):
            count, torques = self.plant.torques(side)
            torques = torques[: len(torques) - late]
            held = torques[-register_map.READOUT_SAMPLES :]
            header = [*register_map.from_integer(max(0, count - late)), round(period_s * 1e6)]
            samples = [word for torque in held for word in register_map.from_float(factor * torque)]
            unused = [0] * (2 * register_map.READOUT_SAMPLES - len(samples))
            words[number * register_map.READOUT_STRIDE] = [*header, len(held), *samples, *unused]
        return _placed(words)


class DigitalImage(Image):
    """Mode conversion, clamp and guide rail, which move at once, and the supply's contact."""

    def __init__(self, plant: Plant, faults: WireFaults) -> None:
        super().__init__(plant, faults, "digital module", "SIM-IO-1")
        self._coils = [0] * len(Coil)
        self._coils[Coil.RAIL] = int(plant.bench.position() == "end")

    def coils(self) -> dict[int, int]:
        """Return the commanded values."""
        return dict(enumerate(self._coils))

    def contacts(self) -> dict[int, int]:
        """Return the position contacts."""
        bench, lying = self.plant.bench, self.faults.lying
        bits: dict[int, int] = {}
        for side, first in zip(SIDES, (Contact.INPUT_FREE, Contact.OUTPUT_FREE), strict=True):
            mode_number = _MODES.index(bench.mode(side))
            mode_number = (mode_number + 1) % 3 if lying else mode_number
            bits |= {first + offset: int(offset == mode_number) for offset in range(3)}
        clamped = bench.clamped() != lying
        bits[Contact.CLAMP_CLOSED] = bits[Contact.CLAMP_PRESSURE] = int(clamped)
        bits[Contact.CLAMP_OPEN] = int(not clamped)
        at_end = (bench.position() == "end") != lying
        bits[Contact.RAIL_END], bits[Contact.RAIL_AWAY] = int(at_end), int(not at_end)
        bits[Contact.SUPPLY_ON] = int(bench.supplies() != lying)
        return bits

    def switched(self, address: int, values: list[int]) -> None:
        """Move the parts whose coils were written."""
        touched = range(address, address + len(values))
        if touched.stop > len(self._coils):
            raise IndexError(touched.stop)
        coils = list(self._coils)
        coils[touched.start : touched.stop] = values
        pairs = dict(zip(SIDES, (Coil.INPUT_DRIVEN, Coil.OUTPUT_DRIVEN), strict=True))
        if any(coils[first] and coils[first + 1] for first in pairs.values()):
            raise ValueError("driven and locked")
        self._coils = coils
        bench = self.plant.bench
        for side, first in pairs.items():
            driven, locked = coils[first : first + 2]
            mode: Mode = "driven" if driven else "locked" if locked else "free"
            if (first in touched or first + 1 in touched) and bench.mode(side) != mode:
                bench.set_mode(side, mode)
        if Coil.RAIL in touched:
            bench.move("end" if coils[Coil.RAIL] else "away")
        if Coil.CLAMP in touched and bench.clamped() != bool(coils[Coil.CLAMP]):
            try:
                bench.set_clamped(bool(coils[Coil.CLAMP]))
            except TorquebenchError:
                self._coils[Coil.CLAMP] = int(bench.clamped())
