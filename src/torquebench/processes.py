"""Processes that work for another process."""

from __future__ import annotations

import multiprocessing
import os
import threading

__all__ = ["end_with_parent"]


def end_with_parent() -> None:
    """End this process as soon as its parent process has ended.

    A killed process can't end its children: without this, they would wait for work forever. Only
    processes that `multiprocessing` has started know their parent; others continue.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, name="torquebench-parent", daemon=True).start()
