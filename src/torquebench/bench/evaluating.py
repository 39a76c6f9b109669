"""From a block of edges to what it states: frequency, torque, compensated torque, speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.channels import Channel
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import AngleSamples, CounterBlock, DriverSet
from torquebench.bench.roles import SIDES, Side
from torquebench.bench.samples import (
    AcquiredBlock,
    ChannelSamples,
    SampleRing,
)
from torquebench.chain import Torque
from torquebench.errors import BenchError
from torquebench.units import RPM_PER_RAD_S

__all__ = ["BlockEvaluator", "mean_speed"]

KEPT_S = 120.0
ANGLE_RATE_HZ = 1000.0


class BlockEvaluator:
    """Evaluates blocks in order, with what standard and probes state beside the counter.

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

    def block(
        self,
        index: int,
        raw: CounterBlock,
        channels: Sequence[Channel],
        compensations: Mapping[Side, ActiveChain],
    ) -> AcquiredBlock:
        """Return what a block of edges states.

        Parameters
        ----------
        index : int
            Number of the block.
        raw : CounterBlock
        channels : sequence of Channel
            Those in use.
        compensations : mapping of ActiveChain
            Those that are active, by side.

        Raises
        ------
        BenchError
            An instrument fails, or an encoder is another one than described.
        """
        samples: dict[str, ChannelSamples] = {}
        readout = self._drivers.reference
        for channel in channels:
            if channel.standard and readout is not None:
                read = readout.read(channel.side, raw.stop_s, raw.timed_s)
                samples[channel.name] = channel.take(read)
            elif channel.name in raw.frequencies:
                samples[channel.name] = channel.push_frequency(raw.frequencies[channel.name])
            elif channel.name in raw.edges:  # else selected after this block was timed
                samples[channel.name] = channel.push(raw.edges[channel.name])
        speeds: dict[Side, float] = {}
        for side, angle in raw.angles.items():
            self._check_encoder(side, angle)
            self.angles[side].append(angle.time_s, angle.counts)
            if angle.time_s.size >= 2:  # else the encoder is silent, which is no standstill
                speeds[side] = mean_speed(angle.time_s, angle.counts, angle.counts_per_revolution)
        temperatures = dict(self._drivers.temperature.temperatures())
        return AcquiredBlock(
            index=index,
            start_s=raw.start_s,
            stop_s=raw.stop_s,
            channels=samples,
            compensated=self._compensated(channels, compensations, samples, speeds, temperatures),
            angles=raw.angles,
            speed_rad_s=speeds,
            temperatures=temperatures,
            edges=raw.edges,
        )

    def _check_encoder(self, side: Side, angle: AngleSamples) -> None:
        described = self._description.module(side).encoder.counts_per_revolution
        if angle.counts_per_revolution != described:
            raise BenchError(
                f"{side} encoder delivers {angle.counts_per_revolution} counts per revolution",
                f"{described}, as described",
                f"correct {side}.encoder.counts_per_revolution",
            )

    def _compensated(
        self,
        channels: Sequence[Channel],
        compensations: Mapping[Side, ActiveChain],
        samples: Mapping[str, ChannelSamples],
        speeds: Mapping[Side, float],
        temperatures: Mapping[str, float],
    ) -> dict[Side, Torque]:
        torques: dict[Side, Torque] = {}
        for channel in channels:
            active, read = compensations.get(channel.side), samples.get(channel.name)
            if channel.standard or active is None or read is None:
                continue
            probe = self._description.module(channel.side).temperature_probe
            speed = speeds.get(channel.side, np.nan) * RPM_PER_RAD_S
            temperature, fine = temperatures.get(probe, np.nan), channel.fine_samples
            if fine is None:
                active.end_fine()
            else:
                u = fine.standard_uncertainty_nm
                active.push_fine(fine.time_s, fine.torque_nm, u, speed, temperature)
            torques[channel.side] = active.push(
                read.time_s, read.torque_nm, read.counter_nm, speed, temperature
            )
        return torques


def mean_speed(
    time_s: np.ndarray[Any, np.dtype[np.float64]],
    counts: np.ndarray[Any, Any],
    per_revolution: int,
) -> float:
    """Return the mean speed between the first and the last sample, rad/s."""
    turns = float(counts[-1] - counts[0]) / per_revolution
    return 2.0 * np.pi * turns / float(time_s[-1] - time_s[0])
