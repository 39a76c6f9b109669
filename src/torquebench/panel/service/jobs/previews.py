"""Previews of jobs, from a rehearsal of the same plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import SIDES, Side
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.panel.service.jobs.values import JobPreview
from torquebench.procedures import Rehearsal

__all__ = ["confirm_clear", "limits", "staircase_preview"]


def confirm_clear(description: BenchDescription, confirmed: bool) -> None:
    """Refuse to load a real bench that wasn't confirmed to be clear.

    Raises
    ------
    InputError
        `confirmed` is false and the bench isn't simulated.
    """
    if not (confirmed or description.simulated):
        raise InputError(
            Message(
                "{name} is a real bench and nobody has confirmed that it is clear", description.name
            ),
            "bench_clear: true",
            "check that nobody is at the bench, then confirm it",
        )


def limits(description: BenchDescription) -> tuple[dict[str, float], dict[str, float]]:
    """Return the limits of torque (N·m) and speed (rpm) of both sides."""
    torque: dict[str, float] = {}
    speed: dict[str, float] = {}
    for side in SIDES:
        module = description.module(side)
        torque[side], speed[side] = module.limits.torque_nm, module.limits.speed_rpm
    return torque, speed


def staircase_preview(
    description: BenchDescription, side: Side, kind: str, title: str, rehearsal: Rehearsal[Any]
) -> JobPreview:
    """Return the preview of a loading sequence on one side."""
    torque_limit, speed_limit = limits(description)
    moves = [
        (move.time_s, float(move.value))
        for move in rehearsal.moves
        if _is_torque(move.device, side) and isinstance(move.value, int | float)
    ]
    return JobPreview(
        kind=kind,
        title=title,
        duration_s=rehearsal.duration_s,
        points=rehearsal.points,
        largest_torque_nm={side: max((abs(value) for _, value in moves), default=0.0)},
        limit_torque_nm=torque_limit,
        limit_speed_rpm=speed_limit,
        time_s=tuple(time for time, _ in moves),
        target_nm=tuple(value for _, value in moves),
        mounts=_mounts(rehearsal),
    )


def _is_torque(device: str, side: Side) -> bool:
    return device.startswith(side) and "torque" in device


def _mounts(rehearsal: Rehearsal[Any]) -> tuple[str, ...]:
    found: Sequence[Any] = [move.value for move in rehearsal.moves if move.device == "mounting"]
    return tuple(str(value).replace("_", " ") for value in found)
