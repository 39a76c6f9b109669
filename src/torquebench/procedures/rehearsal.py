"""Rehearsal of a plan before anything moves: its messages change a model of the bench's state.

The rehearsal uses the same plan as the run. Each command is checked against the limits of the bench
description and against the predicted mounting, clamping and coupling.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import inf
from typing import Any, Generic, TypeVar

from bluesky.utils import Msg

from torquebench.bench.devices import BenchDevices, Point, RampTo, SteadySettings
from torquebench.bench.devices.drive import DriveAxis
from torquebench.bench.interlocks import (
    check_clamp,
    check_enable,
    check_mode_change,
    check_mounting,
    check_procedure,
    check_rail,
    check_seating,
    check_set_point,
)
from torquebench.bench.roles import SIDES, Mode, Mounting, RailPosition, Seating, Side
from torquebench.bench.safety.limits import LimitBook
from torquebench.bench.state import Quantity
from torquebench.errors import TorquebenchError
from torquebench.procedures.setup import Plan, ProcedureGate
from torquebench.procedures.standard_check import StandardCheck
from torquebench.units import RPM_PER_RAD_S

__all__ = ["Move", "Rehearsal", "rehearse"]

Result = TypeVar("Result")


@dataclass(frozen=True)
class Move:
    """One command of a plan and when it comes.

    Parameters
    ----------
    time_s : float
        Bench time since the plan's start, without waiting longer for settling, s.
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
        Steps that the plan's progress counts; 0 where it can't know.
    duration_s : float
        Bench time that it takes, without waiting longer for settling, s.
    result : object
        Return value of the plan if every reading equals its command.
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
    """Rehearse a plan without moving anything, and refuse it where the bench would.

    Parameters
    ----------
    devices : BenchDevices
        Their present state is where the rehearsal starts; they aren't commanded.
    plan : generator
        The plan; it is used up.

    Returns
    -------
    Rehearsal

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


class _Books:
    """The predicted state of the bench.

    It assumes that the operator is present and no alarm is latched; the devices check both at run
    time.
    """

    def __init__(self, devices: BenchDevices) -> None:
        self.present = present = devices.context.state
        self.description = present.description
        self.book = LimitBook(present.description)
        self.limits = self.book.side
        self.drive_limits = present.drive_limits
        self.standard = present.mounted()
        self.closed = present.clamped()
        self.rail_at = present.rail()
        drives = devices.context.drivers.drives
        self.sides: dict[Side, _SideState] = {
            side: _SideState(present.mode(side), drives[side].state().enabled) for side in SIDES
        }

    def mounted(self) -> Mounting:
        return self.standard

    def clamped(self) -> bool:
        return self.closed

    def has_rail(self) -> bool:
        return self.present.has_rail()

    def rail(self) -> RailPosition:
        return self.rail_at

    def supplied(self) -> bool:
        return True

    def mode(self, side: Side) -> Mode:
        return self.sides[side].mode

    def enabled(self, side: Side) -> bool:
        return self.sides[side].enabled

    def commanded(self, side: Side) -> tuple[float, float]:
        return self.reading_nm(side), self.speed_rad_s(side)

    def reading_nm(self, side: Side) -> float:
        return self.sides[side].set_points["torque"]

    def speed_rad_s(self, side: Side) -> float:
        return self.sides[side].set_points["speed"]

    def alarm(self) -> None:
        return None

    def absent_s(self) -> float:
        return 0.0


@dataclass
class _SideState:
    mode: Mode
    enabled: bool
    set_points: dict[Quantity, float] = field(default_factory=lambda: {"torque": 0.0, "speed": 0.0})
    settings: SteadySettings = field(default_factory=SteadySettings)


class _Stage:
    """The simulated devices of a rehearsal."""

    def __init__(self, devices: BenchDevices) -> None:
        self.devices = devices
        self.books = _Books(devices)
        self.description, self.sides = self.books.description, self.books.sides
        self.stamp = Point()
        self.now_s = 0.0
        self.moves: list[Move] = []
        self.points = self.steps = 0
        self._ends_s: dict[object, float] = {}
        self._stream = ""
        self._setters: dict[int, tuple[str, Callable[[Any], None]]] = {
            id(devices.clamp): ("clamp", self._clamp),
            id(devices.rail): ("guide rail", self._move_rail),
            id(devices.mounting): ("mounting", self._mount),
            id(devices.seat): ("seat", self._seat),
            id(devices.point): ("point", self._mark),
        }
        self._readings: dict[int, Callable[[], object]] = {
            id(devices.mounting.mounted): self.books.mounted,
            id(devices.clamp.clamped): self.books.clamped,
            id(devices.rail.position): self.books.rail,
        }
        for side in SIDES:
            self._connect(side)

    def _connect(self, side: Side) -> None:
        module, state = self.devices.module(side), self.sides[side]
        drive = module.drive

        def bind(device: object, name: str, action: Callable[[Side, Any], None]) -> None:
            self._setters[id(device)] = (f"{side} {name}", lambda value: action(side, value))

        bind(module.mode, "mode", self._change_mode)
        bind(drive.power, "power", self._switch)
        axes: dict[Quantity, DriveAxis] = {"torque": drive.torque, "speed": drive.speed}
        for quantity, axis in axes.items():
            bind(axis, quantity, partial(self._drive, quantity))
            self._readings[id(axis.setpoint)] = partial(state.set_points.get, quantity)
        self._readings[id(module.mode.mode)] = lambda: state.mode
        self._readings[id(drive.power.enabled)] = lambda: state.enabled

    # -- messages ---------------------------------------------------------------------------

    def answer(self, message: Msg) -> Any:
        """Apply a message to the predicted state, as the run engine would to the bench."""
        if message.command == "set":
            self._begin(message)
        elif message.command == "wait":
            self.now_s = max(self.now_s, self._ends_s.pop(message.kwargs.get("group"), 0.0))
        elif message.command == "sleep":
            self.now_s += float(message.args[0])
        elif message.command == "prepare":
            self._side_of(message.obj).settings = message.args[0]
        elif message.command == "trigger":
            if message.obj is not self.devices.recorder:
                settings = self._side_of(message.obj).settings
                self.now_s += settings.settle_s + settings.window_s
        elif message.command in ("read", "locate"):
            return self._read(message)
        elif message.command == "create":
            self._stream = message.kwargs["name"]
        elif message.command == "save":
            self.points += self._stream == "points"
        elif message.command == "tighten":
            return self.books.book.tighten(*message.args)
        elif message.command == "loosen":
            self.books.book.loosen(message.args[0])
        elif message.command == "progress":
            self.steps = max(self.steps, message.args[1])
        return None

    def _side_of(self, device: object) -> _SideState:
        return next(
            state for side, state in self.sides.items()
            if self.devices.module(side).steady is device
        )  # fmt: skip

    def _begin(self, message: Msg) -> None:
        """Set a device; devices set in one group move at the same time."""
        group, began_s = message.kwargs.get("group"), self.now_s
        self._set(message.obj, message.args[0])
        if group is not None:
            self._ends_s[group] = max(self._ends_s.get(group, 0.0), self.now_s)
            self.now_s = began_s

    def _set(self, device: Any, value: Any) -> None:
        if isinstance(device, ProcedureGate):
            check_procedure(self.books, value)
            return
        if isinstance(device, StandardCheck):  # nothing was measured
            return
        name, action = self._setters.get(id(device), (device.name, lambda _value: None))
        action(value)
        if device is not self.devices.point:
            target = value.target if isinstance(value, RampTo) else value
            self.moves.append(Move(self.now_s, name, target))

    def _read(self, message: Msg) -> dict[str, Any]:
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
                f"{device.name}-{probe}_c": {"value": 23.0, "timestamp": self.now_s}
                for probe in self.description.temperatures
            }
        return {}

    def _steady(self, side: Side) -> dict[str, Any]:
        state, (torque_nm, speed_rad_s) = self.sides[side], self.books.commanded(side)
        scale = self.description.module(side).transducer.scale()
        fields = {
            "reading_nm": torque_nm,
            "reading_standard_error_nm": 0.0,
            "zero_nm": 0.0,
            scale.column: scale.zero,
            "settled": True,
            "commanded_nm": torque_nm,
            "speed_rpm": speed_rad_s * RPM_PER_RAD_S,
            "temperature_c": 23.0,
            "time_s": self.now_s,
        }
        if state.settings.reference:
            fields["standard_nm"] = torque_nm
        return fields

    # -- effects of each command on the state ------------------------------------------------

    def _mount(self, value: Mounting) -> None:
        check_mounting(self.books, value)
        self.books.standard = value

    def _move_rail(self, value: RailPosition) -> None:
        check_rail(self.books, value)
        self.books.rail_at = value

    def _seat(self, _value: Seating) -> None:
        check_seating(self.books)

    def _clamp(self, value: bool) -> None:
        check_clamp(self.books, value)
        self.books.closed = value

    def _mark(self, value: Point) -> None:
        self.stamp = value

    def _change_mode(self, side: Side, value: Mode) -> None:
        check_mode_change(self.books, side, value)
        self.sides[side].mode = value

    def _switch(self, side: Side, value: bool) -> None:
        if value:
            check_enable(self.books, side)
        else:  # the drive ramps to zero first
            self._drive("torque", side, 0.0)
            self._drive("speed", side, 0.0)
        self.sides[side].enabled = value

    def _drive(self, quantity: Quantity, side: Side, value: float | RampTo) -> None:
        ramp = value if isinstance(value, RampTo) else RampTo(value, inf)
        check_set_point(self.books, side, quantity, ramp.target)
        set_points = self.sides[side].set_points
        rate = min(ramp.rate, self.description.module(side).drive.rate(quantity))
        self.now_s += abs(ramp.target - set_points[quantity]) / rate
        set_points[quantity] = ramp.target
