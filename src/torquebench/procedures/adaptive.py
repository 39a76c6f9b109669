"""Adaptive calibration: a coarse series, then fits and new points in turn."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import TypeVar

from bluesky.utils import Msg

from torquebench.bench.devices import BenchDevices
from torquebench.calibration import (
    AdaptiveRound,
    CalibrationData,
    Placement,
    Profile,
    Step,
    even_points,
    extension_steps,
    place_points,
)
from torquebench.message import Message
from torquebench.procedures.messages import progress
from torquebench.procedures.setup import Plan, Setup
from torquebench.procedures.staircase import Row, load_staircase
from torquebench.procedures.standard_check import StandardCheck

Result = TypeVar("Result")


def meanwhile(work: Callable[[], Result]) -> Plan[Result | None]:
    """Compute something in another thread while the run engine continues to process messages.

    Simulated bench time stops meanwhile. In a rehearsal nothing is computed and the result is None.
    """

    async def on_thread() -> Result:
        return await asyncio.to_thread(work)

    tasks = yield Msg("wait_for", None, [on_thread])
    if tasks is None:
        return None
    result: Result = tasks[0].result()
    return result


def load_adaptively(
    devices: BenchDevices,
    setup: Setup,
    profile: Profile,
    steps: Sequence[Step],
    on_row: Callable[[Step, Row], None],
    data: Callable[[], CalibrationData],
    *,
    template: Step,
    even: int,
    earlier: int = 0,
    check: StandardCheck | None = None,
) -> Plan[Placement | None]:
    """Load a coarse series, then points where they lower the model's uncertainty most.

    All points belong to one run, so that the zero of the coarse series is valid for all. The bench
    is unloaded while the next points are computed. A rehearsal uses evenly spread points, up to the
    whole budget, in place of the unknown ones.

    Parameters
    ----------
    profile : Profile
        With a table ``[adaptive]``.
    steps : sequence of Step
        The coarse series, or the preparation of the bench for a resumed calibration.
    on_row : callable
        Called with every recorded step and its steady value by field.
    data : callable
        Returns all points so far.
    template : Step
        The last point before the placed ones. These are held for the same time, and their series
        are numbered on from its series.
    even : int
        Number of points of the whole coarse series.
    earlier : int
        Number of points in `data` from an interrupted run, before those of these steps.
    check : StandardCheck, optional
        See `load_staircase`.

    Returns
    -------
    Placement or None
        Number of points, and the reason for the end; None in a rehearsal.
    """
    settings = profile.adaptive
    assert settings is not None
    range_nm = float(devices.context.description.module(setup.side).range_nm)
    measured = earlier + sum(step.recorded for step in steps)
    rounds = -(-(settings.points - measured) // settings.points_at_a_time)
    # Each round also loads full scale and back in each direction, beside its points.
    total = len(steps) + settings.points - measured + rounds * 2 * len(profile.signs)
    decisions: list[AdaptiveRound] = []
    more, done = list(steps), 0
    while True:
        yield from load_staircase(devices, setup, more, on_row, done=done, total=total, check=check)
        done += len(more)
        yield from progress(
            done, total, Message("{measured} points: placing the next ones", measured)
        )
        proposed = yield from meanwhile(lambda: place_points(data(), settings))
        count = min(settings.points_at_a_time, settings.points - measured)
        if proposed is not None:
            count = int(proposed.nominal_nm.size)
            decisions.append(proposed.round(measured))
        if count < 1:
            return Placement.of(decisions, settings, even) if decisions else None
        places = (
            even_points(range_nm, count, profile.signs)
            if proposed is None
            else (proposed.nominal_nm, proposed.branch)
        )
        more = extension_steps(places, template, profile.signs, range_nm)
        template = template.model_copy(update={"series": more[-1].series})
        measured += count
