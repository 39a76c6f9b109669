"""Readings of the bench: pulse trains by channel, encoder counts, and static sweeps."""

from collections.abc import Sequence

import numpy as np

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.twin import simulation
from torquebench.twin.blocks import (
    CHANNELS,
    AngleSamples,
    Channel,
    FloatArray,
    Nameplate,
    Side,
    StaticSweep,
    TickArray,
)
from torquebench.twin.calibrator import ReferenceParameters
from torquebench.twin.chain import ChainConstants
from torquebench.twin.counter import EdgeSource
from torquebench.twin.faults import Fault, broken_counts
from torquebench.twin.parameters import EncoderConstants, TwinParameters
from torquebench.twin.transducer import (
    REFERENCE_TEMPERATURE_C,
    TransducerConstants,
    fresh_transducer_state,
)
from torquebench.twin.turning import TurningConstants
from torquebench.units import TURN


def side_of(channel: str) -> Side:
    """Return the side to which a channel belongs."""
    if channel not in CHANNELS:
        raise InputError(
            Message("channel {channel!r}", channel), Message("one of {list}", ", ".join(CHANNELS))
        )
    return "input" if channel.startswith("input") else "output"


def nameplate(parameters: TwinParameters, channel: Channel) -> Nameplate:
    """Return a transducer's nominal data: zero at the carrier, span half of it, 75 % valid."""
    side = parameters.input if side_of(channel) == "input" else parameters.output
    nominal, carrier = side.transducer.nominal_torque_nm, parameters.carrier_hz
    return Nameplate(nominal, carrier, 0.5 * carrier / nominal, (0.25 * carrier, 1.75 * carrier))


def new_sources(
    parameters: TwinParameters,
    generators: Sequence[np.random.Generator],
    timebase_hz: float,
    step_ticks: int,
) -> dict[Channel, EdgeSource]:
    """Return pulse trains of all channels, each with its own generator of jitter."""
    sources = {}
    for channel, generator in zip(CHANNELS, generators, strict=True):
        side = parameters.input if side_of(channel) == "input" else parameters.output
        delay_s = side.transducer.delay_s
        if channel.endswith("reference"):
            delay_s = side.calibrator.constants.delay_s
        sources[channel] = EdgeSource(
            generator, timebase_hz, step_ticks, parameters.counter, delay_s
        )
    return sources


def encoder_samples(
    encoder: EncoderConstants,
    angle_rad: FloatArray,
    ticks: TickArray,
    timebase_hz: float,
    faults: Sequence[Fault],
) -> AngleSamples:
    """Convert angles to counts, with graduation error and faults."""
    displayed = angle_rad + _graduation_error(encoder, angle_rad)
    counts = np.floor(displayed * encoder.counts_per_revolution / TURN).astype(np.int64)
    return AngleSamples(
        ticks / timebase_hz,
        broken_counts(faults, counts, ticks),
        encoder.counts_per_revolution,
    )


def encoder_certificate(
    encoder: EncoderConstants, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Calibrate an encoder every 5°: indicated angle, error and its expanded uncertainty, rad.

    The expanded uncertainty is a fifth of the largest graduation error by the data sheet.
    """
    angle = np.linspace(0.0, TURN, 72, endpoint=False, dtype=np.float64)
    error = _graduation_error(encoder, angle)
    expanded = 0.2 * encoder.accuracy_rad
    measured = error + 0.5 * expanded * generator.standard_normal(angle.size)
    return angle, measured, np.full(angle.size, expanded)


def _graduation_error(encoder: EncoderConstants, angle_rad: FloatArray) -> FloatArray:
    """Return the errors of an encoder's graduation: one and two waves a turn."""
    error = np.zeros_like(angle_rad)
    for k in range(2):
        error += encoder.error_rad[k] * np.sin((k + 1) * angle_rad + encoder.error_phase_rad[k])
    return error


def static_sweep(
    chain: ChainConstants,
    transducer: TransducerConstants,
    turning: TurningConstants,
    reference: ReferenceParameters,
    plate: Nameplate,
    path_nm: FloatArray,
    *,
    temperature_c: float | None,
    speed_rad_s: float,
    angle_rad: float,
    preload: bool,
) -> StaticSweep:
    """Return noise-free readings along a path, see `BenchTwin.static_sweep`."""
    path = np.ascontiguousarray(path_nm, dtype=np.float64)
    if path.ndim != 1 or path.size == 0 or not np.isfinite(path).all():
        raise InputError(
            Message("a path of shape {shape}", path.shape),
            "one dimension, at least one point, all finite",
        )
    frequency, reference_hz = np.empty(path.size), np.empty(path.size)
    state, table = fresh_transducer_state(), reference.error_table()

    def run(points: FloatArray) -> None:
        """Sweep the chain over points, and keep its state for the next ones."""
        simulation.sweep(
            chain,
            transducer,
            turning,
            reference.constants,
            table,
            points,
            REFERENCE_TEMPERATURE_C if temperature_c is None else float(temperature_c),
            float(speed_rad_s),
            float(angle_rad),
            state,
            frequency,
            reference_hz,
        )

    if preload:
        run(path)
    run(np.zeros(1))
    zero_hz, reference_zero_hz = float(frequency[0]), float(reference_hz[0])
    run(path)
    return StaticSweep(
        true_torque_nm=path,
        reading_nm=(frequency - zero_hz) / plate.sensitivity_hz_per_nm,
        frequency_hz=frequency,
        reference_nm=(reference_hz - reference_zero_hz) / plate.sensitivity_hz_per_nm,
        branch=np.sign(np.diff(np.abs(path), prepend=0.0)).astype(np.int8),
    )
