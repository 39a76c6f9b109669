"""Comparison of the standard with the module, which carries the same torque, before a series."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
from bluesky.protocols import Movable
from ophyd_async.core import AsyncStatus

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.chain_effects import standard_effect
from torquebench.bench.description import BenchDescription, StandardDescription
from torquebench.bench.devices import BenchDevices
from torquebench.bench.roles import Side, reference_channel, torque_channel
from torquebench.calibration import Plausibility, Step
from torquebench.chain import Readings
from torquebench.errors import BenchError, SignalFault, TorquebenchError
from torquebench.message import Message

WINDOW_SHARE = 0.6
"""Share of a preload's duration, at its end, that is averaged."""
NOISE_FACTOR = 3.0
LEAST_WINDOWS = 2


@dataclass(frozen=True)
class PairedTorque:
    """Torques that a module and the standard on its side read at the same time.

    Parameters
    ----------
    reading_nm, standard_nm : float
        Torques relative to the unloaded state, N·m.
    standard_error_nm : float
        Standard error of their difference due to noise, N·m.
    temperature_c, standard_temperature_c : float
        Temperatures; NaN if not measured.
    """

    reading_nm: float
    standard_nm: float
    standard_error_nm: float = 0.0
    temperature_c: float = math.nan
    standard_temperature_c: float = math.nan

    def since(self, unloaded: PairedTorque) -> PairedTorque:
        """Return the torques relative to an unloaded pair."""
        return PairedTorque(
            self.reading_nm - unloaded.reading_nm,
            self.standard_nm - unloaded.standard_nm,
            math.hypot(self.standard_error_nm, unloaded.standard_error_nm),
            self.temperature_c,
            self.standard_temperature_c,
        )


def check_zero(
    description: BenchDescription, side: Side, standard: StandardDescription, zero_nm: float
) -> None:
    """Refuse a standard that shows a torque without load.

    Parameters
    ----------
    zero_nm : float
        Its unloaded torque by its nominal zero, N·m.

    Raises
    ------
    BenchError
        The torque exceeds the largest one that counts as unloaded.
    """
    allowed_nm = description.unloaded_nm(side)
    if not abs(zero_nm) <= allowed_nm:
        raise BenchError(
            Message(
                "unloaded the standard {serial} states {zero:+.4g} N·m",
                standard.transducer(side).serial,
                zero_nm,
            ),
            Message("±{limit:g} N·m", allowed_nm),
            "unload the shaft; where nothing loads it, the standard's zero has moved: have the "
            "standard checked",
        )


def check_pair(
    description: BenchDescription,
    side: Side,
    standard: StandardDescription,
    pair: PairedTorque,
    limits: Plausibility,
    before: ActiveChain | None = None,
) -> None:
    """Refuse a series if standard and module differ by more than their uncertainties allow.

    With a model in use, its torque is compared, within U of both and the change that the profile
    allows. Without a model, the reading is compared, within the profile's limit of the span or, by
    default, within `safety.disagreement_percent`.

    Raises
    ------
    BenchError
        The torques differ by more than that.
    """
    range_nm, transducer = description.module(side).range_nm, description.module(side).transducer
    torque_nm = np.array([pair.standard_nm])
    reached = () if math.isnan(pair.standard_temperature_c) else (pair.standard_temperature_c,)
    effect = standard_effect(description, side, datetime.now(UTC).date(), reached, standard)
    parts = effect.components(Readings(torque_nm), torque_nm)
    allowed_nm = 2.0 * math.hypot(*(float(np.sum(part.uncertainty_nm)) for part in parts))
    allowed_nm += NOISE_FACTOR * pair.standard_error_nm
    previous = None if before is None else _torque_of(before, pair)
    if previous is not None:
        stated_nm, expanded_nm = previous
        allowed_nm += expanded_nm + 1e-2 * (limits.change_percent or 0.0) * range_nm
    else:
        stated_nm = pair.reading_nm
        allowed_nm += (
            1e-2 * limits.span_percent * abs(pair.standard_nm)
            + 1e-2 * (limits.zero_percent or 0.0) * range_nm
            if limits.span_percent is not None
            else 1e-2 * description.safety.disagreement_percent * range_nm
        )
    if abs(pair.standard_nm - stated_nm) <= allowed_nm:
        return
    names = standard.transducer(side).serial, pair.standard_nm, transducer.serial, stated_nm
    if previous is None or before is None:
        raise BenchError(
            Message(
                "at one load the standard {standard} states {torque:+.5g} N·m, the transducer "
                "{transducer} {reading:+.5g} N·m",
                *names,
            ),
            Message("at most {allowed:.3g} N·m apart", allowed_nm),
            "find out which of the two is wrong: sign, scale, nominal torque, amplifier's range",
        )
    raise BenchError(
        Message(
            "at one load the standard {standard} states {torque:+.5g} N·m, the transducer "
            "{transducer} with model-{model} {reading:+.5g} N·m",
            *names[:3],
            before.model_id,
            stated_nm,
        ),
        Message("at most {allowed:.3g} N·m apart", allowed_nm),
        Message(
            "find out whether the standard is wrong (certificate, scale, amplifier) or the chain "
            "has changed since its calibration; enter a change of the chain, then calibrate: "
            "torquebench records adjust transducer {transducer} WHAT --by NAME",
            transducer.serial,
        ),
    )


def _torque_of(before: ActiveChain, pair: PairedTorque) -> tuple[float, float] | None:
    """Return torque and U by the model in use; None outside its range."""
    readings = Readings(
        np.array([pair.reading_nm]),
        branch=np.array([1.0]),
        speed_rpm=0.0,
        acceleration_rad_s2=0.0,
        temperature_c=None if math.isnan(pair.temperature_c) else pair.temperature_c,
        zero_temperature_c=None if math.isnan(pair.temperature_c) else pair.temperature_c,
    )
    try:
        torque = before.chain.torque(readings)
    except TorquebenchError:
        return None
    return float(torque.value_nm[0]), 2.0 * float(torque.standard_uncertainty_nm[0])


class TakenStep(NamedTuple):
    """A step that has just been measured.

    Parameters
    ----------
    row : mapping, optional
        Steady value of a point by field.
    standard_zero : float, optional
        Measured zero of the standard.
    """

    step: Step
    row: Mapping[str, Any] | None = None
    standard_zero: float | None = None


class StandardCheck(Movable[TakenStep]):
    """Compares a module with its standard at every load that exceeds all earlier ones.

    `set` gets each step: at the end of a preload and of the rest after it, both are read; a point
    comes with its row, a zero with that of the standard.

    Parameters
    ----------
    side : {"input", "output"}
    limits : Plausibility
        Limits in the profile.
    before : ActiveChain, optional
        The model in use so far.
    """

    name = "standard_check"
    parent = None

    def __init__(
        self,
        devices: BenchDevices,
        side: Side,
        standard: StandardDescription,
        limits: Plausibility,
        before: ActiveChain | None = None,
    ) -> None:
        self._context = devices.context
        self._side: Side = side
        self._standard = standard
        self._limits = limits
        self._before = before
        self._loaded: tuple[float, PairedTorque] | None = None
        self._compared = {1.0: 0.0, -1.0: 0.0}
        """Largest compared torque of each direction, N·m."""

    @AsyncStatus.wrap
    async def set(self, value: TakenStep) -> None:
        """Check a step. Raises BenchError, see `check_zero` and `check_pair`."""
        step, row, zero = value
        if zero is not None:
            channel = self._context.acquisition.channel(reference_channel(self._side))
            zero_nm = channel.signal_nm(zero)
            check_zero(self._context.description, self._side, self._standard, zero_nm)
        elif row is not None:
            self._compare(step.nominal_nm, _point(row))
        elif step.kind == "preload":
            pair = self._dwell(WINDOW_SHARE * step.duration_s)
            if step.nominal_nm:
                self._loaded = None if pair is None else (step.nominal_nm, pair)
            elif pair is not None and self._loaded is not None:
                nominal_nm, loaded = self._loaded
                self._loaded = None
                self._compare(nominal_nm, loaded.since(pair))

    def _compare(self, nominal_nm: float, pair: PairedTorque) -> None:
        """Compare module and standard at the largest load so far of a direction."""
        direction = math.copysign(1.0, nominal_nm)
        if abs(nominal_nm) <= self._compared[direction]:
            return
        self._compared[direction] = abs(nominal_nm)
        description = self._context.description
        check_pair(description, self._side, self._standard, pair, self._limits, self._before)

    def _dwell(self, window_s: float) -> PairedTorque | None:
        """Return both mean torques over the last `window_s`; None while one has no valid signal."""
        acquisition, now_s = self._context.acquisition, self._context.clock.now()
        values: list[tuple[float, float]] = []
        for channel in (torque_channel(self._side), reference_channel(self._side)):
            try:
                torque = acquisition.window(channel, now_s - window_s, now_s)["reading_nm"]
            except SignalFault:
                return None
            if torque.size < LEAST_WINDOWS:
                return None
            values.append((float(torque.mean()), float(torque.std(ddof=1)) / torque.size**0.5))
        (reading_nm, own), (standard_nm, others) = values
        block = acquisition.latest_block
        probe = self._standard.temperature_probe
        return PairedTorque(
            reading_nm,
            standard_nm,
            math.hypot(own, others),
            block.temperature_c(self._context.description.module(self._side).temperature_probe),
            math.nan if probe is None else block.temperature_c(probe),
        )


def _point(row: Mapping[str, Any]) -> PairedTorque:
    """Return a measured point as a pair of torques with their uncertainty."""
    return PairedTorque(
        float(row["reading_nm"]),
        float(row["standard_nm"]),
        math.hypot(row["reading_standard_error_nm"], row["standard_uncertainty_nm"]),
        float(row["temperature_c"]),
        float(row.get("standard_temperature_c", math.nan)),
    )
