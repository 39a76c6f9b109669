"""Keeps every acquired block in the raw stream of a run's folder."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.drivers.base import AngleSamples
from torquebench.bench.roles import CHANNELS, SIDES, torque_channel
from torquebench.bench.samples import ChannelSamples, Stretch
from torquebench.chain import Torque
from torquebench.records import RunWriter

__all__ = ["NOT_IN_USE", "NO_COUNTS", "RunJournal"]

NOT_IN_USE = 255
"""Fault code of a channel that isn't timed."""
NO_COUNTS = int(np.iinfo(np.int64).min)
"""Counts of a silent encoder."""


class RunJournal:
    """Writes one row a counter window, and every edge where the bench is described so.

    A row holds the time; of each channel frequency, torque and fault; of each side angle, mean
    speed over the block, compensated torque and its standard uncertainty; the probes. Frequencies
    are the counter's; torque is computed with the zero in use, a standard's also with its
    certificate. There is NaN where `fault` isn't 0 and if nothing is compensated. A channel that
    isn't in use has the code `NOT_IN_USE`; an encoder without samples has `NO_COUNTS` and a probe
    that doesn't answer NaN, so that the loss of one signal doesn't end the recording of all others.

    Parameters
    ----------
    writer : RunWriter
    probes : sequence of str
        Temperature probes of the bench, as described.
    edges : bool
        Whether to keep the edges.
    """

    def __init__(self, writer: RunWriter, probes: Sequence[str], *, edges: bool = False) -> None:
        self._writer = writer
        self._probes = tuple(probes)
        self._edges = edges

    def write(self, stretch: Stretch) -> None:
        """Keep blocks; raises `RecordError` when it can't."""
        if self._edges:
            for block in stretch.blocks:
                self._writer.edges(block.edges)
        axis = torque_channel("input")
        first = stretch.channel(axis)
        if first is None or first.time_s.size == 0:
            return
        time_s, blocks = first.time_s, stretch.blocks
        columns: dict[str, NDArray[np.generic] | float] = {"time_s": time_s}
        own = {}
        for name in CHANNELS:
            own[name] = first if name == axis else stretch.channel(name)
            frequency, torque, fault = _on_axis(time_s, own[name])
            columns[f"{name}_hz"] = frequency
            columns[f"{name}_nm"] = torque
            columns[f"{name}_fault"] = fault
        for side in SIDES:
            speeds = [block.speed_rad_s.get(side, np.nan) for block in blocks]
            columns[f"{side}_angle_counts"] = _counts(time_s, stretch.angles(side))
            columns[f"{side}_speed_rad_s"] = stretch.windows(axis, speeds)
            torque, uncertainty = _compensated(
                time_s, own[torque_channel(side)], stretch.compensated.get(side)
            )
            columns[f"{side}_compensated_nm"] = torque
            columns[f"{side}_torque_uncertainty_nm"] = uncertainty
        for probe in self._probes:
            temperatures = [block.temperatures.get(probe, np.nan) for block in blocks]
            columns[f"{probe}_c"] = stretch.windows(axis, temperatures)
        self._writer.samples(columns)


def _counts(time_s: NDArray[np.float64], angles: AngleSamples | None) -> NDArray[np.int64]:
    """Return an encoder's counts at the windows of a channel."""
    if angles is None or angles.counts.size == 0:
        return np.full(time_s.shape, NO_COUNTS, dtype=np.int64)
    place = np.searchsorted(angles.time_s, time_s).clip(max=angles.counts.size - 1)
    return np.asarray(angles.counts[place])


def _compensated(
    time_s: NDArray[np.float64], own: ChannelSamples | None, found: Torque | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compensated torque and its standard uncertainty at the windows of another channel."""
    torque = np.full(time_s.shape, np.nan)
    uncertainty = np.full(time_s.shape, np.nan)
    if own is not None and found is not None:
        there, here = _places(time_s, own.time_s)
        torque[there] = found.value_nm[here]
        uncertainty[there] = found.standard_uncertainty_nm[here]
    return torque, uncertainty


def _on_axis(
    time_s: NDArray[np.float64], samples: ChannelSamples | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint8]]:
    """Frequency, torque and fault of a channel at the windows of another one."""
    if samples is not None and np.array_equal(samples.time_s, time_s):
        return samples.frequency_hz, samples.torque_nm, samples.fault
    frequency = np.full(time_s.shape, np.nan)
    torque = np.full(time_s.shape, np.nan)
    fault = np.full(time_s.shape, NOT_IN_USE, dtype=np.uint8)
    if samples is not None:
        there, here = _places(time_s, samples.time_s)
        frequency[there] = samples.frequency_hz[here]
        torque[there] = samples.torque_nm[here]
        fault[there] = samples.fault[here]
    return frequency, torque, fault


def _places(
    axis_s: NDArray[np.float64], time_s: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the positions of times on an axis."""
    place = np.searchsorted(axis_s, time_s - 1e-6).clip(max=axis_s.size - 1)
    here = np.flatnonzero(np.abs(axis_s[place] - time_s) < 1e-6)
    return place[here], here
