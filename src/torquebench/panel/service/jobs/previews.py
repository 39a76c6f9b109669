"""Previews of jobs, from a rehearsal of the same plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torquebench.bench.roles import Side
from torquebench.panel.service.jobs.values import JobPreview
from torquebench.procedures import Rehearsal

__all__ = ["staircase_preview"]


def staircase_preview(
    side: Side, kind: str, title: str, rehearsal: Rehearsal[Any], doubts: tuple[str, ...] = ()
) -> JobPreview:
    """Return the preview of a loading sequence on one side."""
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
        time_s=tuple(time for time, _ in moves),
        nominal_nm=tuple(value for _, value in moves),
        mounts=_mounts(rehearsal),
        doubts=doubts,
    )


def _is_torque(device: str, side: Side) -> bool:
    return device.startswith(side) and "torque" in device


def _mounts(rehearsal: Rehearsal[Any]) -> tuple[str, ...]:
    mountings: Sequence[Any] = [move.value for move in rehearsal.moves if move.device == "mounting"]
    return tuple(str(value).replace("_", " ") for value in mountings)
