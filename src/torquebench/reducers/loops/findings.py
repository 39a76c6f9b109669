"""Defects of torque-angle loops, by name: refused, or stated with the result."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.loops.results import LoopFeatures
from torquebench.reducers.loops.rules import LoopSettings
from torquebench.reducers.quantities import Finding
from torquebench.units import ARCMIN, DEG_PER_RAD

__all__ = ["check_closure", "check_columns", "loop_findings"]

Floats = NDArray[np.float64]
PRELOAD_SHARE = 0.06
"""A loop whose smallest stiffness is beyond this share of the rated torque has a preload."""
SOFTER = 2.0
WIDEST_TWIST_RAD = 0.5


def check_columns(torque: Floats, angle: Floats, rated_torque_nm: float) -> None:
    """Refuse columns whose values don't fit their names.

    Raises
    ------
    InputError
        If torque and angle are swapped, one is constant, or they have opposite signs.
    """
    for name, column in (("torque", torque), ("angle", angle)):
        if np.ptp(column) == 0.0:
            raise InputError(
                Message("the {name} stands still at {column:.6g}", name, column[0]),
                Message("{name}s that change", name),
                "check the channel",
            )
    torque_range, angle_range = float(np.ptp(torque)), float(np.ptp(angle))
    if torque_range < 0.1 * rated_torque_nm and angle_range > 0.5 * rated_torque_nm:
        raise InputError(
            Message(
                "a torque of {torque_range:.4g} N·m over an angle of {angle_range:.4g} rad",
                torque_range,
                angle_range,
            ),
            Message("loops to about {rated_torque_nm:g} N·m", rated_torque_nm),
            "torque and angle are swapped: name the columns the other way round",
        )
    if angle_range > WIDEST_TWIST_RAD and torque_range < 2.5 * rated_torque_nm:
        raise InputError(
            Message("an angle that moves by {degrees:.4g}°", angle_range * DEG_PER_RAD),
            Message(
                "a twist of at most {degrees:.3g}° with the input locked",
                WIDEST_TWIST_RAD * DEG_PER_RAD,
            ),
            "check the angle's unit, that the input is locked, and label the output positions",
        )
    together = float(np.corrcoef(torque, angle)[0, 1])
    if together < 0.0:
        raise InputError(
            "an angle that falls while the torque rises",
            "torque and angle of one sign",
            "reverse the sign of one of them",
        )


class OpenLoopError(InputError):
    """A torque-angle loop doesn't close; `loop` has its features.

    Parameters
    ----------
    loop : LoopFeatures
    found, allowed, remedy : str
        As of every error.
    """

    def __init__(self, loop: LoopFeatures, found: str, allowed: str = "", remedy: str = "") -> None:
        super().__init__(found, allowed, remedy)
        self.loop = loop

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (self.loop, self.found, self.allowed, self.remedy))


def check_closure(loops: list[LoopFeatures], settings: LoopSettings) -> None:
    """Refuse loops that don't close.

    Raises
    ------
    InputError
        Where the gap between a loop's start and its end exceeds the allowed share of its width.
    """
    for each in loops:
        width = float(np.ptp([each.curve.rising_rad, each.curve.falling_rad]))
        noise = float(np.median(each.curve.rising_standard_error_rad))
        if abs(each.closure_rad) > max(settings.closure_share * width, 6.0 * noise):
            raise OpenLoopError(
                each,
                Message(
                    "loop {loop} at position {position:g} doesn't close: its end is "
                    "{degrees:.3g} arcmin off its start ({closure_rad:.3g} % of its width)",
                    each.loop,
                    each.position,
                    each.closure_rad / ARCMIN,
                    100 * each.closure_rad / width,
                ),
                Message("at most {closure_share:g} % of the width", 100 * settings.closure_share),
                "preload to the rated torque first, check clamps and encoder for slip and the "
                "locked input for creeping",
            )


def loop_findings(loops: list[LoopFeatures], settings: LoopSettings) -> list[Finding]:
    """Return remarks about evaluated loops."""
    findings = []
    positions = {each.position for each in loops}
    rule = settings.lost_motion_rule
    if len(loops) < 3 * len(positions):
        findings.append(
            Finding(
                "few loops",
                Message("{loops} whole loops at one position", len(loops))
                if len(positions) == 1
                else Message(
                    "{loops} whole loops at {positions} positions", len(loops), len(positions)
                ),
                "record at least three loops at each position",
            )
        )
    if len(positions) < rule.least_positions:
        findings.append(
            Finding(
                "few positions",
                Message(
                    "{positions} output positions; {source} asks for {count}",
                    len(positions),
                    rule.source,
                    rule.least_positions,
                ),
                "repeat the loops at more output positions",
            )
        )
    hidden = _preload(loops, settings)
    if hidden is not None:
        findings.append(hidden)
    if any(each.backlash_rad < -6.0 * each.backlash_error_rad for each in loops):
        findings.append(
            Finding(
                "loop runs backwards",
                "the falling branch lies below the rising one: the loop would gain energy",
                "check for a delay between torque and angle, and the signs of both",
                severe=True,
            )
        )
    return findings


def _preload(loops: list[LoopFeatures], settings: LoopSettings) -> Finding | None:
    """Find loops that are much softer far from zero torque than at it."""
    centres = []
    for each in loops:
        curve = each.curve
        width = 0.02 * settings.rated_torque_nm
        grid = np.arange(curve.torque_nm[0] + width, curve.torque_nm[-1] - width, 0.5 * width)
        grid = grid[np.abs(grid) < 0.8 * each.largest_torque_nm]
        middle = 0.0
        for branch in (curve.rising_rad, curve.falling_rad):
            ends = [np.interp(grid + s * width, curve.torque_nm, branch) for s in (-1.0, 1.0)]
            softness = (ends[1] - ends[0]) / (2.0 * width)
            peak = int(np.argmax(softness))
            if softness[peak] < SOFTER * float(np.median(softness)):
                return None
            middle += 0.5 * float(grid[peak])
        centres.append(middle)
    found = float(np.median(centres))
    if abs(found) <= PRELOAD_SHARE * settings.rated_torque_nm:
        return None
    return Finding(
        "backlash hidden by preload",
        Message(
            "the loop is softest around {found:.4g} N·m instead of 0 N·m: a constant "
            "torque keeps the flanks together, and the width at zero torque doesn't "
            "show the backlash",
            found,
        ),
        "remove the preload (weight on a horizontal shaft, brake, coupling), check the zero",
        severe=True,
    )
