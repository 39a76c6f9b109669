"""Samples of counters: frequency, or torque, per window, with uncertainty and fault codes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from torquebench.message import Message
from torquebench.signals.faults import PulseTrainFault, SignalFaultKind

__all__ = ["FrequencySamples", "TorqueSamples"]

Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Samples:
    """Samples on one time axis, with a fault code each."""

    time_s: NDArray[np.float64]
    fault: NDArray[np.uint8]

    def __len__(self) -> int:
        return int(self.time_s.size)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True where a sample has no fault."""
        return np.equal(self.fault, np.uint8(SignalFaultKind.NONE))

    def raise_on_fault(self, channel: str = "signal") -> Self:
        """Return the samples themselves when none has a fault.

        Parameters
        ----------
        channel : str
            Name of the channel, for the message.

        Raises
        ------
        PulseTrainFault
            For the first faulty window, with its kind, its time and how many there are.
        """
        faulty = np.flatnonzero(self.fault)
        if faulty.size:
            first = int(faulty[0])
            kind = SignalFaultKind(int(self.fault[first]))
            raise PulseTrainFault(
                kind,
                Message(
                    "{channel}: {description} at {time_s:.6g} s ({size} of {count} windows faulty)",
                    channel,
                    kind.description,
                    self.time_s[first],
                    faulty.size,
                    len(self),
                ),
            )
        return self


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrequencySamples(_Samples):
    """Frequency per window of one channel.

    Parameters
    ----------
    time_s : float64 array, shape (n,)
        Centres of the windows in seconds of the timebase.
    fault : uint8 array, shape (n,)
        `SignalFaultKind` codes, 0 where the number is good.
    frequency_hz : float64 array, shape (n,)
        Frequency in Hz. A faulty value is NaN, which no arithmetic can turn into a plausible
        torque. Read `valid` or call `raise_on_fault`.
    edges : int64 array, shape (n,)
        Edges counted in each window (both edges together where both are timed).
    standard_uncertainty_hz : float64 array, shape (n,)
        Standard uncertainty from quantisation and edge jitter in Hz, k = 1; NaN at a fault. The
        timebase's error isn't in it: it is common to calibration and measurement.
    missing, doubled : int32 arrays, shape (n,)
        Pulses that are missing from, or doubled in, each window.
    """

    frequency_hz: NDArray[np.float64]
    edges: NDArray[np.int64]
    standard_uncertainty_hz: NDArray[np.float64]
    missing: NDArray[np.int32]
    doubled: NDArray[np.int32]

    @classmethod
    def concatenate(cls, parts: Sequence["FrequencySamples"]) -> "FrequencySamples":
        """Join samples of consecutive pushes into one.

        Examples
        --------
        >>> len(FrequencySamples.concatenate([]))
        0
        """
        return cls(
            time_s=_joined([part.time_s for part in parts], np.float64),
            fault=_joined([part.fault for part in parts], np.uint8),
            frequency_hz=_joined([part.frequency_hz for part in parts], np.float64),
            edges=_joined([part.edges for part in parts], np.int64),
            standard_uncertainty_hz=_joined(
                [part.standard_uncertainty_hz for part in parts], np.float64
            ),
            missing=_joined([part.missing for part in parts], np.int32),
            doubled=_joined([part.doubled for part in parts], np.int32),
        )

    def marked(
        self, where: NDArray[np.bool_], kind: SignalFaultKind, *, over_others: bool = False
    ) -> "FrequencySamples":
        """Return samples with a further fault.

        Parameters
        ----------
        where : bool array, shape (n,)
            Windows to mark.
        kind : SignalFaultKind
            The fault.
        over_others : bool
            Replace other faults too; a fault already there stays when not given.
        """
        new = where if over_others else where & self.valid
        if not new.any():
            return self
        return replace(
            self,
            fault=np.where(new, np.uint8(kind), self.fault),
            frequency_hz=np.where(new, np.nan, self.frequency_hz),
            standard_uncertainty_hz=np.where(new, np.nan, self.standard_uncertainty_hz),
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TorqueSamples(_Samples):
    """Torque reading per window of one channel, before any compensation.

    Parameters
    ----------
    time_s : float64 array, shape (n,)
        Centres of the windows in seconds of the timebase.
    fault : uint8 array, shape (n,)
        `SignalFaultKind` codes, 0 where the number is good.
    torque_nm : float64 array, shape (n,)
        Torque reading in N·m, clockwise positive; NaN where there is a fault.
    standard_uncertainty_nm : float64 array, shape (n,)
        Standard uncertainty of the counter's share in N·m, k = 1; NaN at a fault.
    """

    torque_nm: NDArray[np.float64]
    standard_uncertainty_nm: NDArray[np.float64]


def _joined(parts: Sequence[NDArray[Scalar]], kind: type[Scalar]) -> NDArray[Scalar]:
    return np.concatenate(parts) if parts else np.empty(0, dtype=kind)
