"""Processor priority for the threads that safety depends on.

The reaction to a violation can be delayed by other programs on the processor, and by another thread
that holds the interpreter, which other programs can delay in turn. Acquisition and supervisor
therefore request real-time priority, all other threads of the process a higher priority than other
programs, and the interpreter switches threads quickly. Garbage collection, which stops all threads,
skips objects that existed before the bench was opened, and waits until a block is done. If the
system doesn't grant a priority, it stays unchanged, with a message. `TORQUEBENCH_PRIORITY=usual`
requests nothing, for computers on which other programs matter more.
"""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import threading
from collections.abc import Iterator
from enum import IntEnum

from torquebench.errors import InputError
from torquebench.message import Message

PRIORITY = "TORQUEBENCH_PRIORITY"
"""Environment variable: `best` (default) requests the highest priority, `usual` none."""
BEST, USUAL = "best", "usual"

NICENESS = -10
REAL_TIME_LEVEL = 1
"""The lowest real-time priority: above every usual program, below the system's own threads."""
SWITCH_INTERVAL_S = 0.0002
"""Longest time that one thread keeps the interpreter when another waits, s; Python's is 5 ms."""


class Priority(IntEnum):
    """Granted priority; higher is better."""

    USUAL = 0
    NICE = 1
    REAL_TIME = 2

    @property
    def description(self) -> str:
        """Priority in words, for a record."""
        return ("usual", "nice", "real-time")[self]


def _priority_wanted() -> bool:
    """Return whether the environment wants the best priority, not the usual one."""
    priority = os.environ.get(PRIORITY) or BEST
    if priority not in (BEST, USUAL):
        raise InputError(
            Message("{priority}={asked}", PRIORITY, priority),
            "best or usual",
            "change it, or unset it for best",
        )
    return priority == BEST


def prefer_this_thread() -> Priority:
    """Request the highest priority for the calling thread; return the granted one.

    Threads and processes that it starts don't inherit it.
    """
    if sys.platform != "linux" or os.environ.get(PRIORITY) == USUAL:
        return Priority.USUAL
    policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, policy, os.sched_param(REAL_TIME_LEVEL))
        return Priority.REAL_TIME
    return Priority.NICE if _set_niceness(0, NICENESS) else Priority.USUAL


def available_priority() -> Priority:
    """Test on a separate thread which priority the system grants.

    Raises
    ------
    InputError
        `TORQUEBENCH_PRIORITY` is neither `best` nor `usual`.
    """
    if not _priority_wanted():
        return Priority.USUAL
    granted = [Priority.USUAL]
    trying = threading.Thread(target=lambda: granted.append(prefer_this_thread()))
    trying.start()
    trying.join()
    return granted[-1]


def _set_niceness(thread: int, niceness: int) -> bool:
    """Set the niceness of one thread (0: the caller's); return whether it was granted."""
    if sys.platform != "linux":  # other systems have no niceness of threads
        return False
    with contextlib.suppress(OSError):  # not permitted, or the thread has ended
        os.setpriority(os.PRIO_PROCESS, thread, niceness)
        return True
    return False


class _Lift:
    """Counter of open benches in real time: the process has priority while there is one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._benches = 0
        self._before = (0.0, 0)

    def begin(self) -> None:
        """Raise the process's priority for the first bench, and switch threads more often."""
        with self._lock:
            wanted = _priority_wanted()
            self._benches += 1
            if self._benches > 1:
                return
            niceness = os.getpriority(os.PRIO_PROCESS, 0) if sys.platform == "linux" else 0
            self._before = (sys.getswitchinterval(), niceness)
            gc.freeze()  # walking through the objects of all libraries takes 0.1 to 0.4 s
            lifted = min(niceness, NICENESS) if wanted else niceness
            self._apply(min(sys.getswitchinterval(), SWITCH_INTERVAL_S), lifted)

    def end(self) -> None:
        """Restore the interpreter's settings after the last bench is closed."""
        with self._lock:
            self._benches -= 1
            if self._benches == 0:
                self._apply(*self._before)
                gc.unfreeze()

    @staticmethod
    def _apply(switch_interval_s: float, niceness: int) -> None:
        """Set the interpreter's switch interval and the niceness of all threads."""
        sys.setswitchinterval(switch_interval_s)
        for thread in threading.enumerate():
            if thread.native_id is not None:
                _set_niceness(thread.native_id, niceness)


_LIFT = _Lift()


def lift_process() -> contextlib.ExitStack:
    """Raise the process's priority above other programs until the returned object is closed.

    Raises
    ------
    InputError
        `TORQUEBENCH_PRIORITY` is neither `best` nor `usual`.
    """
    _LIFT.begin()
    lifted = contextlib.ExitStack()
    lifted.callback(_LIFT.end)
    return lifted


@contextlib.contextmanager
def collecting_later() -> Iterator[None]:
    """Keep garbage collection out of the work on a block; a due one follows the work."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
