"""Rehearsal of a plan before anything moves: its messages change a model of the bench's state.

The rehearsal uses the same plan as the run. The `rehearse` of each device checks a command like its
`set`, but against the planned state of mounting, clamp and modes, which it then changes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

from bluesky.utils import Msg
from ophyd_async.core import Device

from torquebench.bench.devices import BenchDevices, RampTo, SteadySettings
from torquebench.bench.devices.steady import SteadyTorque
from torquebench.bench.interlocks import PlannedState
from torquebench.bench.roles import SIDES, Side
from torquebench.bench.state import Quantity
from torquebench.errors import InputError, TorquebenchError
from torquebench.message import Message
from torquebench.procedures.setup import Plan
from torquebench.units import RPM_PER_RAD_S

Result = TypeVar("Result")

ROOM_C = 23.0


FEWEST_VALUES = 3
"""Values of a transducer in the mean of a step: fewer may be lost by a busy computer."""


def _check_quick_enough(steady: SteadyTorque, settings: SteadySettings) -> None:
    """Refuse steps that end before a slow amplifier or read-out has stated enough values."""
    for channel, period_s in steady.value_periods_s(reference=settings.reference).items():
        if settings.window_s < FEWEST_VALUES * period_s * (1.0 - 1e-9):
            raise InputError(
                Message("steps are averaged over {window_s:g} s, {channel} states a value each "
                        "{period_s:g} s", settings.window_s, channel, period_s),
                Message("at least {count} values in a step", FEWEST_VALUES),
                "choose a profile with longer steps (--profile staircase), or shorten "
                "counter.window_s or the read-out's period_s",
            )  # fmt: skip


@dataclass(frozen=True)
class Move:
    """One command of a plan with its time.

    Parameters
    ----------
    time_s : float
        Bench time since the plan's start, without additional waiting for settling, s.
    device : str
        Commanded quantity.
    value : object
        Commanded value.
    """

    time_s: float
    device: str
    value: object


@dataclass(frozen=True)
class Rehearsal(Generic[Result]):
    """Result of a rehearsal.

    Parameters
    ----------
    moves : list of Move
        Every command in order.
    points : int
        Events that would be recorded in the stream "points".
    steps : int
        Number of steps in the plan's progress; 0 if unknown.
    duration_s : float
        Duration in bench time, without additional waiting for settling, s.
    result : object
        Return value of the plan, if every reading equals its command.
    """

    moves: list[Move]
    points: int
    steps: int
    duration_s: float
    result: Result

    def largest(self, quantity: Quantity) -> dict[str, float]:
        """Return the largest commanded magnitude of each side, N·m or rad/s."""
        largest: dict[str, float] = dict.fromkeys(SIDES, 0.0)
        for side in SIDES:
            for move in self.moves:
                if move.device == f"{side} {quantity}" and isinstance(move.value, int | float):
                    largest[side] = max(largest[side], abs(float(move.value)))
        return largest


def rehearse(devices: BenchDevices, plan: Plan[Result]) -> Rehearsal[Result]:
    """Rehearse a plan without moving anything, and refuse it if the bench would refuse it.

    Parameters
    ----------
    devices : BenchDevices
        Devices, which aren't commanded; the rehearsal starts from their present state.
    plan : generator
        The plan; it is consumed.

    Raises
    ------
    LimitError
        A torque or speed beyond the limits of the bench description.
    InterlockError
        A command that the bench's state at that moment forbids.
    """
    stage = _Stage(devices)
    answer: Any = None
    while True:
        try:
            message = plan.send(answer)
        except StopIteration as end:
            return Rehearsal(stage.moves, stage.points, stage.steps, stage.now_s, end.value)
        try:
            answer = stage.answer(message)
        except TorquebenchError:
            plan.close()
            raise


class _Stage:
    """The planned bench, whose state the devices change in a rehearsal."""

    def __init__(self, devices: BenchDevices) -> None:
        self.devices = devices
        self.planned = planned = PlannedState(devices.context.state, devices.context.drivers.drives)
        self.now_s = 0.0
        self.moves: list[Move] = []
        self.points = self.steps = 0
        self._ends_s: dict[object, float] = {}
        self._stream = ""
        self._settings: dict[int, SteadySettings] = {}
        self._readings: dict[int, Callable[[], object]] = {
            id(devices.mounting.mounted): planned.mounted,
            id(devices.clamp.clamped): planned.clamped,
            id(devices.rail.position): planned.rail,
        }
        for side in SIDES:
            module = devices.module(side)
            self._readings |= {
                id(module.drive.torque.setpoint): partial(planned.reading_nm, side),
                id(module.drive.speed.setpoint): partial(planned.speed_rad_s, side),
                id(module.mode.mode): partial(planned.mode, side),
                id(module.drive.power.enabled): partial(planned.enabled, side),
            }

    # -- messages ---------------------------------------------------------------------------

    def answer(self, message: Msg) -> Any:
        """Apply a message to the planned state, as the run engine would apply it to the bench."""
        if message.command == "set":
            self._begin(message)
        elif message.command == "wait":
            self.now_s = max(self.now_s, self._ends_s.pop(message.kwargs.get("group"), 0.0))
        elif message.command == "sleep":
            self.now_s += float(message.args[0])
        elif message.command == "prepare":
            self._settings[id(message.obj)] = message.args[0]
        elif message.command == "trigger":
            if message.obj is not self.devices.recorder:
                settings = self._settings_of(message.obj)
                if isinstance(message.obj, SteadyTorque):
                    _check_quick_enough(message.obj, settings)
                self.now_s += settings.settle_s + settings.window_s
        elif message.command in ("read", "locate"):
            return self._read(message)
        elif message.command == "create":
            self._stream = message.kwargs["name"]
        elif message.command == "save":
            self.points += self._stream == "points"
        elif message.command == "tighten":
            return self.planned.book.tighten(*message.args)
        elif message.command == "loosen":
            self.planned.book.loosen(message.args[0])
        elif message.command == "progress":
            self.steps = max(self.steps, message.args[1])
        return None

    def _begin(self, message: Msg) -> None:
        """Set a device; devices that are set in one group move at the same time."""
        group, began_s = message.kwargs.get("group"), self.now_s
        self._set(message.obj, message.args[0])
        if group is not None:
            self._ends_s[group] = max(self._ends_s.get(group, 0.0), self.now_s)
            self.now_s = began_s

    def _set(self, device: Any, value: Any) -> None:
        """Apply a device's new value to the planned state, and note it as a move."""
        rehearse = getattr(device, "rehearse", None)  # other devices don't change the bench
        if rehearse is not None:
            self.now_s += rehearse(self.planned, value) or 0.0
        if isinstance(device, Device) and device is not self.devices.point:
            name = device.name.replace("-drive-", " ").replace("-", " ")
            target = value.target if isinstance(value, RampTo) else value
            self.moves.append(Move(self.now_s, name, target))

    def _settings_of(self, steady: object) -> SteadySettings:
        return self._settings.get(id(steady), SteadySettings())

    def _read(self, message: Msg) -> dict[str, Any]:
        """Return what a device would read if every drive followed its commands."""
        device: Any = message.obj
        getter = self._readings.get(id(device))
        if getter is not None:
            value = getter()
            if message.command == "locate":
                return {"setpoint": value, "readback": value}
            return {device.name: {"value": value, "timestamp": self.now_s}}
        for side in SIDES:
            steady = self.devices.module(side).steady
            if device is steady:
                fields = self._steady(side)
                return {
                    steady.key(name): {"value": value, "timestamp": self.now_s}
                    for name, value in fields.items()
                }
        if device is self.devices.temperatures:
            return {
                f"{device.name}-{probe}_c": {"value": ROOM_C, "timestamp": self.now_s}
                for probe in self.planned.description.temperatures
            }
        return {}

    def _steady(self, side: Side) -> dict[str, Any]:
        """Return the steady values that a rehearsed drive would give."""
        planned = self.planned
        torque_nm, speed_rad_s = planned.commanded(side)
        scale = planned.description.module(side).transducer.scale()
        fields = {
            "reading_nm": torque_nm,
            "reading_standard_error_nm": 0.0,
            "zero_nm": 0.0,
            scale.column: scale.zero,
            "settled": True,
            "commanded_nm": torque_nm,
            "speed_rpm": speed_rad_s * RPM_PER_RAD_S,
            "temperature_c": ROOM_C,
            "time_s": self.now_s,
        }
        if self._settings_of(self.devices.module(side).steady).reference:
            fields["standard_nm"] = torque_nm
        return fields
