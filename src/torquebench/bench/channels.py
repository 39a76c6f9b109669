"""One torque channel: from what its instrument delivers to torque, with its recent values."""

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

__all__ = ["FAST_WINDOW_S", "FINE_WINDOW_S", "Channel", "certificates", "open_channel"]

FINE_WINDOW_S = 0.002
"""Windows of a finely resolved interval, s: they resolve a drive's ripple of some 10 Hz."""
FAST_WINDOW_S = 0.001
"""Windows of steps of torque, s: they resolve the vibration of a shaft, up to 400 Hz."""
STILL_SPREAD = 8.0
"""Largest spread of values that stand still, in standard uncertainties of the counter. 25 windows
with only the counter's own noise spread over 4 of them.
"""
STILL_SAMPLES = 10
"""Least number of equal values that stand still."""
LEARNED_SAMPLES = 30
"""So many values tell the noise of a signal."""
NOISY = 10.0
"""Noise of a signal, in standard uncertainties of its counter, that never stands still by chance:
25 values spread over less than a standard deviation once in 10⁹ times.
"""
CURVATURE_OF_NOISE = 0.6745 * math.sqrt(6.0)
"""Median of the second differences of white noise, in its standard deviations."""
MOVED_SHARE = 0.01
"""A transducer whose partner moves by this share of its range is stuck if it stands still."""


class Channel:
    """Counter, scale, certificate and recent values of one transducer.

    Parameters
    ----------
    name : str
        Channel of the counter card, such as ``"output_torque"``.
    side : {"input", "output"}
    standard : bool
        Whether it is the transducer of a mounted standard.
    transducer : TransducerDescription
    counter : FrequencyCounter
    stuck_s : float
        After so long without any noise a frequency is stuck.
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
        window_s = counter.window_ticks / counter.timebase_hz
        self.recent = History(round(KEPT_S / window_s))
        """The readings of the last two minutes; faults are among them."""
        self._stuck = _StuckCheck(stuck_s, MOVED_SHARE * transducer.nominal_torque_nm)
        self._fine: _FineWindows | None = None

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

    def push(self, measured: EdgeBlock | Record, partner: Channel | None = None) -> Record:
        """Take what the instrument delivers next; return its windows with their torque.

        Parameters
        ----------
        measured : EdgeBlock or Record
            Edges to be counted, or a record with `frequency_hz` of an instrument that counts, or
            with `reading_nm` of one that states torque by the nominal zero.
        partner : Channel, optional
            The other transducer that carries this one's torque: while that moves, this one must.

        Returns
        -------
        Record
            `time_s`, `frequency_hz`, `reading_nm`, which a certificate corrects, its
            uncertainty by the counter `counter_nm`, and `fault`.
        """
        if isinstance(measured, EdgeBlock):
            measured = self._counter.push(measured)
        if "frequency_hz" not in measured:
            measured = self._as_counted(measured)
        stuck = self._stuck.push(measured, partner)
        if stuck is not None:
            rows = np.array(stuck)
            values = "frequency_hz", "frequency_uncertainty_hz"
            measured = measured.marked(rows, SignalFaultKind.STUCK, *values)
        record = self._scale.readings(measured)
        if self.certificate is not None:
            record = record.with_columns(reading_nm=self.certificate.correct(record["reading_nm"]))
        self.recent.append(record)
        return record

    def _as_counted(self, stated: Record) -> Record:
        """Return stated torques as the frequencies that would have stated them, for zeroing."""
        torque = stated["reading_nm"]
        lost = ~np.isfinite(torque)
        return Record(
            {
                "time_s": stated.time_s,
                "frequency_hz": self.transducer.scale().frequency(torque),
                "frequency_uncertainty_hz": np.where(lost, np.nan, 0.0),
                "fault": np.where(lost, np.uint8(SignalFaultKind.LOST_DATA), np.uint8(0)),
            }
        )

    def torque(self, frequency_hz: float) -> float:
        """Torque of one frequency by the present zero, N·m."""
        value = self._scale.torque(frequency_hz)
        if self.certificate is not None:
            value = self.certificate.correct(value)
        return float(value)

    def latest(self) -> Record:
        """Return the newest window. Raises SignalFault for none or a faulty one."""
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
        """Length of the shorter windows that are counted; None without any."""
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
    """Tells an output that is stuck from one that is quiet.

    Values stand still while they don't spread beyond the counter's own noise. That is a fault of a
    signal with clear noise of its own; one that is about as quiet as its counter is stuck when the
    other transducer of its side moves.

    Parameters
    ----------
    stuck_s : float
        How long values may stand still, s.
    moved_nm : float
        Change of the partner's torque that this channel can't miss, N·m.
    """

    def __init__(self, stuck_s: float, moved_nm: float) -> None:
        self._stuck_s = stuck_s
        self._moved_nm = moved_nm
        self._learned: list[float] | None = []
        """The first values, until they tell whether the signal has noise of its own."""
        self._noisy = False
        self._low = self._high = self._since_s = math.nan
        """Since when values stand still, s, and between which they lie."""
        self._count = 0

    def push(self, record: Record, partner: Channel | None) -> list[bool] | None:
        """Take the next values as delivered; return which of them are stuck, None if none is."""
        if not len(record):
            return None
        long_still = []
        u = float(record["frequency_uncertainty_hz"][-1])
        # Values as they were counted: windows marked as stuck would hide a lasting fault.
        values, times = record["frequency_hz"].tolist(), record.time_s.tolist()
        for value, time_s in zip(values, times, strict=True):
            if math.isnan(value):  # another fault
                self._low = value
            low, high = min(self._low, value), max(self._high, value)
            if high - low <= STILL_SPREAD * u:
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
        """Take the first values until they tell the signal's own noise."""
        assert self._learned is not None
        self._learned += [value for value in values if not math.isnan(value)]
        if len(self._learned) < LEARNED_SAMPLES:
            return
        steps = np.abs(np.diff(self._learned))
        resolution = steps[steps > 0.0].min(initial=math.inf)
        noise = np.median(np.abs(np.diff(self._learned, 2))) / CURVATURE_OF_NOISE
        self._noisy = bool(noise > NOISY * max(u, resolution / math.sqrt(12.0)))
        self._learned = None

    def _moves(self, partner: Channel | None, until_s: float) -> bool:
        """Whether the partner has moved since this one has stood still."""
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
    """Windows shorter than the bench's own, counted while somebody needs them."""

    def __init__(self, like: FrequencyCounter, window_s: float) -> None:
        self.window_s = window_s
        self.counter = FrequencyCounter(like.method, window_s, like.timebase_hz)
        self.recent = History(round(KEPT_S / window_s))
        self.remaining_s = KEPT_S


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
            return Channel(name, side, True, transducer, counter, stuck_s, certificate)
    own: Side = "input" if name == torque_channel("input") else "output"
    transducer = description.module(own).transducer
    return Channel(name, own, False, transducer, counter, stuck_s, None)


def certificates(
    description: BenchDescription, drivers: DriverSet, mounting: Mounting
) -> dict[Side, ReferenceCertificate]:
    """Return the certificates of a mounted standard: from the description's file, or the driver."""
    standard = description.standard(mounting)
    if standard is not None and standard.certificate is not None:
        return read_certificate(standard.certificate)
    return dict(drivers.certificates.get(mounting, {}))
