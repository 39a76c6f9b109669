"""Register measured runs even if the registry's server restarts meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import Registry

__all__ = ["registered_patiently"]

Result = TypeVar("Result")


def registered_patiently(
    registry: Registry,
    run_id: str,
    register: Callable[[], Result],
    progress: Progress = NO_PROGRESS,
) -> Result:
    """Register the result of a run; progress reports repeated attempts.

    Parameters
    ----------
    registry : Registry
    run_id : str
    register : callable
        One transaction, which finds what an earlier attempt has registered.
    progress : Progress

    Raises
    ------
    RecordError
        The registry or the disk fails; the measured run can be finished later.
    """

    def told(_found: str) -> None:
        progress.start("The registry doesn't answer; trying again")

    try:
        return registry.patiently(register, told=told)
    except (RecordError, InputError, OSError) as error:
        raise RecordError(
            Message(
                "run {run} is measured and sealed, but its result isn't registered: {reason}",
                run_id,
                getattr(error, "found", error),
            ),
            "a writable registry and disk",
            Message(
                "correct this, then run `torquebench records finish {run}`: nothing is "
                "measured again",
                run_id,
            ),
        ) from error
