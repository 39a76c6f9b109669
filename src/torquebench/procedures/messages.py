"""The messages of a point, without the bookkeeping of the plan stubs.

Each of Bluesky's plan stubs formats a stack trace to detect a missing `yield from`. Over thousands
of points that takes as long as the simulated bench, so loops over points send their messages
directly; messages that occur once a run use the stubs.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from typing import Any

from bluesky.protocols import Movable, Readable
from bluesky.utils import Msg

__all__ = ["checkpoint", "move", "progress", "take"]

_GROUP = "torquebench-point"


def checkpoint() -> Generator[Msg, Any, None]:
    """Let the run be held here."""
    yield Msg("checkpoint")


def progress(done: int, total: int, message: str) -> Generator[Msg, Any, None]:
    """Report the progress of the run."""
    yield Msg("progress", None, done, total, message)


def move(device: Movable[Any], value: object) -> Generator[Msg, Any, None]:
    """Set a device and wait until it is there."""
    yield Msg("set", device, value, group=_GROUP)
    yield Msg("wait", None, group=_GROUP)


def take(
    detector: Readable[Any], stamp: Readable[Any], *, stream: str
) -> Generator[Msg, Any, Mapping[str, Any]]:
    """Trigger a detector and record its reading with a stamp as an event.

    Parameters
    ----------
    detector : Readable
        Also Triggerable.
    stamp : Readable
        Says which point it is.
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
