"""Factor on the bearings' drag by the present state of their lubricant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from torquebench.chain.effect import Effect
from torquebench.chain.effects import MeasuredRotation
from torquebench.chain.identification.basis import direction
from torquebench.chain.identification.records import EmptyRun
from torquebench.chain.readings import Readings
from torquebench.compensation.curve_uncertainty import student_widening
from torquebench.errors import InputError
from torquebench.message import Message

_BINS = 20
"""Number of bins of the speed, up to the largest speed."""
_FEWEST_IN_BIN = 10
_FEWEST_SPEEDS = 4
_LARGEST_U = 0.3
_REMEDY = "record an empty run over all working speeds, in both directions"
_SEPARATOR = "; drag multiplied by"


def identify_lubrication(
    effects: Sequence[Effect], run: EmptyRun, lubricant: str = ""
) -> MeasuredRotation:
    """Return a chain's rotation with the drag for the present lubricant.

    The factor is fitted such that the chain's drag over speed and temperature describes the
    readings of the run, with a free constant zero. Its standard uncertainty contains the deviations
    of the drag at single speeds.

    Parameters
    ----------
    effects : sequence of Effect
        Effects of the chain.
    run : EmptyRun
        Run with the present lubricant, at any temperature in the chain's range.
    lubricant : str
        Type, amount and operating hours of the lubricant, for the record.

    Raises
    ------
    InputError
        The chain has no measured rotation, or the run doesn't show the factor.
    """
    rotation = next((effect for effect in effects if isinstance(effect, MeasuredRotation)), None)
    if rotation is None:
        raise InputError(
            "a chain without measured drag of its bearings",
            "a chain that was fitted with empty runs",
            "fit it with --empty",
        )
    readings = Readings(
        run.reading_nm,
        speed_rpm=run.speed_rpm,
        temperature_c=run.temperature_c,
        zero_temperature_c=float(run.temperature_c[0]),
        acceleration_rad_s2=run.acceleration,
        angle_rad=run.angle_rad,
        time_s=run.time_s,
        window_s=float(np.median(np.diff(run.time_s))),
    )
    nothing = np.zeros(len(run))
    parts = [
        part
        for effect in effects
        if effect.corrects_reading
        for part in effect.components(readings, nothing)
    ]
    corrected = run.reading_nm + sum((part.value_nm for part in parts), nothing)
    drag = -next(np.asarray(part.value_nm) for part in parts if part.name == "bearing drag")
    turning = direction(run.speed_rpm)
    largest = max(float(np.max(np.abs(run.speed_rpm))), 1e-9)
    cell = turning * (1.0 + np.floor((_BINS - 1e-9) * np.abs(run.speed_rpm) / largest))
    cell[~np.isfinite(corrected)] = np.nan
    means = []
    for number in np.unique(cell[np.isfinite(cell) & (drag != 0.0)]):
        rows = cell == number
        if np.sum(rows) >= _FEWEST_IN_BIN:
            means.append((number, np.mean(drag[rows]), np.mean(corrected[rows])))
    ahead = sum(mean[0] > 0.0 for mean in means)
    back = len(means) - ahead
    if min(ahead, back) < _FEWEST_SPEEDS:
        raise InputError(
            Message(
                "{source}: {ahead} speeds in one direction and {back} in the other that "
                "the chain holds for",
                run.source,
                ahead,
                back,
            ),
            Message("{fewest_speeds} at least in both", _FEWEST_SPEEDS),
            _REMEDY,
        )
    _, expected, measured = np.array(means).T
    centred = expected - np.mean(expected)
    power = float(centred @ centred)
    slope = float(centred @ measured) / max(power, 1e-300)
    free = expected.size - 2
    spread = measured - np.mean(measured) - slope * centred
    noise = float(spread @ spread) / free
    factor = rotation.lubrication * (1.0 + slope)
    left_over = float(np.sum(np.square(spread / expected))) / free
    # of the slope, and of the deviations from one common factor at single speeds
    relative = np.sqrt(noise / max(power, 1e-300) + left_over)
    u = float(rotation.lubrication * student_widening(free) * relative)
    if not (u <= _LARGEST_U * max(factor, 0.0)):
        raise InputError(
            Message(
                "{source}: drag of {factor:.3g} times the chain's, with u = {u:.2g}",
                run.source,
                factor,
                u,
            ),
            Message("a positive factor, known to {largest_u:g} %", 100.0 * _LARGEST_U),
            Message(
                "{remedy}, at a steady temperature and for longer; or, if the drag has "
                "changed differently at each speed, fit the chain with this run as "
                "--empty",
                _REMEDY,
            ),
        )
    words = f"{rotation.record.partition(_SEPARATOR)[0]}{_SEPARATOR} {factor:.3g} by {run.source}"
    return replace(
        rotation,
        record=words + (f" ({lubricant})" if lubricant else ""),
        lubrication=factor,
        lubrication_uncertainty=u,
    )
