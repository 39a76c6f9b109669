"""One torque channel from edges to torque, with its recent samples."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Sequence
from math import isnan

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.certificates.torque import ReferenceCertificate, read_certificate
from torquebench.bench.description import BenchDescription, TransducerDescription
from torquebench.bench.drivers.base import DriverSet, ReferenceSamples
from torquebench.bench.roles import SIDES, Mounting, Side, reference_channel, torque_channel
from torquebench.bench.samples import ChannelSamples, FineCount, SampleRing
from torquebench.bench.slices import joined_edges
from torquebench.errors import InputError, SignalFault
from torquebench.message import Message
from torquebench.signals import (
    EdgeBlock,
    FrequencyCounter,
    FrequencySamples,
    FrequencyScale,
    SignalFaultKind,
    TorqueSamples,
)

__all__ = ["Channel", "certificates", "open_channel"]

KEPT_S = 120.0
STUCK_SPREAD = 8.0
"""Largest spread of a stuck frequency, in standard uncertainties of the counter. 25 windows with
only the counter's own noise spread over 4 of them; a transducer's output is never that quiet.
"""


class Channel:
    """Counter, scale, certificate and recent samples of one transducer.

    Parameters
    ----------
    name, side, standard
        As in `ChannelSamples`.
    transducer : TransducerDescription
    counter : FrequencyCounter
    window_s : float
        Length of the counter's windows, s.
    stuck_s : float
        Time after which a frequency without noise is stuck, s.
    certificate : ReferenceCertificate, optional
        Corrects the torque of a standard.
    """

    def __init__(
        self,
        name: str,
        side: Side,
        standard: bool,
        transducer: TransducerDescription,
        counter: FrequencyCounter,
        window_s: float,
        stuck_s: float,
        certificate: ReferenceCertificate | None,
    ) -> None:
        self.name = name
        self.side = side
        self.standard = standard
        self.transducer = transducer
        self.certificate = certificate
        self._counter = counter
        self._scale = transducer.scale()
        self._stuck_windows = max(2, round(stuck_s / window_s))
        self._ring = SampleRing(columns=3, capacity=round(KEPT_S / window_s))
        self._counted: deque[float] = deque(maxlen=self._stuck_windows)
        self._fine: _FineWindows | None = None
        self.fine: FineCount | None = None
        """Shorter windows of the last block of edges; None without any."""

    @property
    def scale(self) -> FrequencyScale:
        """From frequency to torque, with the zero in use."""
        return self._scale

    @property
    def zero_hz(self) -> float:
        """Zero in use, Hz."""
        return self._scale.zero

    @zero_hz.setter
    def zero_hz(self, value: float) -> None:
        nominal = self._scale.nominal_zero_hz
        allowed = 0.02 * nominal
        if not abs(value - nominal) <= allowed:
            raise SignalFault(
                Message("{name}: zero at {value:.1f} Hz", self.name, value),
                Message(
                    "{low:g} to {high:g} Hz, within 2 % of nominal",
                    nominal - allowed,
                    nominal + allowed,
                ),
                "unload the transducer before zeroing and check its option",
            )
        self._scale = self._scale.with_zero(value)

    def push(self, edges: EdgeBlock) -> ChannelSamples:
        """Take the next block of edges; return the windows that it completes."""
        fine = self.fine = self._fine
        if fine is not None and fine.over(edges):
            self._fine = None
        return self.push_frequency(self._counter.push(edges))

    def count_finely(self, window_s: float) -> None:
        """Count shorter windows in addition, from the next block on.

        Asking again prolongs it. An instrument that counts by itself has none.
        """
        fine = self._fine
        if fine is None or fine.window_s != window_s:
            self._fine = _FineWindows(self, self._counter, window_s)
        else:
            fine.prolong()

    def fine_window(self, start_s: float, stop_s: float) -> TorqueSamples | None:
        """Return the short windows in [start, stop), uncorrected by a certificate; None without."""
        fine = self._fine
        if fine is None:
            return None
        rows = fine.ring.window(start_s, stop_s)
        return TorqueSamples(
            time_s=rows[0],
            fault=rows[2].astype(np.uint8),
            torque_nm=rows[1],
            standard_uncertainty_nm=np.full(rows[0].size, np.nan),
        )

    def push_frequency(self, counted: FrequencySamples) -> ChannelSamples:
        """Take the next windows of an instrument that counts by itself."""
        frequency = self._with_stuck(counted)
        torque = self._scale.torque_samples(frequency)
        value = torque.torque_nm
        if self.certificate is not None:
            value = self.certificate.correct(value)
        return self._kept(
            torque.time_s,
            frequency.frequency_hz,
            value,
            torque.fault,
            torque.standard_uncertainty_nm,
        )

    def _with_stuck(self, frequency: FrequencySamples) -> FrequencySamples:
        """Mark windows of a frequency that has lost all noise of its own."""
        count = frequency.frequency_hz.size
        if count == 0:
            return frequency
        # The frequency as counted: windows marked as faulty before would hide a lasting fault.
        recent = self._counted
        recent.extend(frequency.frequency_hz[-self._stuck_windows :].tolist())
        if len(recent) < self._stuck_windows or isnan(sum(recent)):  # NaN: a faulty window
            return frequency
        if max(recent) - min(recent) < STUCK_SPREAD * frequency.standard_uncertainty_hz[-1]:
            everywhere = np.ones(count, dtype=np.bool_)
            return frequency.marked(everywhere, SignalFaultKind.STUCK)
        return frequency

    def take(self, read: ReferenceSamples) -> ChannelSamples:
        """Take the samples of a standard that states torque itself."""
        lost = ~np.isfinite(read.torque_nm)
        fault = np.where(lost, np.uint8(SignalFaultKind.LOST_DATA), np.uint8(0))
        # The frequency that would have stated this torque, for zeroing.
        frequency = self.transducer.scale().frequency(read.torque_nm)
        value = np.full(frequency.shape, np.nan)
        value[~lost] = self._scale.torque(frequency[~lost])
        if self.certificate is not None:
            value = self.certificate.correct(value)
        return self._kept(read.time_s, frequency, value, fault)

    def _kept(
        self,
        time_s: NDArray[np.float64],
        frequency_hz: NDArray[np.float64],
        torque_nm: NDArray[np.float64],
        fault: NDArray[np.uint8],
        counter_nm: NDArray[np.float64] | None = None,
    ) -> ChannelSamples:
        self._ring.append(time_s, frequency_hz, torque_nm, fault)
        return ChannelSamples(
            self.name, self.side, self.standard, time_s, frequency_hz, torque_nm, fault, counter_nm
        )

    def window(self, start_s: float, stop_s: float) -> ChannelSamples:
        """Return the samples whose windows' centres lie in [start, stop); faults are among them."""
        rows = self._ring.window(start_s, stop_s)
        fault = rows[3].astype(np.uint8)
        return ChannelSamples(self.name, self.side, self.standard, rows[0], rows[1], rows[2], fault)

    def latest(self) -> ChannelSamples:
        """Return the newest window.

        Raises
        ------
        SignalFault
            It is faulty, or there is no sample yet.
        """
        row = self._ring.last()
        if row is None:
            raise SignalFault(Message("{name}: no sample yet", self.name), "a running acquisition")
        newest = ChannelSamples(
            self.name,
            self.side,
            self.standard,
            row[0:1],
            row[1:2],
            row[2:3],
            row[3:4].astype(np.uint8),
        )
        newest.raise_on_fault()
        return newest

    def torque(self, frequency_hz: float) -> float:
        """Torque of one frequency by the present zero, N·m."""
        value = self._scale.torque(frequency_hz)
        if self.certificate is not None:
            value = self.certificate.correct(value)
        return float(value)


class _FineWindows:
    """Windows shorter than the bench's own, computed while they are requested."""

    def __init__(self, channel: Channel, like: FrequencyCounter, window_s: float) -> None:
        self.window_s = window_s
        self._channel = channel
        self.ring = SampleRing(columns=2, capacity=round(KEPT_S / window_s))
        self._counter = FrequencyCounter(like.method, window_s, like.timebase_hz)
        self._remaining_s = KEPT_S

    def prolong(self) -> None:
        """Continue for the ring's duration."""
        self._remaining_s = KEPT_S

    def count(self, edges: Sequence[EdgeBlock]) -> list[TorqueSamples]:
        """Count the next blocks together, which costs little more than one of them."""
        counted = self._counter.push(joined_edges(self._channel.name, edges))
        torque = self._channel.scale.torque_samples(counted)
        self.ring.append(torque.time_s, torque.torque_nm, torque.fault)
        half_s = 0.5 * self.window_s
        ends = [block.stop_tick / block.timebase_hz - half_s * (1.0 - 1e-6) for block in edges]
        cuts = [0, *torque.time_s.searchsorted(ends, side="right").tolist()]
        return [
            TorqueSamples(
                time_s=torque.time_s[part],
                fault=torque.fault[part],
                torque_nm=torque.torque_nm[part],
                standard_uncertainty_nm=torque.standard_uncertainty_nm[part],
            )
            for part in itertools.starmap(slice, itertools.pairwise(cuts))
        ]

    def over(self, edges: EdgeBlock) -> bool:
        """Return whether the last request is longer ago than the ring's duration."""
        self._remaining_s -= (edges.stop_tick - edges.start_tick) / edges.timebase_hz
        return self._remaining_s < 0.0


def open_channel(
    name: str, description: BenchDescription, drivers: DriverSet, mounting: Mounting
) -> Channel:
    """Open a channel as the description has it with this mounting."""
    counting, stuck_s = description.counter, description.safety.stuck_s
    counter = FrequencyCounter(
        counting.method,
        counting.window_s,
        drivers.counter.timebase_hz,
        edge_jitter_s=counting.edge_jitter_s,
    )
    for side in SIDES:
        if name == reference_channel(side):
            standard = description.standard(mounting)
            if standard is None:
                raise InputError(
                    Message("channel {name} with {mounting} mounted", name, mounting),
                    "a mounted standard",
                )
            certificate = certificates(description, drivers, mounting).get(side)
            transducer = standard.transducer(side)
            return Channel(
                name, side, True, transducer, counter, counting.window_s, stuck_s, certificate
            )
    own: Side = "input" if name == torque_channel("input") else "output"
    transducer = description.module(own).transducer
    return Channel(name, own, False, transducer, counter, counting.window_s, stuck_s, None)


def certificates(
    description: BenchDescription, drivers: DriverSet, mounting: Mounting
) -> dict[Side, ReferenceCertificate]:
    """Certificates of a mounted standard: from the description's file, or from the driver."""
    standard = description.standard(mounting)
    if standard is not None and standard.certificate is not None:
        return read_certificate(standard.certificate)
    return dict(drivers.certificates.get(mounting, {}))
