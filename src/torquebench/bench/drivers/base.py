"""Roles of instruments: one narrow interface each, independent of any wire protocol.

A driver serves one or several roles and is chosen by `bench.toml`. Every method may be called from
any thread and may block for as long as its connection needs; `DriverSet.blocking` says whether
callers on an event loop have to move such calls to a thread. A method that fails raises
`torquebench.errors.BenchError` with the instrument, its answer and what to do.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.blocks import Block
from torquebench.bench.certificates.encoder import EncoderCertificate
from torquebench.bench.certificates.torque import ReferenceCertificate
from torquebench.bench.roles import (
    CHANNELS,
    MODES,
    MOUNTINGS,
    SIDES,
    Mode,
    Mounting,
    RailPosition,
    Seating,
    Side,
    reference_channel,
    torque_channel,
)
from torquebench.reducers import CertifiedFriction, ReducerDescription
from torquebench.signals import Record

__all__ = [
    "CHANNELS",
    "CLOCKS_APART_S",
    "MODES",
    "MOUNTINGS",
    "SIDES",
    "Block",
    "Clamp",
    "CounterCard",
    "Drive",
    "DriveLimits",
    "DriveState",
    "DriverSet",
    "GuideRail",
    "Identified",
    "Identity",
    "Mode",
    "ModeConverter",
    "Mounting",
    "OperatorPrompts",
    "Positioned",
    "PowerSupply",
    "RailPosition",
    "ReferenceReadout",
    "Seating",
    "Side",
    "Temperature",
    "TrueTorqueSource",
    "reference_channel",
    "torque_channel",
]


@dataclass(frozen=True)
class Identity:
    """Identity stated by an instrument, for the record and for `doctor`."""

    role: str
    manufacturer: str
    model: str
    serial: str
    firmware: str = ""
    details: Mapping[str, str] = field(default_factory=dict)


@runtime_checkable
class Identified(Protocol):
    """An instrument that can report its identity; counters, drives and read-outs always can."""

    def identity(self) -> Identity:
        """Read the identity of the instrument."""


@runtime_checkable
class CounterCard(Protocol):
    """A counter that times the edges of torque transducers and encoders by one clock."""

    @property
    def timebase_hz(self) -> float:
        """Nominal frequency of the clock that counts the ticks, Hz."""

    @property
    def clock_identity(self) -> str:
        """Identity of the timebase: calibration and measurement must use the same one."""

    def identity(self) -> Identity:
        """Read the identity of the instrument."""

    def select(self, channels: frozenset[str]) -> None:
        """Time only these channels from the next block on; other channels cost nothing."""

    def read_block(self, duration_s: float) -> Block:
        """Return the next `duration_s` of edges and angles without a gap to the block before.

        A selected channel without pulses has an entry without edges; the evaluation reports the
        fault. An instrument that counts by itself delivers records of frequencies instead of edges,
        one row a window; an amplifier delivers records with `time_s` and `signal`. Real counters
        block until the time has passed; simulated ones compute it.
        """

    def close(self) -> None:
        """Release the instrument. A second call does nothing."""


@dataclass(frozen=True)
class DriveState:
    """The state that a drive reports.

    `torque_nm` and `speed_rad_s` are the active set points, `None` for a quantity that the drive
    doesn't control; `limited` states that a limit of the drive keeps it from its set point,
    `remote` that it accepts commands from the bus.
    """

    enabled: bool
    torque_nm: float | None
    speed_rad_s: float | None
    fault: str = ""
    limited: bool = False
    remote: bool = True


@dataclass(frozen=True)
class DriveLimits:
    """Largest torque and speed that a drive accepts; infinite where it states none."""

    torque_nm: float = math.inf
    speed_rad_s: float = math.inf


@runtime_checkable
class Drive(Protocol):
    """The motor of one module with its servo drive. The drive ramps and has its own watchdog."""

    def identity(self) -> Identity:
        """Read the identity of the drive."""

    def limits(self) -> DriveLimits:
        """Return the drive's own limits, as read when it was opened."""

    def enable(self) -> None:
        """Power the motor at zero torque and zero speed."""

    def disable(self) -> None:
        """Switch off the motor's power."""

    def command_torque(self, torque_nm: float, ramp_nm_per_s: float) -> None:
        """Ramp to a torque at a limited rate and keep it. Clockwise is positive."""

    def command_speed(self, speed_rad_s: float, ramp_rad_per_s2: float) -> None:
        """Ramp to a speed at a limited rate and keep it. Clockwise is positive."""

    def ramp_to_zero(self, duration_s: float) -> None:
        """Ramp torque and speed to zero within `duration_s`, whatever was commanded before.

        The drive ramps by itself, even if this computer hangs.
        """

    def feed_watchdog(self) -> None:
        """Reset the drive's watchdog. Without this, the drive ramps to zero and disables itself."""

    def state(self) -> DriveState:
        """Request the active set points and the fault state."""

    def close(self) -> None:
        """Release the drive. A second call does nothing."""


@runtime_checkable
class Positioned(Protocol):
    """A drive that states the position of its own encoder, for `driver.angles` by the drives."""

    def position_counts(self) -> int:
        """Request the position, a signed word of 32 bits, clockwise positive."""


CLOCKS_APART_S = 0.1
"""Largest deviation of a read-out's clock from the counter's, s, in addition to two of its periods.
"""


@runtime_checkable
class ReferenceReadout(Protocol):
    """A standard that delivers torque values (an amplifier on a bus) instead of edges.

    On a bench without a read-out, the reference transducers are wired to the counter card.
    """

    @property
    def period_s(self) -> float:
        """Period of its values, s; 0 while it is unknown."""

    def identity(self) -> Identity:
        """Read the identity of the read-out."""

    def read(self, side: Side, until_s: float, timed_s: float) -> Record:
        """Return the samples since the last call up to bench time `until_s`, none later.

        The columns are `time_s` and `signal` (N·m, or as the transducer's `signal` is described),
        NaN without a signal. A sample whose time isn't known yet may come with a later call.
        `timed_s` is the bench time that has passed at least: it is later than `until_s` if the
        computer lags behind the counter.
        """

    def close(self) -> None:
        """Release the read-out. A second call does nothing."""


@runtime_checkable
class ModeConverter(Protocol):
    """The test-mode conversion of both modules: free, driven or locked."""

    def set_mode(self, side: Side, mode: Mode) -> None:
        """Change the mode of one side, and return when it is reached."""

    def mode(self, side: Side) -> Mode:
        """Request the present mode of one side."""


@runtime_checkable
class Clamp(Protocol):
    """The hydraulic clamp between the standard flanges."""

    def set_clamped(self, clamped: bool) -> None:
        """Close or open the clamp, and return when that is reached."""

    def clamped(self) -> bool:
        """Return whether the clamp is closed and under pressure."""


@runtime_checkable
class GuideRail(Protocol):
    """The guide rail that carries the input module."""

    def move(self, position: RailPosition) -> None:
        """Move to "end" or "away", and return when the rail is there."""

    def position(self) -> RailPosition:
        """Request the rail's position."""


@runtime_checkable
class PowerSupply(Protocol):
    """The drives' power supply."""

    def supplies(self) -> bool:
        """Return whether the supply is on."""


@runtime_checkable
class Temperature(Protocol):
    """The temperature probes."""

    def temperatures(self) -> Mapping[str, float]:
        """Read all probes: temperature in °C by name."""


@runtime_checkable
class OperatorPrompts(Protocol):
    """Manual operations by a person or by a simulated operator."""

    def mount(self, mounting: Mounting) -> None:
        """Ask for this part between the flanges; return when it is confirmed.

        Raises
        ------
        InterlockError
            The operator declines.
        """

    def mounted(self) -> Mounting:
        """Return the part between the flanges, by the last confirmation."""

    def seat(self, seating: Seating) -> None:
        """Ask to turn or re-seat the mounted part; return when it is confirmed.

        Raises
        ------
        InterlockError
            The operator declines.
        """

    def cancel(self) -> None:
        """Stop waiting for a confirmation: the waiting caller gets an `InterlockError`."""


@runtime_checkable
class TrueTorqueSource(Protocol):
    """The torque that really acts on the flange, which only a simulated bench can know."""

    def true_torque(self, side: Side, start_s: float, stop_s: float) -> float:
        """Return the mean true torque at the flange over a time window, N·m."""

    def dense_sweep(
        self, side: Side, true_torque_nm: NDArray[np.float64], *, alone: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
        """Return noise-free readings (N·m) along a path of true torques, and their branches.

        `alone`: the transducer by itself, as a laboratory calibrates it.
        """

    def mounting(self) -> Mapping[str, float | str]:
        """Return the fields of `MountingRecord` that a person would enter."""


@dataclass(frozen=True)
class DriverSet:
    """The instruments of one bench, by role."""

    name: str
    counter: CounterCard
    drives: Mapping[Side, Drive]
    modes: ModeConverter
    clamp: Clamp
    temperature: Temperature
    operator: OperatorPrompts
    reference: ReferenceReadout | None = None
    rail: GuideRail | None = None
    supply: PowerSupply | None = None
    truth: TrueTorqueSource | None = None
    certificates: Mapping[Mounting, Mapping[Side, ReferenceCertificate]] = field(
        default_factory=dict
    )
    """Certificates that the instruments supply; files in the description take precedence."""
    encoder_certificates: Mapping[Side, EncoderCertificate] = field(default_factory=dict)
    """Certificates of the encoders; files in the description take precedence."""
    reducer_certificate: tuple[CertifiedFriction, ...] = ()
    """Certified no-load friction of a standard reducer that comes with the bench."""
    hold: Callable[[ReducerDescription | None, str], None] | None = None
    """Mounts a reducer by type and serial number on a simulated bench; None mounts the bench's
    own."""
    simulated_time: bool = False
    """Whether `read_block` computes the block instead of waiting for time to pass."""
    blocking: bool = True
    """Whether commands may block for longer than an event loop allows."""
    shortest_read_s: float = 0.0
    """Shortest block that the counter can deliver, s, and so the supervisor's shortest check
    interval."""
    resources: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)
    """Other resources to be closed with the instruments."""

    def identities(self) -> list[Identity]:
        """Read the identity of every instrument."""
        drives = self.drives.values()
        parts: list[object] = [self.counter, *drives, self.reference]
        parts += [self.modes, self.clamp, self.temperature, self.rail, self.supply]
        instruments: list[Identity] = []
        for number, part in enumerate(parts):
            if isinstance(part, Identified) and not any(
                part is earlier for earlier in parts[:number]
            ):
                instruments.append(part.identity())
        return instruments

    def close(self) -> None:
        """Release every instrument, even if one of them fails to close."""
        with contextlib.ExitStack() as closing:
            closing.push(self.resources.pop_all())
            closing.callback(self.counter.close)
            if self.reference is not None:
                closing.callback(self.reference.close)
            for drive in self.drives.values():
                closing.callback(drive.close)
