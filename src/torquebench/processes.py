"""Processes that work for another process."""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path


def end_with_parent() -> None:
    """End this process as soon as its parent process has ended.

    A killed process can't end its children: without this, they would wait for work forever. Only
    processes that `multiprocessing` has started know their parent; others continue.
    """
    import multiprocessing  # imported late: most commands need no other process

    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, name="torquebench-parent", daemon=True).start()


def open_all_files() -> None:
    """Let this process open as many files as the system grants; a connection takes one of them."""
    try:
        import resource
    except ImportError:  # on Windows
        return
    with contextlib.suppress(OSError, ValueError):
        most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def limit_process(memory_mb: int, seconds: float | None) -> None:
    """Limit this process's further memory and its processor time, where the system can do so."""
    try:
        import resource
    except ImportError:  # on Windows
        return
    with contextlib.suppress(OSError, ValueError):
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        most = used + (memory_mb << 20)
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if seconds is not None:
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 5, int(seconds) + 5))
