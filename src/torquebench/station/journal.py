"""Keeps every acquired block in the raw stream of a run's folder."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.roles import CHANNELS, torque_channel
from torquebench.bench.samples import AcquiredBlock, ChannelSamples
from torquebench.records import RunWriter

__all__ = ["NOT_IN_USE", "RunJournal"]

NOT_IN_USE = 255
"""Fault code of a channel that wasn't timed."""


class RunJournal:
    """Writes one row a counter window: time, each channel's frequency and fault, angles, probes.

    Frequencies are what the counter found, before scale and certificate; NaN where `fault` isn't
    0. A channel that isn't in use has the code `NOT_IN_USE`.

    Parameters
    ----------
    writer : RunWriter
    """

    def __init__(self, writer: RunWriter) -> None:
        self._writer = writer

    def write(self, block: AcquiredBlock) -> None:
        """Keep a block; raises `RecordError` when it can't."""
        time_s = block.channels[torque_channel("input")].time_s
        if time_s.size == 0:
            return
        columns: dict[str, NDArray[np.generic] | float] = {"time_s": time_s}
        for name in CHANNELS:
            frequency, fault = _on_axis(time_s, block.channels.get(name))
            columns[f"{name}_hz"] = frequency
            columns[f"{name}_fault"] = fault
        for side, angles in block.angles.items():
            place = np.searchsorted(angles.time_s, time_s).clip(max=angles.counts.size - 1)
            columns[f"{side}_angle_counts"] = angles.counts[place]
        for probe, temperature in block.temperatures.items():
            columns[f"{probe}_c"] = float(temperature)
        self._writer.samples(columns)


def _on_axis(
    time_s: NDArray[np.float64], samples: ChannelSamples | None
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Frequency and fault of a channel at the windows of another one."""
    if samples is not None and np.array_equal(samples.time_s, time_s):
        return samples.frequency_hz, samples.fault
    frequency = np.full(time_s.shape, np.nan)
    fault = np.full(time_s.shape, NOT_IN_USE, dtype=np.uint8)
    if samples is not None and samples.time_s.size:
        place = np.searchsorted(time_s, samples.time_s - 1e-6).clip(max=time_s.size - 1)
        same = np.abs(time_s[place] - samples.time_s) < 1e-6
        frequency[place[same]] = samples.frequency_hz[same]
        fault[place[same]] = samples.fault[same]
    return frequency, fault
