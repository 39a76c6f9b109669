"""Temporary limits: while a procedure runs, the supervisor allows only what the procedure needs."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import replace
from typing import Any, TypeVar

import bluesky.preprocessors as bpp
from bluesky.utils import Msg

from torquebench.bench.devices import BenchDevices
from torquebench.bench.drivers.base import Side
from torquebench.bench.interlocks import check_speed_limit, check_torque_limit
from torquebench.bench.safety.limits import StepLimits

__all__ = ["StepLimits", "guarded", "loading_limits", "torque_limits", "turning_limits"]

Result = TypeVar("Result")

TORQUE_MARGIN = 1.05
"""Factor by which a reading may exceed the largest requested torque."""
ZERO_MARGIN = 0.02
"""Additional allowance for a zero that wasn't measured yet, as a share of the range."""
STANDING_RPM = 5.0
STANDING_DEG = 5.0
"""Largest speed, 1/min, and angle, degrees, of a clamped side: allows wind-up and backlash, but not
slip."""
RATE_MARGIN = 4.0
"""Factor on the drive's own rate up to which a torque or a speed may change."""
SPEED_MARGIN = 1.05
SPEED_MARGIN_RPM = 30.0
"""Allowance for a drive's overshoot at the end of a ramp, which is proportional to its rate, not to
its speed."""


def torque_limits(devices: BenchDevices, side: Side, largest_nm: float) -> StepLimits:
    """Return the limits for loading a side up to a torque.

    Parameters
    ----------
    side : {"input", "output"}
        The driven module.
    largest_nm : float
        Largest commanded magnitude, N·m.

    Raises
    ------
    LimitError
        The bench doesn't allow it.
    """
    module = devices.context.description.module(side)
    check_torque_limit(side, largest_nm, module.limits.torque_nm)
    return StepLimits(
        side, torque_nm=TORQUE_MARGIN * abs(largest_nm) + ZERO_MARGIN * module.range_nm
    )


def loading_limits(devices: BenchDevices, side: Side, largest_nm: float) -> StepLimits:
    """Return the limits for loading a clamped side; see `torque_limits`."""
    drive = devices.context.description.module(side).drive
    return replace(
        torque_limits(devices, side, largest_nm),
        speed_rpm=STANDING_RPM,
        angle_deg=STANDING_DEG,
        torque_rate_nm_per_s=RATE_MARGIN * drive.torque_rate_nm_per_s,
    )


def turning_limits(devices: BenchDevices, side: Side, largest_rpm: float) -> StepLimits:
    """Return the limits for turning a side up to a speed, rpm.

    Raises
    ------
    LimitError
        The bench doesn't allow it.
    """
    module = devices.context.description.module(side)
    check_speed_limit(side, largest_rpm, module.limits.speed_rpm)
    return StepLimits(
        side,
        speed_rpm=SPEED_MARGIN * abs(largest_rpm) + SPEED_MARGIN_RPM,
        speed_rate_rpm_per_s=RATE_MARGIN * module.drive.speed_rate_rpm_per_s,
    )


def guarded(
    plan: Callable[[], Generator[Msg, Any, Result]], *limits: StepLimits
) -> Generator[Msg, Any, Result]:
    """Run a plan, or one step of it, under narrower limits than the bench's.

    They are removed however the plan ends; if the engine hangs, the station removes them after the
    run.

    Parameters
    ----------
    plan : callable
        Function that returns the plan.
    *limits : StepLimits
        Limits; one that is wider than the limit in force has no effect.
    """
    numbers = yield Msg("tighten", None, *limits)

    def loosen() -> Generator[Msg, Any, None]:
        yield Msg("loosen", None, numbers)

    result: Result = yield from bpp.finalize_wrapper(plan(), loosen)
    return result
