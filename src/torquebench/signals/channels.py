"""Several channels on one time axis, with the transducers' group delays removed."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals.faults import SignalFaultKind
from torquebench.signals.samples import TorqueSamples

__all__ = ["SynchronousSamples", "advanced", "synchronous"]

# Windows of two channels are the same if they differ by less than this share of their distance.
_SAME = 1e-6
# Shifts below this share of a window need no interpolation.
_WHOLE = 1e-9


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SynchronousSamples:
    """Torque of several channels at the same times.

    Parameters
    ----------
    time_s : float64 array, shape (n,)
        Times at which the torques acted, in seconds of the timebase.
    torque_nm : mapping of str to float64 array, shape (n,)
        Torque of each channel in N·m; NaN where the channel has a fault.
    standard_uncertainty_nm : mapping of str to float64 array, shape (n,)
        The counter's share of the standard uncertainty in N·m, k = 1.
    fault : mapping of str to uint8 array, shape (n,)
        `SignalFaultKind` codes.
    """

    time_s: NDArray[np.float64]
    torque_nm: Mapping[str, NDArray[np.float64]]
    standard_uncertainty_nm: Mapping[str, NDArray[np.float64]]
    fault: Mapping[str, NDArray[np.uint8]]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True where no channel has a fault."""
        good = np.ones(self.time_s.size, dtype=np.bool_)
        for codes in self.fault.values():
            good &= codes == SignalFaultKind.NONE
        return good


def synchronous(
    channels: Mapping[str, TorqueSamples], group_delay_s: Mapping[str, float] | None = None
) -> SynchronousSamples:
    """Bring channels of one grid of windows onto one time axis.

    A torque that acts at t leaves a transducer with group delay d at t + d. Each channel is
    evaluated there, by a cubic through the four nearest windows, so that a row has the same torque
    for all transducers. Windows at the ends that lack their neighbours are left out.

    Parameters
    ----------
    channels : mapping of str to TorqueSamples
        From counters with the same window and step, over any stretch of time.
    group_delay_s : mapping of str to float, optional
        Group delay of each channel's transducer in seconds (220 µs for one of 3 kHz, 150 µs for
        6 kHz bandwidth); 0 for a channel that isn't named.

    Raises
    ------
    InputError
        If there is no channel, a delay has no channel, grids differ, or there is no overlap.

    Examples
    --------
    >>> time = np.arange(6) * 1e-3
    >>> def samples(torque):
    ...     return TorqueSamples(
    ...         time_s=time,
    ...         fault=np.zeros(6, dtype=np.uint8),
    ...         torque_nm=torque,
    ...         standard_uncertainty_nm=np.full(6, 0.01),
    ...     )
    >>> pair = synchronous(
    ...     {"input": samples(10.0 * time), "output": samples(10.0 * (time - 220e-6))},
    ...     {"output": 220e-6},
    ... )
    >>> np.allclose(pair.torque_nm["input"], pair.torque_nm["output"])
    True
    """
    delays = dict(group_delay_s or {})
    unknown = sorted(set(delays) - set(channels))
    if not channels or unknown:
        raise InputError(
            Message("delay of {unknown!r}", unknown[0]) if unknown else "no channels",
            "channels with their delays",
        )
    step = _step(channels)
    rows = {}
    for name, samples in channels.items():
        first = samples.time_s[0] / step
        shift = delays.get(name, 0.0) / step
        torque, uncertainty, fault, lead = _advanced(samples, shift)
        rows[name] = (first + lead, torque, uncertainty, fault)
    origin = next(iter(rows.values()))[0]
    starts = {name: _grid_index(row[0] - origin, name) for name, row in rows.items()}
    low = max(starts.values())
    high = min(starts[name] + row[1].size for name, row in rows.items())
    if high <= low:
        raise InputError("channels without common times", "channels of the same time")
    parts = {name: slice(low - starts[name], high - starts[name]) for name in rows}
    return SynchronousSamples(
        time_s=(origin + np.arange(low, high)) * step,
        torque_nm={name: row[1][parts[name]] for name, row in rows.items()},
        standard_uncertainty_nm={name: row[2][parts[name]] for name, row in rows.items()},
        fault={name: row[3][parts[name]] for name, row in rows.items()},
    )


def advanced(value: ArrayLike, shift: float) -> tuple[NDArray[np.float64], int]:
    """Read a row of even samples `shift` samples later, by cubics through four neighbours.

    Parameters
    ----------
    value : array_like, shape (n,)
        Samples.
    shift : float
        Delay in samples; may be fractional or negative.

    Returns
    -------
    values : float64 array, shape (m,)
        Where all four neighbours exist.
    lead : int
        Index of the sample at the time of the first of them.

    Examples
    --------
    >>> values, lead = advanced(np.arange(8.0) ** 2, 0.5)
    >>> lead, values
    (1, array([ 2.25,  6.25, 12.25, 20.25, 30.25]))
    """
    samples = np.asarray(value, dtype=np.float64)
    whole, offsets, weights = _interpolation(shift)
    first, count = _range(samples.size, whole, offsets)
    result = np.zeros(count)
    for offset, weight in zip(offsets, weights, strict=True):
        result += weight * samples[first + whole + offset :][:count]
    return result, first


def _interpolation(shift: float) -> tuple[int, list[int], list[float]]:
    """Whole shift, and offsets and weights of Lagrange's cubic for the rest."""
    whole = int(np.floor(shift + _WHOLE))
    part = shift - whole
    if abs(part) <= _WHOLE:
        return whole, [0], [1.0]
    return (
        whole,
        [-1, 0, 1, 2],
        [
            -part * (part - 1) * (part - 2) / 6,
            (part + 1) * (part - 1) * (part - 2) / 2,
            -(part + 1) * part * (part - 2) / 2,
            (part + 1) * part * (part - 1) / 6,
        ],
    )


def _range(size: int, whole: int, offsets: list[int]) -> tuple[int, int]:
    """First sample whose neighbours all exist, and how many such samples there are."""
    first = max(0, -(whole + offsets[0]))
    last = min(size - 1, size - 1 - (whole + offsets[-1]))
    return first, max(last - first + 1, 0)


def _advanced(
    samples: TorqueSamples, shift: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint8], int]:
    whole, offsets, weights = _interpolation(shift)
    torque, lead = advanced(samples.torque_nm, shift)
    variance = np.zeros(torque.size)
    fault = np.zeros(torque.size, dtype=np.uint8)
    for offset, weight in zip(offsets, weights, strict=True):
        part = slice(lead + whole + offset, lead + whole + offset + torque.size)
        variance += (weight * samples.standard_uncertainty_nm[part]) ** 2
        fault = np.where(fault != 0, fault, samples.fault[part])
    faulty = fault != 0
    return (
        np.where(faulty, np.nan, torque),
        np.where(faulty, np.nan, np.sqrt(variance)),
        fault,
        lead,
    )


def _step(channels: Mapping[str, TorqueSamples]) -> float:
    """Distance of the windows, the same in all channels."""
    steps = {}
    for name, samples in channels.items():
        if len(samples) < 2:
            raise InputError(
                Message("{count} samples of {name}", len(samples), name), "two or more"
            )
        between = np.diff(samples.time_s)
        steps[name] = float((samples.time_s[-1] - samples.time_s[0]) / (len(samples) - 1))
        if np.any(np.abs(between - steps[name]) > _SAME * steps[name] + 1e-12):
            raise InputError(
                Message("windows of {name} at uneven distances", name), "one grid of windows"
            )
    first = next(iter(steps.values()))
    for name, step in steps.items():
        if abs(step - first) > _SAME * first:
            raise InputError(
                Message("windows of {name} every {step} s", name, step),
                Message("every {first} s, as the others", first),
            )
    return first


def _grid_index(difference: float, name: str) -> int:
    index = round(difference)
    if abs(difference - index) > 1e-3:
        raise InputError(
            Message(
                "windows of {name} that lie {difference:.3g} windows beside the others'",
                name,
                difference - index,
            ),
            "one grid of windows",
        )
    return index
