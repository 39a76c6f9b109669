"""What a Modbus client sees of the simulated bench: registers, coils and contacts."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

from torquebench.bench.drivers import modbus_map as registers
from torquebench.bench.drivers.base import Mode, Side
from torquebench.bench.drivers.modbus_map import (
    Coil,
    Contact,
    DriveCommand,
    DriveControl,
    DriveMode,
    DriveReport,
    DriveStatus,
)
from torquebench.bench.roles import SIDES
from torquebench.errors import TorquebenchError
from torquebench.simulators.plant import Plant

__all__ = ["AnglesImage", "DigitalImage", "DriveImage", "Image", "ProbesImage", "ReadoutImage"]

LIE_K = 20.0
_MODES: tuple[Mode, ...] = ("free", "driven", "locked")


class Image(ABC):
    """One instrument's memory.

    Parameters
    ----------
    serial, model : str
        For the name plate.
    """

    def __init__(self, model: str, serial: str) -> None:
        plate = ["simulated", model, serial, "1.0"]
        self.plate = [word for text in plate for word in registers.from_text(text)]

    @abstractmethod
    def inputs(self, lying: bool) -> dict[int, int]:
        """Return input registers by address."""

    def contacts(self, lying: bool) -> dict[int, bool]:
        """Return discrete inputs by address."""
        del lying
        return {}

    def written(self, address: int, values: list[int]) -> None:  # noqa: B027 - may have none
        """Take what was written into holding registers."""

    def switched(self, address: int, values: list[bool]) -> None:  # noqa: B027 - may have none
        """Take what was written into coils."""


def _placed(words: Mapping[int, list[int]]) -> dict[int, int]:
    return {
        first + offset: word for first, block in words.items() for offset, word in enumerate(block)
    }


class DriveImage(Image):
    """A drive with torque and speed control.

    Parameters
    ----------
    plant : Plant
    side : {"input", "output"}
    slowness_s : callable
        How long it takes from the command to power to having it, s of wall time.
    """

    def __init__(
        self, plant: Plant, side: Side, slowness_s: Callable[[], float] = lambda: 0.0
    ) -> None:
        module = plant.description.module(side)
        super().__init__("servo drive", module.drive.serial)
        self._plant = plant
        self._side = side
        self._drive = plant.bench.drives[side]
        self._holding = [0] * 16
        self._slowness_s = slowness_s
        self._power_at = math.inf
        self._maximum = 1.2 * module.limits.torque_nm, 1.2 * module.limits.speed_rpm * 0.1047198

    def inputs(self, lying: bool) -> dict[int, int]:
        """Return status, set points, limits and position."""
        self._power_if_due()
        state = self._drive.state()
        enabled = state.enabled != lying
        status = DriveStatus.ENABLED if enabled else DriveStatus(0)
        if state.fault:
            status |= DriveStatus.FAULT
            if "watchdog" in state.fault:
                status |= DriveStatus.WATCHDOG
        torque, speed = state.torque_nm or 0.0, state.speed_rad_s or 0.0
        words = {
            DriveReport.STATUS: [int(status), 1 if state.fault else 0],
            DriveReport.MODE: [self._holding[DriveCommand.MODE]],
            DriveReport.TORQUE: registers.from_float(0.0 if lying else torque),
            DriveReport.SPEED: registers.from_float(0.0 if lying else speed),
            DriveReport.MAXIMUM_TORQUE: registers.from_float(self._maximum[0]),
            DriveReport.MAXIMUM_SPEED: registers.from_float(self._maximum[1]),
            DriveReport.POSITION: registers.from_integer(_wrapped(self._plant.counts(self._side))),
        }
        return _placed({int(place): block for place, block in words.items()})

    def written(self, address: int, values: list[int]) -> None:
        """Obey."""
        self._holding[address : address + len(values)] = values
        touched = range(address, address + len(values))
        if DriveCommand.WATCHDOG in touched:
            self._drive.feed_watchdog()
        if DriveCommand.CONTROL in touched:
            self._obey(DriveControl(self._holding[DriveCommand.CONTROL] & 0x83))

    def _power_if_due(self) -> None:
        if time.monotonic() >= self._power_at:
            self._power_at = math.inf
            self._drive.enable()

    def _obey(self, control: DriveControl) -> None:
        self._power_if_due()
        state = self._drive.state()
        if control & DriveControl.RESET:
            if state.fault:
                self._drive.disable()
            return
        if not control & DriveControl.ENABLE:
            self._power_at = math.inf
            if state.enabled:
                self._drive.disable()
            return
        if control & DriveControl.ZERO:
            self._drive.ramp_to_zero(self._number(DriveCommand.ZERO_RAMP))
            return
        mode = self._holding[DriveCommand.MODE]
        if mode == DriveMode.NONE and not state.enabled:
            self._power_at = min(self._power_at, time.monotonic() + self._slowness_s())
            self._power_if_due()
        elif mode == DriveMode.TORQUE and state.enabled:
            self._drive.command_torque(
                self._number(DriveCommand.TORQUE), self._number(DriveCommand.TORQUE_RATE)
            )
        elif mode == DriveMode.SPEED and state.enabled:
            self._drive.command_speed(
                self._number(DriveCommand.SPEED), self._number(DriveCommand.SPEED_RATE)
            )

    def _number(self, place: DriveCommand) -> float:
        return registers.float_of(self._holding[place : place + 2])


def _wrapped(counts: int) -> int:
    return (counts + 2**31) % 2**32 - 2**31


class ProbesImage(Image):
    """A module of temperature probes."""

    def __init__(self, plant: Plant, probes: Mapping[str, int]) -> None:
        super().__init__("probe module", "SIM-TEMP-1")
        self._plant = plant
        self._probes = probes

    def inputs(self, lying: bool) -> dict[int, int]:
        """Return hundredths of a degree."""
        present = self._plant.bench.temperatures()
        return {
            place: (
                round(100.0 * (present[name] + (LIE_K if lying else 0.0))) % 65536
                if name in present
                else registers.PROBE_BROKEN % 65536
            )
            for name, place in self._probes.items()
        }


class AnglesImage(Image):
    """Encoder positions."""

    def __init__(self, plant: Plant, places: Mapping[str, int]) -> None:
        super().__init__("encoder gateway", "SIM-GATE-1")
        self._plant = plant
        self._places = places

    def inputs(self, lying: bool) -> dict[int, int]:
        """Return signed counts."""
        sign = -1 if lying else 1
        return _placed(
            {
                self._places[side]: registers.from_integer(
                    _wrapped(sign * self._plant.counts(side))
                )
                for side in SIDES
            }
        )


class ReadoutImage(Image):
    """A calibrator's amplifier."""

    def __init__(self, plant: Plant) -> None:
        super().__init__("torque amplifier", "SIM-AMP-1")
        self._plant = plant

    def inputs(self, lying: bool) -> dict[int, int]:
        """Return both blocks of samples."""
        words: dict[int, list[int]] = {}
        sign = -1.0 if lying else 1.0
        for number, side in enumerate(SIDES):
            count, torques = self._plant.torques(side)
            held = torques[-registers.READOUT_SAMPLES :]
            header = [*registers.from_integer(count), round(self._plant.window_s * 1e6), len(held)]
            samples = [word for torque in held for word in registers.from_float(sign * torque)]
            words[number * registers.READOUT_STRIDE] = header + samples
        return _placed(words)


class DigitalImage(Image):
    """Mode conversion and clamp, which move at once."""

    def __init__(self, plant: Plant) -> None:
        super().__init__("digital module", "SIM-IO-1")
        self._plant = plant
        self._coils = [False] * 16

    def inputs(self, lying: bool) -> dict[int, int]:
        """Return none."""
        del lying
        return {}

    def contacts(self, lying: bool) -> dict[int, bool]:
        """Return the position contacts."""
        bench = self._plant.bench
        found: dict[int, bool] = {}
        for side, first in zip(SIDES, (Contact.INPUT_FREE, Contact.OUTPUT_FREE), strict=True):
            place = _MODES.index(bench.mode(side))
            place = (place + 1) % 3 if lying else place
            found |= {first + offset: offset == place for offset in range(3)}
        clamped = bench.clamped() != lying
        found[Contact.CLAMP_CLOSED] = found[Contact.CLAMP_PRESSURE] = clamped
        found[Contact.CLAMP_OPEN] = not clamped
        return found

    def switched(self, address: int, values: list[bool]) -> None:
        """Move what the coils say, as far as they were written."""
        self._coils[address : address + len(values)] = values
        touched = range(address, address + len(values))
        bench = self._plant.bench
        for side, first in zip(SIDES, (Coil.INPUT_DRIVEN, Coil.OUTPUT_DRIVEN), strict=True):
            driven, locked = self._coils[first : first + 2]
            mode: Mode = "driven" if driven else "locked" if locked else "free"
            if (first in touched or first + 1 in touched) and bench.mode(side) != mode:
                bench.set_mode(side, mode)
        if Coil.CLAMP in touched and bench.clamped() != self._coils[Coil.CLAMP]:
            try:
                bench.set_clamped(self._coils[Coil.CLAMP])
            except TorquebenchError:
                self._coils[Coil.CLAMP] = bench.clamped()
