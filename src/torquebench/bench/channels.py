"""One torque channel: conversion of its instrument's data to torque, with recent values."""

from __future__ import annotations

import math

import numpy as np

from torquebench.bench.blocks import KEPT_S
from torquebench.bench.certificates.torque import ReferenceCertificate, read_certificate
from torquebench.bench.description import BenchDescription, TransducerDescription
from torquebench.bench.drivers.base import CLOCKS_APART_S, DriverSet
from torquebench.bench.roles import SIDES, Mounting, Side, reference_channel, torque_channel
from torquebench.errors import InputError, SignalFault
from torquebench.message import Message
from torquebench.signals import (
    EdgeBlock,
    FrequencyCounter,
    History,
    Record,
    SignalFaultKind,
)

FINE_WINDOW_S = 0.002
"""Length of the windows of fine intervals, s: they resolve a drive's ripple of some 10 Hz."""
FAST_WINDOW_S = 0.001
"""Length of the windows for steps of torque, s: they resolve the vibration of a shaft, up to 400
Hz."""
STILL_SPREAD = 8.0
"""Largest spread of constant values, in standard uncertainties of the counter. 25 windows with only
the counter's own noise spread over 4 of them.
"""
STILL_SAMPLES = 10
"""Smallest number of constant values in a row that count as stuck."""
LEARNED_SAMPLES = 30
"""Number of values from which the noise of a signal is estimated."""
NOISY = 10.0
"""Noise of a signal, in standard uncertainties of its counter, that is never constant by chance: 25
values spread over less than a standard deviation once in 10⁹ times.
"""
MOVING_SPREAD = 8.0
"""Spread of the learned values, in standard deviations of their noise, of a torque that changes:
that of noise alone is 4."""
CURVATURE_OF_NOISE = 0.6745 * math.sqrt(6.0)
"""Median of the second differences of white noise, in standard deviations of the noise."""
LARGEST_ZERO = 0.04
"""Largest deviation of a zero from the nominal one, as a share of the signal at nominal torque."""
MOVED_SHARE = 0.01
"""Change of the partner's torque, as a share of the range, during which a constant transducer
counts as stuck."""


class Channel:
    """Counter, scale, certificate and recent values of one transducer.

    Parameters
    ----------
    name : str
        Channel of the counter card, such as ``"output_torque"``.
    side : {"input", "output"}
    standard : bool
        Whether it is the transducer of a mounted standard.
    stuck_s : float
        Time without any noise after which a frequency counts as stuck.
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
        self._columns = self._scale.column, self._scale.uncertainty_column
        window_s = counter.window_ticks / counter.timebase_hz
        self.recent = History(round(KEPT_S / window_s))
        """The readings of the last two minutes, faults included."""
        moved_nm = MOVED_SHARE * transducer.nominal_torque_nm
        self._stuck = _StuckCheck(stuck_s, moved_nm, *self._columns)
        self._fine: _FineWindows | None = None

    @property
    def zero(self) -> float:
        """Zero in use, in the unit of the signal."""
        return self._scale.zero

    @zero.setter
    def zero(self, value: float) -> None:
        """Use a measured zero; raise SignalFault if it is far from the nominal one."""
        scale = self._scale
        nominal, unit = scale.nominal_zero, scale.unit
        allowed = LARGEST_ZERO * scale.sensitivity_cw * scale.nominal_torque_nm
        if not abs(value - nominal) <= allowed:
            raise SignalFault(
                Message("{name}: zero at {value:.6g} {unit}", self.name, value, unit),
                Message(
                    "{low:g} to {high:g} {unit}, within 4 % of the nominal torque",
                    nominal - allowed,
                    nominal + allowed,
                    unit,
                ),
                "unload the transducer before zeroing and check its signal",
            )
        self._scale = self._scale.with_zero(value)

    def push(self, measured: EdgeBlock | Record, partner: Channel | None = None) -> Record:
        """Evaluate the instrument's next data; return their windows with torque.

        Parameters
        ----------
        measured : EdgeBlock or Record
            Edges to be counted, or a record with `frequency_hz` of an instrument that counts, or
            with `signal` of one that states values in the unit of the transducer's signal.
        partner : Channel, optional
            The other transducer that carries the same torque: if its torque changes, so must this
            one's.

        Returns
        -------
        Record
            `time_s`, the signal, `reading_nm` (corrected by the certificate), its uncertainty
            `counter_nm` by the counter or amplifier, and `fault`.
        """
        if isinstance(measured, EdgeBlock):
            measured = self._counter.push(measured)
        signal = self._columns[0]
        if signal not in measured:
            raise InputError(
                Message("{name} delivers {columns}", self.name, ", ".join(measured)),
                Message("signal = {signal!r}, as described", self.transducer.signal),
                "describe the transducer's signal as its instrument states it",
            )
        if signal == "signal":
            measured = self._with_uncertainty(measured)
        stuck = self._stuck.push(measured, partner)
        if stuck is not None:
            measured = measured.marked(np.array(stuck), SignalFaultKind.STUCK, *self._columns)
        record = self._scale.readings(measured)
        if self.certificate is not None:
            record = record.with_columns(reading_nm=self.certificate.correct(record["reading_nm"]))
        self.recent.append(record)
        return record

    def _with_uncertainty(self, stated: Record) -> Record:
        """Return the instrument's values with their uncertainty and faults."""
        lost = ~np.isfinite(stated["signal"])
        u = self.transducer.signal_uncertainty_nm * self._scale.sensitivity_cw
        return Record(
            {
                "time_s": stated.time_s,
                "signal": np.where(lost, np.nan, stated["signal"]),
                "signal_uncertainty": np.where(lost, np.nan, u),
                "fault": np.where(lost, np.uint8(SignalFaultKind.LOST_DATA), np.uint8(0)),
            }
        )

    @property
    def column(self) -> str:
        """Column of the channel's records that has the signal."""
        return self._scale.column

    def signal_nm(self, signal: float) -> float:
        """Torque of a signal from the nominal zero, without a certificate, N·m."""
        return float(self.transducer.scale().torque(signal))

    def torque(self, frequency_hz: float) -> float:
        """Torque of a frequency from the present zero, N·m."""
        value = self._scale.torque(frequency_hz)
        if self.certificate is not None:
            value = self.certificate.correct(value)
        return float(value)

    def latest(self) -> Record:
        """Return the newest window; raises SignalFault if there is none or a faulty one."""
        newest = self.recent.latest()
        if newest is None:
            raise SignalFault(Message("{name}: no sample yet", self.name), "a running acquisition")
        return newest.raise_on_fault(self.name)

    # -- shorter windows ---------------------------------------------------------------------

    def count_finely(self, window_s: float) -> None:
        """Count shorter windows in addition for the next two minutes."""
        if self._fine is None or self._fine.window_s != window_s:
            self._fine = _FineWindows(self._counter, window_s)
        self._fine.remaining_s = KEPT_S

    @property
    def fine_window_s(self) -> float | None:
        """Length of the additional shorter windows; None if none are counted."""
        return None if self._fine is None else self._fine.window_s

    def push_fine(self, edges: EdgeBlock) -> Record:
        """Count the next edges in shorter windows, which no certificate corrects."""
        assert self._fine is not None
        record = self._scale.readings(self._fine.counter.push(edges))
        self._fine.recent.append(record)
        self._fine.remaining_s -= edges.duration_s
        if self._fine.remaining_s < 0.0:
            self._fine = None
        return record

    def fine_window(self, start_s: float, stop_s: float) -> Record | None:
        """Return the shorter windows in [start, stop); None if none were counted."""
        return None if self._fine is None else self._fine.recent.window(start_s, stop_s)


class _StuckCheck:
    """Distinguish a stuck output from a quiet one.

    Values are constant while they don't spread beyond the counter's own noise. For a signal with
    clear noise of its own, constant values are a fault; a signal about as quiet as its counter is
    stuck if the torque of the other transducer on its side changes by `moved_nm`. `stuck_s` is the
    longest time of constant values.
    """

    def __init__(
        self, stuck_s: float, moved_nm: float, column: str, uncertainty_column: str
    ) -> None:
        self._columns = column, uncertainty_column
        self._stuck_s = stuck_s
        self._moved_nm = moved_nm
        self._learned: list[float] | None = []
        """The first values, until the noise of the signal is estimated."""
        self._noisy = False
        self._low = self._high = self._since_s = math.nan
        """Time since which values are constant, s, and the range in which they lie."""
        self._count = 0

    def push(self, record: Record, partner: Channel | None) -> list[bool] | None:
        """Check the next values as delivered; return which of them are stuck, None if none is."""
        if not len(record):
            return None
        long_still = []
        u = record[self._columns[1]].item(-1)
        # Check the values as counted: windows marked as stuck would hide a lasting fault.
        values, times = record[self._columns[0]].tolist(), record.time_s.tolist()
        for value, time_s in zip(values, times, strict=True):
            low = value if value < self._low else self._low
            high = value if value > self._high else self._high
            if not math.isnan(value) and high - low <= STILL_SPREAD * u:  # NaN has another fault
                self._low, self._high = low, high
                self._count += 1
            else:
                self._low = self._high = value
                self._since_s, self._count = time_s, 1
            still_s = time_s - self._since_s + 1e-9
            long_still.append(still_s >= self._stuck_s and self._count >= STILL_SAMPLES)
        if self._learned is not None:
            self._learn(values, u)
        stuck = any(long_still) and (self._noisy or self._moves(partner, times[-1]))
        return long_still if stuck else None

    def _learn(self, values: list[float], u: float) -> None:
        """Collect the first values, until the signal's own noise is estimated."""
        assert self._learned is not None
        self._learned += [value for value in values if not math.isnan(value)]
        if len(self._learned) < LEARNED_SAMPLES:
            return
        steps = np.abs(np.diff(self._learned))
        resolution = steps[steps > 0.0].min(initial=math.inf)
        noise = np.median(np.abs(np.diff(self._learned, 2))) / CURVATURE_OF_NOISE
        self._noisy = bool(noise > NOISY * max(u, resolution / math.sqrt(12.0)))
        ramps = self._noisy and bool(np.ptp(self._learned) > MOVING_SPREAD * noise)
        self._noisy, self._learned = self._noisy and not ramps, [] if ramps else None

    def _moves(self, partner: Channel | None, until_s: float) -> bool:
        """Return whether the partner's torque has changed while this channel was constant."""
        if partner is None:
            return False
        apart_s = CLOCKS_APART_S + 2.0 * (until_s - self._since_s) / max(self._count, 1)
        seen = partner.recent.window(self._since_s + apart_s, until_s - apart_s)
        if seen is None or not len(seen):
            return False
        torque_nm = seen["reading_nm"]
        moved = np.fmax.reduce(torque_nm) - np.fmin.reduce(torque_nm)
        return bool(moved > self._moved_nm)


class _FineWindows:
    """Windows shorter than the bench's own, counted only while they are needed."""

    def __init__(self, like: FrequencyCounter, window_s: float) -> None:
        self.window_s = window_s
        self.counter = FrequencyCounter(like.method, window_s, like.timebase_hz)
        self.recent = History(round(KEPT_S / window_s))
        self.remaining_s = KEPT_S


def open_channel(
    name: str, description: BenchDescription, drivers: DriverSet, mounting: Mounting
) -> Channel:
    """Open a channel as described for this mounting."""
    counting, stuck_s = description.counter, description.safety.stuck_s
    counter = FrequencyCounter(
        counting.method,
        counting.window_s,
        drivers.counter.timebase_hz,
        edge_jitter_s=counting.edge_jitter_s,
    )
    transducer = described_transducer(name, description, mounting, drivers.reference is not None)
    if transducer is None:
        raise InputError(
            Message("channel {name} with {mounting} mounted", name, mounting), "a mounted standard"
        )
    side: Side = "input" if name.startswith("input") else "output"
    standard, certificate = name == reference_channel(side), None
    if standard:
        certificate = certificates(description, drivers, mounting).get(side)
    return Channel(name, side, standard, transducer, counter, stuck_s, certificate)


def described_transducer(
    name: str, description: BenchDescription, mounting: Mounting, readout: bool
) -> TransducerDescription | None:
    """Return the transducer of a channel; None for a channel of a standard that isn't mounted.

    With `readout` the standard has a read-out, which delivers torque unless described otherwise.
    """
    for side in SIDES:
        if name == torque_channel(side):
            return description.module(side).transducer
        standard = description.standard(mounting)
        if name == reference_channel(side) and standard is not None:
            transducer = standard.transducer(side)
            return transducer.stated() if readout else transducer
    return None


def certificates(
    description: BenchDescription, drivers: DriverSet, mounting: Mounting
) -> dict[Side, ReferenceCertificate]:
    """Return the certificates of a mounted standard: from the description's file, or the driver."""
    standard = description.standard(mounting)
    if standard is not None and standard.certificate is not None:
        return read_certificate(standard.certificate)
    return dict(drivers.certificates.get(mounting, {}))
