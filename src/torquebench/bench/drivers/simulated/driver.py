"""The simulated bench as instruments: the only file outside the twin's package that uses it.

It delivers edges and encoder counts like hardware; the code that computes frequency and torque from
them is the same for both. Drives ramp by themselves and have their own watchdog.
"""

from __future__ import annotations

import threading
import zlib
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from torquebench.bench.blocks import KEPT_S, Block
from torquebench.bench.certificates.encoder import EncoderCertificate
from torquebench.bench.certificates.torque import ReferenceCertificate
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import DriveLimits, DriverSet, DriveState, Identity
from torquebench.bench.drivers.simulated.readout import SimulatedReadout
from torquebench.bench.roles import (
    SIDES,
    Mode,
    Mounting,
    RailPosition,
    Seating,
    Side,
    angle_channel,
    torque_channel,
)
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.reducers import CertifiedFriction, ReducerDescription
from torquebench.signals import EdgeBlock, History, Record
from torquebench.twin import (
    CHANNELS,
    REDUCERS,
    BenchTwin,
    LubricantName,
    ReducerName,
    TwinBlock,
    TwinParameters,
    draw_reducer,
)
from torquebench.units import KHZ
from torquebench.validation import validated

RAMP_STEP_S = 0.01
TRUTH_RATE_HZ = 1000.0
LOGGED = 1000
CERTIFIED_FRICTION_U_NM = 0.005
"""Expanded uncertainty (k = 2) of the certified friction, N·m: 0.01 % of 50 N·m."""
CLAMP_BAR = 100.0
"""Pressure with which the simulated clamp closes, bar."""


class SimulatedOptions(BaseModel):
    """Keys of the section `[driver]` of a simulated bench."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    preset: Literal["nominal", "worn"] = "nominal"
    seed: Annotated[int, Field(ge=0, le=2**32 - 1, description="(any seed)")] = 1
    reference: Literal["edges", "readout"] = "edges"
    ambient_c: Annotated[float, Field(ge=-10, le=50, description="°C")] | None = None
    ambient_swing_k: Annotated[float, Field(ge=0, le=30, description="K")] = 0.0
    ambient_period_h: Annotated[float, Field(gt=0, le=1000, description="h")] = 24.0
    ambient_drop_k: Annotated[float, Field(ge=0, le=30, description="K")] = 0.0
    lubricant: LubricantName = "grease"
    lubricant_amount: Annotated[float, Field(ge=0.1, le=3, description="of what is specified")] = (
        1.0
    )
    lubricant_hours: Annotated[float, Field(ge=0, le=1e6, description="h")] = 1000.0
    reducer: ReducerName = "standard"
    reducer_seed: Annotated[int, Field(ge=0, le=2**32 - 1, description="(any seed)")] | None = None
    reducer_wear: Annotated[float, Field(ge=0.5, le=5.0, description="(1: as new)")] = 1.0

    def parameters(self) -> TwinParameters:
        """Draw the twin's constants; another seed of the reducer gives another specimen."""
        drawn = TwinParameters.draw(self.preset, self.seed, reducer=self.reducer)
        if self.reducer_seed is None and self.reducer_wear == 1.0:
            return drawn
        specimen = self.seed if self.reducer_seed is None else self.reducer_seed
        generator = np.random.default_rng([specimen, 1])
        return drawn.with_reducer(draw_reducer(generator, self.reducer, self.reducer_wear))


@dataclass
class _Ramp:
    """A set point that ramps to its target."""

    present: float = 0.0
    target: float = 0.0
    rate: float = float("inf")

    def step(self, duration_s: float) -> bool:
        """Advance the ramp by a duration; return whether the set point changed."""
        if self.present == self.target:
            return False
        reach = self.rate * duration_s * (1.0 + 1e-9)  # arrives in time despite rounding
        distance = self.target - self.present
        self.present = (
            self.target
            if abs(distance) <= reach
            else self.present + float(np.copysign(reach, distance))
        )
        return True


class DriveEvent(NamedTuple):
    """A line of a simulated drive's log: the event, and the set points before it."""

    time_s: float
    event: str
    torque_nm: float
    speed_rad_s: float


@dataclass
class _Axes:
    """State of one simulated drive."""

    enabled: bool = False
    torque: _Ramp = field(default_factory=_Ramp)
    speed: _Ramp = field(default_factory=_Ramp)
    controls: Literal["torque", "speed"] = "torque"
    fed_s: float = 0.0
    fault: str = ""

    @property
    def moving(self) -> bool:
        return any(ramp.present != ramp.target for ramp in (self.torque, self.speed))


_ANOTHER_BENCH = "describe the simulated bench as it is, or choose another driver"


class SimulatedBench:
    """The twin as counter card, mode conversion, clamp, probes, operator and true torque.

    Parameters
    ----------
    description : BenchDescription
        Source of serial numbers, timebase, ramps and watchdogs; its `[driver]` defines the twin.
    """

    def __init__(self, description: BenchDescription) -> None:
        options = validated(SimulatedOptions, description.driver, f"{description.name}: driver")
        if description.counter.timebase_hz != 100e6:
            raise InputError(
                Message(
                    "counter.timebase_hz = {timebase_hz:g} Hz", description.counter.timebase_hz
                ),
                "1e+08 Hz on the simulated bench",
                "leave the key out",
            )
        self.description = description
        self.options = options
        self._twin = BenchTwin(
            options.parameters(),
            seed=options.seed,
            timebase_hz=description.counter.timebase_hz,
        )
        self._check_nameplates()
        self._check_encoders()
        if {"ambient_c", "ambient_swing_k", "ambient_drop_k"} & options.model_fields_set:
            mean_c = options.parameters().thermal.ambient_c
            self._twin.set_climate(
                mean_c if options.ambient_c is None else options.ambient_c,
                swing_k=options.ambient_swing_k,
                period_h=options.ambient_period_h,
                drop_k=options.ambient_drop_k,
            )
        for side in SIDES:
            self._twin.lubricate(
                side,
                options.lubricant,
                amount=options.lubricant_amount,
                hours=options.lubricant_hours,
            )
        self._lock = threading.RLock()
        self._axes: dict[Side, _Axes] = {side: _Axes() for side in SIDES}
        self._modes: dict[Side, Mode] = dict.fromkeys(SIDES, "free")
        self._clamped = False
        self._mounted: Mounting = "nothing"
        self._rail: RailPosition = "end"
        self._supplied = True
        self._temperatures: dict[str, float] = {}
        self._truth = History(round(KEPT_S * TRUTH_RATE_HZ))
        self._closed = False
        self._selected: frozenset[str] = frozenset(CHANNELS)
        self.readout = SimulatedReadout(description) if options.reference == "readout" else None
        self.drives: dict[Side, SimulatedDrive] = {
            side: SimulatedDrive(self, side) for side in SIDES
        }

    def _check_nameplates(self) -> None:
        """Refuse a description with other transducers."""
        for channel in CHANNELS:
            side: Side = "input" if channel.startswith("input") else "output"
            if channel == torque_channel(side):
                key, transducer = f"{side}.transducer", self.description.module(side).transducer
            else:
                key, transducer = f"calibrator.{side}", self.description.calibrator.transducer(side)
            plate = self._twin.nameplate(channel)
            own = (plate.nominal_torque_nm, plate.nominal_zero_hz / KHZ)
            if (transducer.nominal_torque_nm, transducer.option_khz) != own:
                raise InputError(
                    Message(
                        "{key}: {nominal_torque_nm:g} N·m, {option_khz} kHz",
                        key,
                        transducer.nominal_torque_nm,
                        transducer.option_khz,
                    ),
                    Message(
                        "{range_nm:g} N·m, {deviation_khz:g} kHz on the simulated bench",
                        own[0],
                        own[1],
                    ),
                    _ANOTHER_BENCH,
                )

    def _check_encoders(self) -> None:
        """Refuse a description with other encoders."""
        parameters = self.options.parameters()
        for side in SIDES:
            own = parameters.input if side == "input" else parameters.output
            encoder = self.description.module(side).encoder
            if encoder is None:
                continue
            stated = encoder.counts_per_revolution
            if stated != own.encoder.counts_per_revolution:
                raise InputError(
                    Message("{key}: {counts} counts per revolution", f"{side}.encoder", stated),
                    Message(
                        "{counts} counts per revolution on the simulated bench",
                        own.encoder.counts_per_revolution,
                    ),
                    _ANOTHER_BENCH,
                )

    @property
    def twin(self) -> BenchTwin:
        """The twin itself; only for tests, demonstrations of faults and dense sweeps."""
        return self._twin

    # -- counter card -----------------------------------------------------------------------

    @property
    def timebase_hz(self) -> float:
        """Ticks per second."""
        return self.description.counter.timebase_hz

    @property
    def clock_identity(self) -> str:
        """The counter and its clock."""
        return self.description.counter.identity

    def identity(self) -> Identity:
        """Name plate of the simulated counter card."""
        details = {"preset": self.options.preset, "seed": str(self.options.seed)}
        serial = self.description.counter.serial
        return Identity("counter", "simulated", "counter of the twin", serial, details=details)

    def select(self, channels: frozenset[str]) -> None:
        """Generate edges of these channels only."""
        with self._lock:
            self._selected = channels
            self._activate()

    def _activate(self) -> None:
        """Generate the edges of the selected channels, and of the standard's read-out."""
        wanted = self._selected | (self.readout.channels if self.readout else frozenset())
        self._twin.set_active_channels([name for name in CHANNELS if name in wanted])

    def read_block(self, duration_s: float) -> Block:
        """Run the twin for a duration, with the drives' ramps and watchdogs."""
        with self._lock:
            if self._closed:
                raise BenchError("the simulated counter is closed", "an open bench")
            start_s = self._twin.time_s
            ran = self._twin.advance(duration_s, self._conduct)
            self._keep(ran)
            block = _block_of(ran, start_s, self._twin.time_s)
            if self.readout is not None:
                block = self.readout.take(block)
            return block

    def close(self) -> None:
        """Release the bench."""
        self._closed = True

    def _conduct(self, remaining_s: float) -> float:
        """Apply the drives' present set points; return the time for which they stay valid."""
        self._watch(self._twin.time_s)
        ramping = any(axes.moving for axes in self._axes.values())
        step_s = min(RAMP_STEP_S, remaining_s) if ramping else remaining_s
        step_s = min(step_s, self._watched_s(self._twin.time_s))
        self._drive(step_s)
        return step_s

    def _watch(self, now_s: float) -> None:
        """Switch off drives whose watchdog hasn't been fed in time."""
        for side, axes in self._axes.items():
            drive = self.drives[side]
            unfed_s = now_s - axes.fed_s
            expired = unfed_s >= drive.watchdog_s - 1e-9
            if axes.enabled and expired and not drive.unguarded():
                self._note(side, "watchdog")
                axes.fault = Message("watchdog not fed for {watchdog_s:g} s", drive.watchdog_s)
                self._set_enabled(side, False)

    def _watched_s(self, now_s: float) -> float:
        """Return the time until the next watchdog trips if it isn't fed."""
        left = [
            axes.fed_s + self.drives[side].watchdog_s - now_s
            for side, axes in self._axes.items()
            if axes.enabled
        ]
        return min((left_s for left_s in left if left_s > 0.0), default=float("inf"))

    def _drive(self, step_s: float) -> None:
        """Advance the drives' ramps by a step of time."""
        for side, axes in self._axes.items():
            if axes.torque.step(step_s):
                self._twin.command_torque(side, axes.torque.present)
            if axes.speed.step(step_s):
                self._twin.command_speed(side, axes.speed.present)

    def _keep(self, block: TwinBlock) -> None:
        """Keep the true torques and the temperatures of a block."""
        self._temperatures = {name: float(t) for name, t in block.temperatures.items()}
        torque = block.truth.torque_nm
        self._truth.append(
            Record({"time_s": block.truth.time_s, **{side: torque[side] for side in SIDES}})
        )

    # -- drives (called by SimulatedDrive) --------------------------------------------------

    def _set_enabled(self, side: Side, enabled: bool) -> None:
        """Switch a drive on or off, without set points; switching on ends a fault."""
        with self._lock:
            axes = self._axes[side]
            self._note(side, "on" if enabled else "off")
            self._twin.enable(side, enabled)
            fault = "" if enabled else axes.fault
            self._axes[side] = _Axes(enabled=enabled, fed_s=self._twin.time_s, fault=fault)

    def _reset_fault(self, side: Side) -> None:
        with self._lock:
            self._axes[side].fault = ""

    def _command(
        self, side: Side, quantity: Literal["torque", "speed"], target: float, rate: float
    ) -> None:
        """Begin a ramp of a drive's torque or speed; refuse a drive that is off."""
        with self._lock:
            axes = self._axes[side]
            if not axes.enabled:
                raise BenchError(
                    Message(
                        "the {side} drive is off{fault}",
                        side,
                        ": " + axes.fault if axes.fault else "",
                    ),
                    "commands to an enabled drive",
                    "enable it first",
                )
            self._note(side, f"{quantity} to {target:g}")
            ramp = axes.torque if quantity == "torque" else axes.speed
            ramp.target, ramp.rate = target, rate
            axes.controls = quantity

    def _ramp_to_zero(self, side: Side, duration_s: float) -> None:
        """Ramp torque and speed to zero in a duration."""
        with self._lock:
            self._note(side, f"to zero in {duration_s:g} s")
            for ramp in (self._axes[side].torque, self._axes[side].speed):
                ramp.target = 0.0
                ramp.rate = abs(ramp.present) / duration_s if duration_s > 0.0 else float("inf")

    def _note(self, side: Side, event: str) -> None:
        """Log an event of a drive with its set points."""
        axes = self._axes[side]
        self.drives[side].log.append(
            DriveEvent(self._twin.time_s, event, axes.torque.present, axes.speed.present)
        )

    def _feed(self, side: Side) -> None:
        self._axes[side].fed_s = self._twin.time_s

    def _ramping(self, side: Side) -> bool:
        return self._axes[side].moving

    def _state(self, side: Side) -> DriveState:
        axes = self._axes[side]
        return DriveState(axes.enabled, axes.torque.present, axes.speed.present, axes.fault)

    # -- mode conversion, clamp, probes, operator -------------------------------------------

    def set_mode(self, side: Side, mode: Mode) -> None:
        """Change the mode of one side."""
        with self._lock:
            self._twin.set_mode(side, mode)
            self._modes[side] = mode

    def mode(self, side: Side) -> Mode:
        """Present mode of one side."""
        return self._modes[side]

    def set_clamped(self, clamped: bool) -> None:
        """Close or open the clamp."""
        with self._lock:
            self._twin.set_clamped(clamped)
            self._clamped = clamped

    def clamped(self) -> bool:
        """Whether the clamp is closed."""
        return self._clamped

    def move(self, position: RailPosition) -> None:
        """Move the guide rail, at once."""
        self._rail = position

    def position(self) -> RailPosition:
        """Position of the guide rail."""
        return self._rail

    def supplies(self) -> bool:
        """Whether the drives' supply is on."""
        return self._supplied

    def switch_supply(self, on: bool) -> None:
        """Switch the supply; off takes the power off both drives."""
        self._supplied = on
        if not on:
            for side in SIDES:
                self._set_enabled(side, False)

    def temperatures(self) -> Mapping[str, float]:
        """All probes, °C."""
        return self._temperatures

    def mount(self, mounting: Mounting) -> None:
        """Mount a part at once: the simulated operator never declines."""
        with self._lock:
            self._twin.mount(mounting)
            self._mounted = mounting
            if self.readout is not None:
                self.readout.connect(self.description.standard(mounting))
                self._activate()

    def mounted(self) -> Mounting:
        """Return the mounting between the flanges."""
        return self._mounted

    def hold(self, reducer: ReducerDescription | None, serial: str = "") -> None:
        """Select a reducer of this type to be mounted next; None selects the bench's own reducer.

        Another serial number gives another specimen. A type that isn't packaged is derived from the
        packaged type of the closest rated torque, with its own ratio.
        """
        options = self.options
        if reducer is not None:
            rated_nm = reducer.rated_torque_nm
            name = min(
                REDUCERS, key=lambda each: abs(np.log(REDUCERS[each].rated_torque_nm / rated_nm))
            )
            held: dict[str, Any] = {"reducer": name}
            if serial and options.reducer_seed is None:
                held["reducer_seed"] = zlib.crc32(serial.encode())
            options = options.model_copy(update=held)
        constants = options.parameters().reducer
        if reducer is not None:
            constants = constants._replace(ratio=reducer.signed_ratio)
        with self._lock:
            self._twin.hold(constants)

    def seat(self, _seating: Seating) -> None:
        """Re-seat the mounted part at once."""
        mounted = self._mounted
        self.mount("nothing")
        self.mount(mounted)

    def cancel(self) -> None:
        """Do nothing: nobody waits for the simulated operator."""

    # -- simulation only --------------------------------------------------------------------

    def true_torque(self, side: Side, start_s: float, stop_s: float) -> float:
        """Return the mean true torque at the flange over a window of the past, N·m."""
        return float(self.true_means(side, np.array([start_s, stop_s]))[0])

    def true_means(self, side: Side, edges_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return mean true torques between rising times that were already simulated, N·m.

        Between two steps of the twin, the torque is a straight line, as for its edges.
        """
        around_s = 2.0 / TRUTH_RATE_HZ
        truth = self._truth.window(edges_s[0] - around_s, edges_s[-1] + around_s)
        if truth is None or not len(truth) or truth.time_s[0] > edges_s[0] + around_s:
            raise BenchError(
                Message("true torque from {start_s:.3f} to {end_s:.3f} s", edges_s[0], edges_s[-1]),
                Message("the last {truth_kept_s:g} s of bench time", KEPT_S),
            )
        at = np.union1d(truth.time_s, edges_s)
        values = np.interp(at, truth.time_s, truth[side])
        area = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(at) * (values[1:] + values[:-1]))])
        return np.asarray(np.diff(area[np.searchsorted(at, edges_s)]) / np.diff(edges_s))

    def dense_sweep(
        self, side: Side, true_torque_nm: NDArray[np.float64], *, alone: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
        """Noise-free readings along a path of true torques, and the branch of each point."""
        with self._lock:
            sweep = self._twin.static_sweep(side, true_torque_nm, alone=alone)
        return sweep.reading_nm, sweep.branch

    def mounting(self) -> dict[str, float | str]:
        """Return the readings of dial gauge and clamp gauge, without waiting."""
        drawn = self.options.parameters()
        offsets = [
            chain.coaxiality_error_m
            for side in (drawn.input, drawn.output)
            for chain in side.geometry
        ]
        return {
            "coaxiality_mm": round(1e3 * max(offsets), 4),
            "clamp_pressure_bar": CLAMP_BAR,
            "lubricant": self.options.lubricant,
            "lubricant_hours": self.options.lubricant_hours,
        }

    def certificates(self) -> dict[Mounting, dict[Side, ReferenceCertificate]]:
        """Certificates of the simulated standards."""
        certificates: dict[Side, ReferenceCertificate] = {}
        for side in SIDES:
            certificate = self._twin.certificate(side)
            certificates[side] = ReferenceCertificate(
                certificate.torque_nm, certificate.error_nm, certificate.expanded_uncertainty_nm
            )
        return {"calibrator": certificates}

    def encoder_certificates(self) -> dict[Side, EncoderCertificate]:
        """Certificates of the simulated encoders."""
        return {side: EncoderCertificate(*self._twin.encoder_certificate(side)) for side in SIDES}

    def reducer_certificate(self) -> tuple[CertifiedFriction, ...]:
        """Certified no-load friction of the selected reducer, at 23 °C."""
        speeds = np.array([20.0, 50.0, *(100.0 * k for k in range(1, 13))])
        no_load_nm = self._twin.no_load_nm(speeds)
        scatter = np.random.default_rng([self.options.seed, 17]).standard_normal(speeds.size)
        stated = no_load_nm + 0.5 * CERTIFIED_FRICTION_U_NM * scatter
        return tuple(
            CertifiedFriction(
                speed_rpm=float(speed),
                torque_nm=float(torque),
                expanded_uncertainty_nm=CERTIFIED_FRICTION_U_NM,
            )
            for speed, torque in zip(speeds, stated, strict=True)
        )


class SimulatedDrive:
    """One drive of the simulated bench.

    Attributes
    ----------
    watchdog_s : float
        Time without feeding after which it switches off, from the description or from a client.
    log : deque of DriveEvent
        Commands and reactions, the newest last.
    unguarded : callable
        Whether its watchdog is disabled.
    """

    def __init__(self, bench: SimulatedBench, side: Side) -> None:
        self._bench = bench
        self._side = side
        self.watchdog_s = bench.description.module(side).drive.watchdog_s
        self.log: deque[DriveEvent] = deque(maxlen=LOGGED)
        self.unguarded: Callable[[], bool] = lambda: False

    def identity(self) -> Identity:
        """Name plate of the simulated drive."""
        drive = self._bench.description.module(self._side).drive
        return Identity(f"{self._side}.drive", "simulated", "drive of the twin", drive.serial)

    def limits(self) -> DriveLimits:
        """Return no limits: only the bench's own limits apply."""
        return DriveLimits()

    def enable(self) -> None:
        """Power the motor at zero torque."""
        self._bench._set_enabled(self._side, True)

    def disable(self) -> None:
        """Switch off the power."""
        self._bench._set_enabled(self._side, False)

    def reset_fault(self) -> None:
        """Reset a fault; the drive stays off."""
        self._bench._reset_fault(self._side)

    def command_torque(self, torque_nm: float, ramp_nm_per_s: float) -> None:
        """Ramp to a torque at a limited rate."""
        self._bench._command(self._side, "torque", torque_nm, ramp_nm_per_s)

    def command_speed(self, speed_rad_s: float, ramp_rad_per_s2: float) -> None:
        """Ramp to a speed at a limited rate."""
        self._bench._command(self._side, "speed", speed_rad_s, ramp_rad_per_s2)

    def ramp_to_zero(self, duration_s: float) -> None:
        """Ramp torque and speed to zero."""
        self._bench._ramp_to_zero(self._side, duration_s)

    def feed_watchdog(self) -> None:
        """Reset the watchdog."""
        self._bench._feed(self._side)

    def state(self) -> DriveState:
        """Active set points."""
        return self._bench._state(self._side)

    @property
    def ramping(self) -> bool:
        """Whether a set point is still ramping to its target."""
        return self._bench._ramping(self._side)

    def close(self) -> None:
        """Do nothing: there is nothing to release."""


def open_simulated(description: BenchDescription) -> DriverSet:
    """Open the simulated bench that a description describes.

    Raises
    ------
    InputError
        A key of the section `[driver]` is wrong.
    """
    bench = SimulatedBench(description)
    return DriverSet(
        name="simulated",
        counter=bench,
        drives=bench.drives,
        modes=bench,
        clamp=bench,
        temperature=bench,
        operator=bench,
        reference=bench.readout,
        rail=None if description.guide_rail is None else bench,
        supply=None if description.power_supply is None else bench,
        truth=bench,
        certificates=bench.certificates(),
        encoder_certificates=bench.encoder_certificates(),
        reducer_certificate=bench.reducer_certificate(),
        hold=bench.hold,
        simulated_time=True,
        blocking=False,
    )


def _block_of(ran: TwinBlock, start_s: float, stop_s: float) -> Block:
    """Return the twin's edges and encoder counts as a driver's block."""
    edges = {
        str(channel): EdgeBlock(ticks, ran.start_tick, ran.stop_tick, ran.timebase_hz)
        for channel, ticks in ran.edges.items()
    }
    angles = {
        angle_channel(side): Record({"time_s": samples.time_s, "angle_counts": samples.counts})
        for side, samples in ran.angles.items()
    }
    return Block(start_s, stop_s, edges, angles)
