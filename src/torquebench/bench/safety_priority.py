"""A little more than others' share of the processor for the threads that safety depends on."""

from __future__ import annotations

import contextlib
import os
import sys
import threading

__all__ = ["prefer_this_thread", "share_interpreter_finely"]

NICENESS = -10
"""As far as the operating system lets a process go; without the right nothing changes."""
SWITCH_INTERVAL_S = 0.001
"""How long one thread may keep the interpreter when another waits for it, s; Python's is 5 ms."""


def prefer_this_thread() -> bool:
    """Ask for priority for the calling thread; True where it was granted."""
    if not hasattr(os, "setpriority"):
        return False
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
        return True
    return False


def share_interpreter_finely() -> None:
    """Let threads of this process take turns more often, for as long as it lives."""
    if sys.getswitchinterval() > SWITCH_INTERVAL_S:
        sys.setswitchinterval(SWITCH_INTERVAL_S)
