"""Preparation of the bench for a procedure, and its return to the unloaded state."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, TypeVar

import bluesky.preprocessors as bpp
from bluesky.protocols import Movable
from bluesky.utils import Msg
from ophyd_async.core import AsyncStatus

from torquebench import __version__
from torquebench.bench.devices import BenchDevices
from torquebench.bench.drivers.base import Mode, Mounting, Seating, Side
from torquebench.bench.interlocks import PlannedState, ProcedureKind, check_procedure
from torquebench.procedures.guarding import StepLimits, guarded
from torquebench.procedures.messages import move, read, sleep

__all__ = [
    "Plan",
    "ProcedureGate",
    "Setup",
    "measured_in",
    "other_side",
    "set_up",
    "start_metadata",
]

Result = TypeVar("Result")
Plan = Generator[Msg, Any, Result]
"""A plan: messages for the run engine, and a return value."""

REST_S = 0.3
"""Waiting time after a module's torque went to zero, s of bench time."""
RUN_DOWN_S = 15.0
"""Time after which shafts without power are at standstill, s of bench time; otherwise something
drives them."""


@dataclass(frozen=True)
class Setup:
    """Mounting and modes for a procedure.

    Parameters
    ----------
    kind : {"calibration", "verification", "reducer_test", "empty_run"}
        Kind of procedure for the interlocks.
    side : {"input", "output"}
        The driven module.
    mounting : {"calibrator", "verification_standard", "reducer", "nothing"}
        Mounting between the flanges.
    opposite : {"locked", "free", "driven"}
        Mode of the other module.
    """

    kind: ProcedureKind
    side: Side
    mounting: Mounting
    opposite: Mode


class ProcedureGate(Movable[ProcedureKind]):
    """Device that checks, when the plan reaches it, whether the interlocks allow a procedure."""

    name = "procedure_gate"
    parent = None

    def __init__(self, devices: BenchDevices) -> None:
        self._state = devices.context.state

    @AsyncStatus.wrap
    async def set(self, value: ProcedureKind) -> None:
        """Raise InterlockError unless the mounted part fits the procedure."""
        check_procedure(self._state, value)

    def rehearse(self, planned: PlannedState, value: ProcedureKind) -> None:
        """Raise InterlockError unless the part mounted by then fits the procedure."""
        check_procedure(planned, value)


def start_metadata(
    devices: BenchDevices, plan_name: str, points: int, side: Side | None = None, **more: Any
) -> dict[str, Any]:
    """Return the entries of a run's start document.

    Parameters
    ----------
    points : int
        Number of events that will be recorded.
    side : {"input", "output"}, optional
        Measured module, if there is one.
    **more
        Further entries.
    """
    description = devices.context.description
    entries = {
        "plan_name": plan_name,
        "num_points": points,
        "counter_identity": devices.context.drivers.counter.clock_identity,
        "simulated": description.simulated,
        "software_version": __version__,
    }
    if side is not None:
        module = description.module(side)
        entries["side"] = side
        entries["range_nm"] = float(module.range_nm)
        entries["transducer_serial"] = module.transducer.serial
    return {**entries, **more}


def other_side(side: Side) -> Side:
    """Return the opposite side.

    Examples
    --------
    >>> other_side("input")
    'output'
    """
    return "output" if side == "input" else "input"


def set_up(devices: BenchDevices, setup: Setup) -> Plan[None]:
    """Mount, clamp and set modes as the procedure needs; afterwards both drives are off.

    Raises
    ------
    InterlockError
        The operator declines, or the bench's state forbids a step.
    """
    yield from power_off(devices)
    mounted = yield from read(devices.mounting.mounted)
    if mounted != setup.mounting:
        yield from move(devices.clamp, False)
        yield from mount(devices, setup.mounting)
    if setup.mounting != "nothing":
        yield from rail_to_end(devices)
        yield from move(devices.clamp, True)
    yield from move(ProcedureGate(devices), setup.kind)
    yield from set_mode(devices, other_side(setup.side), setup.opposite)
    yield from set_mode(devices, setup.side, "driven")


def mount(devices: BenchDevices, mounting: Mounting) -> Plan[None]:
    """Ask for a mounting; a guide rail that the bench controls is moved away for it."""
    if devices.context.drivers.rail is not None:
        yield from move(devices.rail, "away")
    yield from move(devices.mounting, mounting)


def rail_to_end(devices: BenchDevices) -> Plan[None]:
    """Move the input module to its position for clamping, unless it is there."""
    if devices.context.drivers.rail is None:
        return
    position = yield from read(devices.rail.position)
    if position != "end":
        yield from move(devices.rail, "end")


def reseat(devices: BenchDevices, setup: Setup, seating: Seating) -> Plan[None]:
    """Ask the operator to turn or re-seat the standard, and restore the setup."""
    yield from power_off(devices)
    yield from move(devices.clamp, False)
    yield from move(devices.seat, seating)
    yield from set_up(devices, setup)


def set_mode(devices: BenchDevices, side: Side, mode: Mode) -> Plan[None]:
    """Change a module's mode at standstill, unless the module is already in this mode."""
    module = devices.module(side)
    present = yield from read(module.mode.mode)
    if present != mode:
        yield from run_down(devices)
        yield from move(module.mode, mode)


def run_down(devices: BenchDevices) -> Plan[None]:
    """Wait until both sides are at standstill: without power their own friction stops them.

    If a side continues turning, the interlocks refuse the next operation.
    """
    safety = devices.context.description.safety
    for _ in range(round(RUN_DOWN_S / REST_S)):
        stand = True
        for module in (devices.input, devices.output):
            if devices.context.description.module(module.side).encoder is None:
                continue
            reading = yield Msg("read", module.encoder)
            if reading:  # a rehearsal reads nothing
                speed = float(reading[f"{module.encoder.name}-speed_rad_s"]["value"])
                stand = stand and safety.at_standstill(speed)
        if stand:
            return
        yield from sleep(REST_S)


def power_on(devices: BenchDevices, side: Side) -> Plan[None]:
    """Enable a module's drive at zero torque, unless it is enabled."""
    power = devices.module(side).drive.power
    enabled = yield from read(power.enabled)
    if not enabled:
        yield from move(power, True)


def power_off(devices: BenchDevices) -> Plan[None]:
    """Ramp every enabled drive to zero torque and speed, and switch its power off."""
    for module in (devices.input, devices.output):
        enabled = yield from read(module.drive.power.enabled)
        if not enabled:
            continue
        for axis in (module.drive.torque, module.drive.speed):
            present = yield from read(axis.setpoint)
            if present != 0.0:
                yield from move(axis, 0.0)
        yield from sleep(REST_S)
        yield from move(module.drive.power, False)


def measured_in(
    setup: Setup,
    devices: BenchDevices,
    measuring: Plan[None],
    metadata: dict[str, Any],
    *limits: StepLimits,
) -> Plan[str]:
    """Prepare the bench and measure in one run; return the serial number of the mounted standard.

    The bench is without torque afterwards, however the plan ends; the supervisor's safe state
    doesn't depend on this, because a halt skips it. Without a standard the serial number is empty.

    Parameters
    ----------
    measuring : Plan
        Plan that measures within the run.
    metadata : dict of str to object
        Additional entries of the start document.
    *limits : StepLimits
        Limits of the whole procedure.
    """
    standard = devices.context.description.standard(setup.mounting)
    standard_data = {} if standard is None else {"standard_serial": standard.serial}
    run = bpp.run_wrapper(measuring, md={**metadata, **standard_data})
    plan = bpp.pchain(set_up(devices, setup), run)
    yield from guarded(lambda: bpp.finalize_wrapper(plan, lambda: power_off(devices)), *limits)
    return standard_data.get("standard_serial", "")
