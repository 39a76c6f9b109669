"""Transmission error: both angles over full output revolutions, without load, at low speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.certificates.encoder import EncoderCertificate, encoder_certificates
from torquebench.bench.devices import BenchDevices
from torquebench.bench.roles import SIDES, Side
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.procedures.guarding import turning_limits
from torquebench.procedures.messages import (
    again_after_pause,
    checkpoint,
    leg_checkpoint,
    move,
    progress,
    sleep,
    take,
)
from torquebench.procedures.reducers.setup import (
    REDUCER_SETUP,
    ReducerLimits,
    directions,
    run_metadata,
    stamp,
    temperature_c,
    turn_output,
)
from torquebench.procedures.setup import REST_S, Plan, measured_in, power_on
from torquebench.signals import Record
from torquebench.units import MINUTE, RAD_S_PER_RPM

CHUNK_S = 2.0
"""Bench time of one interval of the recorder, s."""


@dataclass(frozen=True)
class TransmissionSettings:
    """Settings of the transmission error.

    Parameters
    ----------
    output_rpm : float
        Speed of the output, 1/min.
    revolutions : float
        Number of evaluated output revolutions, at least 1.
    margin : float
        Additional turning beyond them, output revolutions.
    clockwise, counter_clockwise : bool
        Directions that are driven.
    settle_s : float
        Time at speed before recording begins, s.
    """

    output_rpm: float = 2.0
    revolutions: float = 1.0
    margin: float = 0.02
    clockwise: bool = True
    counter_clockwise: bool = True
    settle_s: float = 2.0

    def __post_init__(self) -> None:
        if not (self.output_rpm > 0.0 and self.revolutions >= 1.0 and self.margin > 0.0):
            raise InputError(
                Message(
                    "{revolutions:g} output revolutions at {output_rpm:g} rpm",
                    self.revolutions,
                    self.output_rpm,
                ),
                "at least one revolution, a speed above 0 rpm and a margin above 0",
                "a transmission error belongs to full revolutions of the output",
            )
        directions(self)


@dataclass(frozen=True, eq=False)
class AngleRecording:
    """Angles of both sides at the same times.

    Parameters
    ----------
    direction : int
        +1 clockwise.
    time_s, input_angle_rad, output_angle_rad : float64[n]
    """

    direction: int
    time_s: NDArray[np.float64]
    input_angle_rad: NDArray[np.float64]
    output_angle_rad: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TransmissionRecording:
    """Recorded data of a transmission error test.

    Parameters
    ----------
    revolutions : float
        Speed and revolutions as in the settings.
    temperature_c : float
        Temperature of the reducer, °C; NaN without a probe.
    counts_per_revolution : mapping of side to int
        Resolution of the encoders.
    certified_rad : mapping of side to float
        Standard uncertainty of the angles of encoders that were corrected by their certificates,
        rad.
    """

    directions: tuple[AngleRecording, ...]
    output_rpm: float
    revolutions: float
    temperature_c: float
    counts_per_revolution: dict[Side, int]
    certified_rad: dict[Side, float]


def transmission_error(
    devices: BenchDevices, limits: ReducerLimits, settings: TransmissionSettings | None = None
) -> Plan[TransmissionRecording]:
    """Turn the input with the output free, over full output revolutions in each direction.

    A direction that a pause interrupts is driven again.

    Raises
    ------
    LimitError
        The speed exceeds the limits of data sheet or bench; nothing has moved yet.
    BenchError
        The output doesn't turn by the reducer's ratio.
    """
    settings = settings or TransmissionSettings()
    input_rpm = settings.output_rpm * abs(limits.ratio)
    limits.check_input_speed(input_rpm)
    signs = directions(settings)
    chunks = _chunks(settings)
    recordings: list[AngleRecording] = []
    temperature: list[float] = []
    metadata = run_metadata(
        devices,
        "transmission_error",
        limits,
        len(signs) * chunks,
        settings=asdict(settings),
        side="input",
    )

    def measured() -> Plan[None]:
        """Record a revolution in each direction."""
        yield from checkpoint()
        yield from turn_output(devices, limits, 10.0)
        for number, sign in enumerate(signs):
            steps = number * chunks, len(signs) * chunks
            recorded = partial(_revolution, devices, limits, settings, sign, steps)
            recordings.append((yield from again_after_pause(recorded)))
            temperature.append((yield from temperature_c(devices)))
        yield from progress(len(signs) * chunks, len(signs) * chunks, "done")

    limits_of_speed = turning_limits(devices, "input", max(input_rpm, limits.turning_rpm))
    yield from measured_in(REDUCER_SETUP, devices, measured(), metadata, limits_of_speed)
    description = devices.context.description
    certificates = encoder_certificates(description, devices.context.drivers.encoder_certificates)
    return TransmissionRecording(
        directions=tuple(_corrected(recording, certificates) for recording in recordings),
        output_rpm=settings.output_rpm,
        revolutions=settings.revolutions,
        temperature_c=float(np.mean(temperature)),
        counts_per_revolution={
            side: description.needed_encoder(side).counts_per_revolution for side in SIDES
        },
        certified_rad={
            side: certificate.standard_uncertainty_rad for side, certificate in certificates.items()
        },
    )


def _corrected(
    recording: AngleRecording, certificates: Mapping[Side, EncoderCertificate]
) -> AngleRecording:
    """Correct the angles by the encoders' certificates."""
    input_rad, output_rad = recording.input_angle_rad, recording.output_angle_rad
    if "input" in certificates:
        input_rad = certificates["input"].correct(input_rad)
    if "output" in certificates:
        output_rad = certificates["output"].correct(output_rad)
    return replace(recording, input_angle_rad=input_rad, output_angle_rad=output_rad)


def _chunks(settings: TransmissionSettings) -> int:
    turning_s = (settings.revolutions + settings.margin) * MINUTE / settings.output_rpm
    return int(np.ceil(turning_s / CHUNK_S))


def _revolution(
    devices: BenchDevices,
    limits: ReducerLimits,
    settings: TransmissionSettings,
    sign: int,
    done: tuple[int, int],
) -> Plan[AngleRecording]:
    """Record one direction."""
    parts = _AngleParts(sign)
    speed = sign * settings.output_rpm * limits.ratio * RAD_S_PER_RPM
    yield from power_on(devices, "input")
    yield from move(devices.input.drive.speed, speed)
    yield from sleep(settings.settle_s)
    yield from move(devices.recorder, "mark")
    for chunk in range(_chunks(settings)):
        yield from progress(done[0] + chunk, done[1], "clockwise" if sign > 0 else "counter-cl.")
        yield from leg_checkpoint()
        yield from stamp(devices, series=sign, step=chunk, branch=sign)
        yield from sleep(CHUNK_S)
        yield from take(devices.recorder, devices.point, stream="points")
        parts.add(devices.recorder.angles)
    yield from move(devices.input.drive.speed, 0.0)
    yield from sleep(REST_S)
    return parts.joined()


class _AngleParts:
    """Intervals of both encoders, concatenated."""

    def __init__(self, direction: int) -> None:
        self._direction = direction
        self._parts: list[tuple[NDArray[np.float64], ...]] = []

    def add(self, angles: dict[Side, Record]) -> None:
        """Append the angles of both sides over their common samples."""
        if not angles:  # a rehearsal records nothing
            return
        first, second = angles["input"], angles["output"]
        count = min(len(first), len(second))
        self._parts.append(
            (first.time_s[:count], first["angle_rad"][:count], second["angle_rad"][:count])
        )

    def joined(self) -> AngleRecording:
        if not self._parts:
            return AngleRecording(self._direction, *(np.empty(0) for _ in range(3)))
        columns = [np.concatenate(column) for column in zip(*self._parts, strict=True)]
        return AngleRecording(self._direction, *columns)
