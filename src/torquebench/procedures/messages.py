"""Messages of procedures: Bluesky's plan stubs without their bookkeeping, and those for a point.

Each plan stub formats a stack trace to detect a missing `yield from`. Procedures use the stubs'
undecorated generators, which saves that time.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from inspect import unwrap
from typing import Any, TypeVar

import bluesky.plan_stubs as bps
from bluesky.protocols import Readable
from bluesky.utils import Msg

__all__ = [
    "again_after_pause",
    "checkpoint",
    "leg_checkpoint",
    "move",
    "prepare",
    "progress",
    "read",
    "sleep",
    "take",
]

_GROUP = "torquebench-point"

Stub = Callable[..., Generator[Msg, Any, Any]]
Result = TypeVar("Result")

checkpoint: Stub = unwrap(bps.checkpoint)
"""Allow a pause of the run here; return whether there was one."""
prepare: Stub = unwrap(bps.prepare)
"""Send settings to a device; with `wait=True`, wait until it has applied them."""
read: Stub = unwrap(bps.rd)
"""Read the value of a device without an event."""
sleep: Stub = unwrap(bps.sleep)
"""Sleep in bench time, s."""


class _LegPaused(Exception):  # noqa: N818 - no error: a pause
    """A pause has interrupted a leg of a procedure."""


def leg_checkpoint() -> Generator[Msg, Any, None]:
    """Allow a pause within a leg of `again_after_pause`; after a pause the leg is repeated."""
    if (yield from checkpoint()):
        raise _LegPaused


def again_after_pause(
    leg: Callable[[], Generator[Msg, Any, Result]],
    restore: Callable[[], Generator[Msg, Any, None]] | None = None,
) -> Generator[Msg, Any, Result]:
    """Allow a pause, then drive a leg; repeat the leg after a pause at a `leg_checkpoint`.

    A pause removes the torque and stops the shafts: `restore` is a plan that brings the bench back
    to the state in which the leg begins.
    """
    held = yield from checkpoint()
    while True:
        if held and restore is not None:
            yield from restore()
        try:
            return (yield from leg())
        except _LegPaused:
            held = True


def move(*devices_and_values: Any) -> Generator[Msg, Any, None]:
    """Set devices, each followed by its value, and wait until all are done."""
    devices, values = devices_and_values[::2], devices_and_values[1::2]
    for device, value in zip(devices, values, strict=True):
        yield Msg("set", device, value, group=_GROUP)
    yield Msg("wait", None, group=_GROUP)


def progress(done: int, total: int, message: str) -> Generator[Msg, Any, None]:
    """Report the progress of the run."""
    yield Msg("progress", None, done, total, message)


def take(
    detector: Readable[Any], stamp: Readable[Any], *, stream: str
) -> Generator[Msg, Any, Mapping[str, Any]]:
    """Trigger a detector, and record its reading with a stamp as an event.

    Parameters
    ----------
    detector : Readable
        Detector, which must also be Triggerable.
    stamp : Readable
        Device that states the point to which the event belongs.
    stream : str
        Name of the event stream.

    Returns
    -------
    mapping of str to object
        The detector's values by field, without its name.
    """
    yield Msg("trigger", detector, group=_GROUP)
    yield Msg("wait", None, group=_GROUP)
    yield Msg("create", None, name=stream)
    reading = yield Msg("read", detector)
    yield Msg("read", stamp)
    yield Msg("save")
    prefix = f"{detector.name}-"
    return {key.removeprefix(prefix): entry["value"] for key, entry in reading.items()}
