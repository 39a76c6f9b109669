"""Injected faults: in frequencies, in pulse trains and in encoder counts."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.twin.blocks import (
    CHANNELS,
    FAULT_KINDS,
    SIDES,
    Channel,
    FaultKind,
    FloatArray,
    Side,
    TickArray,
)

_DEFAULT_AMOUNT: dict[FaultKind, float] = {
    "silent": 0.0,
    "frozen": 0.0,
    "missing_pulses": 100.0,
    "doubled_pulses": 100.0,
    "outlier": 0.2,
    "wrong_span": 1.03,
    "out_of_modulation": 0.1,
    "encoder_slip": 1000.0,
}


@dataclass
class Fault:
    """A fault during a half-open interval of ticks."""

    channel: Channel | Side
    kind: FaultKind
    start_tick: int
    stop_tick: int
    amount: float
    held_hz: float | None = field(default=None)  # the value that "frozen" keeps, once it has begun


def make_fault(
    channel: Channel | Side,
    kind: FaultKind,
    start_tick: int,
    stop_tick: int,
    amount: float | None,
) -> Fault:
    """Check and return a fault; with ``amount`` None it has the kind's default."""
    if kind not in FAULT_KINDS:
        raise InputError(
            Message("fault {kind!r}", kind), Message("one of {list}", ", ".join(FAULT_KINDS))
        )
    allowed: tuple[str, ...] = SIDES if kind == "encoder_slip" else CHANNELS
    if channel not in allowed:
        raise InputError(
            Message("fault {kind!r} on {channel!r}", kind, channel),
            Message("on one of {allowed}", ", ".join(allowed)),
        )
    if stop_tick <= start_tick:
        raise InputError("a fault of no duration", "a duration above 0 s")
    amount = _DEFAULT_AMOUNT[kind] if amount is None else amount
    if kind in ("missing_pulses", "doubled_pulses") and amount < 1.0:
        raise InputError(
            Message("every {amount:g}-th pulse", amount), "a whole number of at least 1"
        )
    return Fault(channel, kind, start_tick, stop_tick, amount)


def broken_frequency(
    faults: Iterable[Fault], frequency_hz: FloatArray, ticks: TickArray, zero_hz: float
) -> FloatArray:
    """Return the frequencies at the steps' borders with the frequency faults applied."""
    result = frequency_hz
    for fault in faults:
        if fault.kind not in ("frozen", "outlier", "wrong_span", "out_of_modulation"):
            continue
        hit = (ticks >= fault.start_tick) & (ticks < fault.stop_tick)
        if not hit.any():
            continue
        result = result.copy()
        if fault.kind == "frozen":
            if fault.held_hz is None:
                fault.held_hz = float(frequency_hz[int(np.argmax(hit))])
            result[hit] = fault.held_hz
        elif fault.kind == "outlier":
            result[hit] += fault.amount * zero_hz
        elif fault.kind == "wrong_span":
            result[hit] = zero_hz + fault.amount * (result[hit] - zero_hz)
        else:
            result[hit] = fault.amount * zero_hz
    return result


def broken_edges(
    faults: Iterable[Fault], ticks: TickArray, first_number: int, timebase_hz: float
) -> TickArray:
    """Return a pulse train with lost, doubled or silenced edges; edges count from its start."""
    numbers = first_number + np.arange(ticks.size)
    for fault in faults:
        if fault.kind not in ("silent", "missing_pulses", "doubled_pulses"):
            continue
        hit = (ticks >= fault.start_tick) & (ticks < fault.stop_tick)
        if fault.kind == "doubled_pulses":
            second = ticks[hit & (numbers % int(fault.amount) == 0)] + round(200e-9 * timebase_hz)
            order = np.argsort(np.concatenate((ticks, second)), kind="stable")
            numbers = np.concatenate((numbers, np.zeros(second.size, dtype=np.int64)))[order]
            ticks = np.concatenate((ticks, second))[order]
            continue
        if fault.kind == "missing_pulses":
            hit &= numbers % int(fault.amount) == 0
        ticks, numbers = ticks[~hit], numbers[~hit]
    return ticks


def broken_counts(faults: Iterable[Fault], counts: TickArray, ticks: TickArray) -> TickArray:
    """Return the encoder counts with the slip subtracted."""
    for fault in faults:
        if fault.kind == "encoder_slip":
            counts = np.where(ticks >= fault.start_tick, counts - int(fault.amount), counts)
    return counts
