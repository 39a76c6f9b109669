"""From a block of edges to frequency, torque, compensated torque and speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.acceleration import (
    LEAST_SPAN_S,
    UNKNOWN,
    Acceleration,
    EncoderAcceleration,
)
from torquebench.bench.active_chain import ActiveChain, StreamPart, StreamReadings
from torquebench.bench.channels import Channel
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import AngleSamples, CounterBlock, DriverSet
from torquebench.bench.roles import SIDES, Side, torque_channel
from torquebench.bench.samples import (
    AcquiredBlock,
    ChannelSamples,
    FineCount,
    SampleRing,
    Stretch,
)
from torquebench.chain import Torque
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.signals import TorqueSamples
from torquebench.units import RPM_PER_RAD_S, TURN

__all__ = ["BlockEvaluator", "mean_speed"]

FloatArray = NDArray[np.float64]

KEPT_S = 120.0
ANGLE_RATE_HZ = 1000.0


class BlockEvaluator:
    """Evaluates blocks in order, with the values of standard and probes.

    Parameters
    ----------
    description : BenchDescription
    drivers : DriverSet

    Attributes
    ----------
    angles : dict of SampleRing
        Encoder counts of each side over the last two minutes.
    """

    def __init__(self, description: BenchDescription, drivers: DriverSet) -> None:
        self._description = description
        self._drivers = drivers
        rows = round(KEPT_S * ANGLE_RATE_HZ)
        self.angles = {side: SampleRing(columns=1, capacity=rows) for side in SIDES}
        self._accelerations = {side: EncoderAcceleration() for side in SIDES}

    def block(self, index: int, raw: CounterBlock, channels: Sequence[Channel]) -> AcquiredBlock:
        """Return the evaluated block, without compensation and acceleration.

        Parameters
        ----------
        index : int
            Number of the block.
        raw : CounterBlock
        channels : sequence of Channel
            Those in use.

        Raises
        ------
        BenchError
            An instrument fails, or an encoder is another one than described.
        """
        samples: dict[str, ChannelSamples] = {}
        fine: dict[str, FineCount] = {}
        readout = self._drivers.reference
        for channel in channels:
            name = channel.name
            if channel.standard and readout is not None:
                read = readout.read(channel.side, raw.stop_s, raw.timed_s)
                samples[name] = channel.take(read)
            elif name in raw.frequencies:
                samples[name] = channel.push_frequency(raw.frequencies[name])
            elif name in raw.edges:  # the channel was selected after this block was timed
                samples[name] = channel.push(raw.edges[name])
            if channel.fine is not None:
                fine[name] = channel.fine
        speeds: dict[Side, float] = {}
        for side, angle in raw.angles.items():
            self._check_encoder(side, angle)
            self.angles[side].append(angle.time_s, angle.counts)
            if angle.time_s.size >= 2:  # a silent encoder isn't a standstill
                speeds[side] = mean_speed(angle.time_s, angle.counts, angle.counts_per_revolution)
        return AcquiredBlock(
            index=index,
            start_s=raw.start_s,
            stop_s=raw.stop_s,
            channels=samples,
            angles=raw.angles,
            speed_rad_s=speeds,
            temperatures=dict(self._drivers.temperature.temperatures()),
            edges=raw.edges,
            fine=fine,
        )

    def _acceleration(self, side: Side, angle: AngleSamples) -> Acceleration:
        """Return the acceleration over a block; a short one includes samples before it."""
        time_s, counts = angle.time_s, angle.counts
        if time_s.size and time_s[-1] - time_s[0] < LEAST_SPAN_S:
            time_s, counts = self.angles[side].window(
                time_s[-1] - LEAST_SPAN_S, np.nextafter(time_s[-1], np.inf)
            )
        return self._accelerations[side](time_s, counts, angle.counts_per_revolution)

    def _accelerated(self, block: AcquiredBlock) -> AcquiredBlock:
        """Return a block with the accelerations of both sides."""
        found = {side: self._acceleration(side, angle) for side, angle in block.angles.items()}
        return replace(block, accelerations=found)

    def stretch(
        self, blocks: Sequence[AcquiredBlock], compensations: Mapping[Side, ActiveChain]
    ) -> Stretch:
        """Compensate blocks of which each follows the one before, with their accelerations."""
        bare = Stretch(tuple(map(self._accelerated, blocks)))
        fine = {
            name: (windows.window_s, windows.count([block.edges[name] for block in blocks]))
            for name, windows in blocks[0].fine.items()
        }
        return Stretch(
            bare.blocks,
            {
                side: self._compensated(bare, side, active, fine.get(torque_channel(side)))
                for side, active in compensations.items()
                if torque_channel(side) in blocks[0].channels
            },
        )

    def _compensated(
        self,
        stretch: Stretch,
        side: Side,
        active: ActiveChain,
        fine: tuple[float, Sequence[TorqueSamples]] | None,
    ) -> Torque:
        probe = self._description.module(side).temperature_probe
        name, blocks = torque_channel(side), stretch.blocks
        speed_rpm = [block.speed_rad_s.get(side, np.nan) * RPM_PER_RAD_S for block in blocks]
        temperature_c = [block.temperatures.get(probe, np.nan) for block in blocks]

        accelerations = [block.accelerations.get(side, UNKNOWN) for block in blocks]

        module = self._description.module(side)
        by_angle = active.needs_angle and module.encoder.absolute
        delay_s = module.transducer.group_delay_s if by_angle else 0.0

        def readings(parts: Sequence[StreamPart], window_s: float) -> StreamReadings:
            found = StreamReadings.joined(parts, speed_rpm, temperature_c, accelerations)
            angle = self._angles(side, found.time_s - delay_s) if by_angle else None
            return replace(found, angle_rad=angle, window_s=window_s)

        if fine is None:
            active.end_fine()
        else:
            window_s, counted = fine
            parts = [
                (each.time_s, each.torque_nm, each.standard_uncertainty_nm) for each in counted
            ]
            active.push_fine(readings(parts, window_s))
        return active.push(
            readings(
                [
                    (each.time_s, each.torque_nm, each.counter_nm)
                    for each in (block.channels[name] for block in blocks)
                ],
                self._description.counter.window_s,
            )
        )

    def _angles(self, side: Side, time_s: FloatArray) -> FloatArray | None:
        """Return the shaft's angle at times, rad; NaN where the encoder stated none."""
        if not time_s.size:
            return None
        around_s = 2.0 * self._description.counter.window_s
        at, counts = self.angles[side].window(time_s[0] - around_s, time_s[-1] + around_s)
        if at.size < 2:
            return None
        per_revolution = self._description.module(side).encoder.counts_per_revolution
        found = np.interp(time_s, at, counts, left=np.nan, right=np.nan)
        return np.asarray(found * (TURN / per_revolution))

    def _check_encoder(self, side: Side, angle: AngleSamples) -> None:
        described = self._description.module(side).encoder.counts_per_revolution
        if angle.counts_per_revolution != described:
            raise BenchError(
                Message(
                    "{side} encoder delivers {counts_per_revolution} counts per revolution",
                    side,
                    angle.counts_per_revolution,
                ),
                Message("{described}, as described", described),
                Message("correct {side}.encoder.counts_per_revolution", side),
            )


def mean_speed(
    time_s: np.ndarray[Any, np.dtype[np.float64]],
    counts: np.ndarray[Any, Any],
    per_revolution: int,
) -> float:
    """Return the mean speed between the first and the last sample, rad/s."""
    turns = float(counts[-1] - counts[0]) / per_revolution
    return TURN * turns / float(time_s[-1] - time_s[0])
