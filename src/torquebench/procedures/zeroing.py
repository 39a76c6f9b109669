"""Measurement of zeros, with which every series begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bluesky.preprocessors as bpp

from torquebench.bench.devices import BenchDevices, MeasuredZero, SteadySettings, signal_of
from torquebench.bench.roles import SIDES, Side
from torquebench.procedures.messages import checkpoint, move, prepare, take
from torquebench.procedures.setup import (
    REST_S,
    Plan,
    power_off,
    power_on,
    set_mode,
    start_metadata,
)


@dataclass(frozen=True)
class ZeroResult:
    """Measured zeros of one side.

    Parameters
    ----------
    signal : float
        Signal of the module's unloaded transducer, in its unit.
    standard_uncertainty_nm : float
        Standard error of that mean, N·m.
    standard_signal : float or None
        Signal of the mounted standard's transducer; None if the counters have none.
    """

    signal: float
    standard_uncertainty_nm: float
    standard_signal: float | None


def zero(
    devices: BenchDevices, side: Side, *, duration_s: float = 1.0, standard: bool = False
) -> Plan[ZeroResult]:
    """Measure the unloaded zero, and use it from then on.

    The drive is powered off and the module set free meanwhile, because a drive at 0 N·m still has
    its loading error. Afterwards the module is driven again, with the drive enabled. A run must be
    open; an event is recorded in its stream "zero_input" or "zero_output".

    Parameters
    ----------
    side : {"input", "output"}
    duration_s : float
        Length of the averaging window, s.
    standard : bool
        Whether to zero the mounted standard's transducer of this side as well.
    """
    measured = yield from measure_zero(devices, side, duration_s=duration_s, standard=standard)
    yield from set_mode(devices, side, "driven")
    yield from power_on(devices, side)
    return measured


def measure_zero(
    devices: BenchDevices, side: Side, *, duration_s: float, standard: bool = False
) -> Plan[ZeroResult]:
    """Power off, set the module free, measure the zero and use it; the module stays free."""
    module = devices.module(side)
    yield from power_off(devices)
    yield from set_mode(devices, side, "free")
    settings = SteadySettings(
        settle_s=REST_S, window_s=duration_s, limit_s=duration_s, reference=standard
    )
    yield from prepare(module.steady, settings, wait=True)
    reading = yield from take(module.steady, devices.point, stream=f"zero_{side}")
    signal = signal_of(reading)
    assert signal is not None
    taken = MeasuredZero(signal, float(reading["reading_standard_error_nm"]))
    yield from move(module.transducer.zero, taken)
    standard_signal = signal_of(reading, "standard_") if standard else None
    if standard_signal is not None:
        of_standard = MeasuredZero(standard_signal, float(reading["standard_uncertainty_nm"]))
        yield from move(getattr(devices.reference, f"{side}_zero"), of_standard)
    return ZeroResult(*taken, standard_signal)


def zero_modules(
    devices: BenchDevices, sides: Sequence[Side] = SIDES
) -> Plan[dict[Side, ZeroResult]]:
    """Zero modules, set free and unloaded, without driving them again; the drives are off."""
    zeros: dict[Side, ZeroResult] = {}
    metadata = start_metadata(devices, "zero_modules", len(sides), sides=list(sides))

    def measured() -> Plan[None]:
        for side in sides:
            yield from checkpoint()
            zeros[side] = yield from measure_zero(devices, side, duration_s=1.0)

    run = bpp.run_wrapper(measured(), md=metadata)
    yield from bpp.finalize_wrapper(run, lambda: power_off(devices))
    return zeros
