"""Features of one torque-angle loop: widths, slopes, energy."""

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.loops.branches import RawLoop
from torquebench.reducers.loops.local_fit import LocalLines
from torquebench.reducers.loops.results import KeyPoint, LoopCurve, LoopFeatures
from torquebench.reducers.loops.rules import LoopSettings

__all__ = ["features_of", "key_points_of"]

Floats = NDArray[np.float64]
CURVE_POINTS = 401
REACHED = 0.97
"""Share of the stiffness interval's upper end that the torque has to reach."""


def features_of(
    raw: RawLoop, torque: Floats, angle: Floats, settings: LoopSettings
) -> LoopFeatures:
    """Read one loop: local fits on both branches, widths, stiffnesses and energy.

    Raises
    ------
    InputError
        Where the torque doesn't pass zero or doesn't reach the stiffness interval, or a branch
        holds too few samples.
    """
    rising = (torque[raw.rising], angle[raw.rising])
    falling = (torque[raw.falling], angle[raw.falling])
    low = max(float(rising[0].min()), float(falling[0].min()))
    high = min(float(rising[0].max()), float(falling[0].max()))
    _check_range(raw, low, high, settings)
    half = settings.window_share * max(high, -low)
    up = LocalLines(*rising, settings.least_samples, half)
    down = LocalLines(*falling, settings.least_samples, half)
    curve = _curve(up, down, low, high)
    share = settings.lost_motion_rule.share * settings.rated_torque_nm
    places = np.array([0.0, share, -share])
    first_nm, last_nm = (part * settings.rated_torque_nm for part in settings.stiffness_interval)
    at_up, at_down = up.curved_at(places), down.curved_at(places)
    middle = 0.5 * (at_up.value + at_down.value)
    energy = float(np.trapezoid(curve.falling_rad - curve.rising_rad, curve.torque_nm))
    return LoopFeatures(
        position=raw.position,
        loop=raw.number,
        curve=curve,
        backlash_rad=float(at_down.value[0] - at_up.value[0]),
        lost_motion_rad=float(middle[1] - middle[2]),
        stiffness_positive_nm_per_rad=_stiffness(rising, 1, first_nm, last_nm, settings),
        stiffness_negative_nm_per_rad=_stiffness(falling, -1, first_nm, last_nm, settings),
        regions_nm_per_rad=_regions(rising, falling, min(high, -low), settings),
        energy_j=energy,
        closure_rad=_closure(raw, torque, angle, up, down),
        slope_at_zero_rad_per_nm=0.5 * float(at_up.slope[0] + at_down.slope[0]),
        slope_at_lost_motion_rad_per_nm=0.25
        * float(at_up.slope[1:].sum() + at_down.slope[1:].sum()),
        slope_difference_at_zero_rad_per_nm=float(at_down.slope[0] - at_up.slope[0]),
        largest_torque_nm=min(high, -low),
        backlash_error_rad=float(np.hypot(at_up.standard_error[0], at_down.standard_error[0])),
        lost_motion_error_rad=0.5
        * float(np.sqrt(np.sum(at_up.standard_error[1:] ** 2 + at_down.standard_error[1:] ** 2))),
    )


def _check_range(raw: RawLoop, low: float, high: float, settings: LoopSettings) -> None:
    where = Message("loop {number} at position {position:g}", raw.number, raw.position)
    if low >= 0.0 or high <= 0.0:
        raise InputError(
            Message(
                "{where}: a torque of {low:.4g} to {high:.4g} N·m, which doesn't pass zero",
                where,
                low,
                high,
            ),
            "a loop from negative to positive torque",
            "remove the preload that hides backlash and lost motion, and check the zero",
        )
    need = settings.stiffness_interval[1] * settings.rated_torque_nm
    if min(high, -low) < REACHED * need:
        raise InputError(
            Message(
                "{where}: the torque reaches {low:.4g} to {high:.4g} N·m only", where, low, high
            ),
            Message("±{need:.4g} N·m, the upper end of the stiffness interval", need),
            "load the reducer further (does the drive saturate?), or state a lower rated torque "
            "or stiffness interval",
        )


def _curve(up: LocalLines, down: LocalLines, low: float, high: float) -> LoopCurve:
    # Twice as dense around zero, where backlash is.
    even = np.linspace(low, high, CURVE_POINTS)
    near = np.linspace(0.1 * low, 0.1 * high, CURVE_POINTS // 2)
    grid = np.unique(np.concatenate([even, near]))
    rising, falling = up.at(grid), down.at(grid)
    return LoopCurve(
        grid, rising.value, falling.value, rising.standard_error, falling.standard_error
    )


def _stiffness(
    branch: tuple[Floats, Floats],
    sign: int,
    low_nm: float,
    high_nm: float,
    settings: LoopSettings,
) -> float:
    """Return ΔT/Δθ by least squares over an interval of the loading branch, N·m/rad."""
    torque, angle = branch
    load = sign * torque
    inside = (load >= low_nm) & (load <= high_nm)
    if np.count_nonzero(inside) < settings.least_samples:
        raise InputError(
            Message(
                "{count} samples between {lower_nm:.4g} and {upper_nm:.4g} N·m",
                np.count_nonzero(inside),
                low_nm,
                high_nm,
            ),
            Message("at least {limit}", settings.least_samples),
            "record more samples per loop",
        )
    x = torque[inside] - torque[inside].mean()
    y = angle[inside] - angle[inside].mean()
    slope = float(x @ y) / float(x @ x)
    if slope == 0.0:
        raise InputError(
            "an angle that doesn't follow the torque",
            "an angle that changes with the torque",
            "check the encoder and the columns",
        )
    return 1.0 / slope


def _regions(
    rising: tuple[Floats, Floats],
    falling: tuple[Floats, Floats],
    largest: float,
    settings: LoopSettings,
) -> Floats:
    found = np.full(3, np.nan)
    if settings.region_torques_nm is None:
        return found
    first, second = settings.region_torques_nm
    ends = [(0.0, first), (first, second), (second, largest)]
    for k, (low, high) in enumerate(ends):
        if min(high, largest) < low + 0.1 * (second - first):
            continue
        both = [
            1.0 / _stiffness(branch, sign, low, min(high, largest), settings)
            for branch, sign in ((rising, 1), (falling, -1))
        ]
        found[k] = 1.0 / float(np.mean(both))
    return found


def _closure(
    raw: RawLoop, torque: Floats, angle: Floats, up: LocalLines, down: LocalLines
) -> float:
    """Return the angle at the end of the loop less the one at its start, at equal torque."""
    rows = np.sort(np.concatenate([raw.rising, raw.falling]))
    count = max(4, rows.size // 100)
    start, end = rows[:count], rows[-count:]
    first, last = float(torque[start].mean()), float(torque[end].mean())
    lines = up if raw.rising[-1] > raw.falling[-1] else down
    slope = float(lines.at([0.5 * (first + last)]).slope[0])
    return float(angle[end].mean() - angle[start].mean()) - slope * (last - first)


def key_points_of(features: LoopFeatures, settings: LoopSettings) -> tuple[KeyPoint, ...]:
    """Return the points of a loop that a figure marks."""
    curve, rule = features.curve, settings.lost_motion_rule
    share = rule.share * settings.rated_torque_nm
    percent = Message("{share:g} %", 100 * rule.share)
    low, high = (part * settings.rated_torque_nm for part in settings.stiffness_interval)
    marks = [
        ("θ↑(0)", 0.0, curve.rising_rad),
        ("θ↓(0)", 0.0, curve.falling_rad),
        (f"θ↑(+{percent})", share, curve.rising_rad),
        (f"θ↓(+{percent})", share, curve.falling_rad),
        (f"θ↑(−{percent})", -share, curve.rising_rad),
        (f"θ↓(−{percent})", -share, curve.falling_rad),
        ("stiffness, lower end", low, curve.rising_rad),
        ("stiffness, upper end", min(high, features.largest_torque_nm), curve.rising_rad),
        ("stiffness, lower end", -low, curve.falling_rad),
        ("stiffness, upper end", -min(high, features.largest_torque_nm), curve.falling_rad),
    ]
    return tuple(
        KeyPoint(label, place, float(np.interp(place, curve.torque_nm, branch)))
        for label, place, branch in marks
    )
