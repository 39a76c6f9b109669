"""A second process for computations."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from typing import TypeVar

from torquebench.processes import end_with_parent

Result = TypeVar("Result")


@contextlib.contextmanager
def second_process() -> Iterator[SecondProcess]:
    """Provide a second process that computes while this one measures."""
    before = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(1, mp_context=context, initializer=_serve)
    with _interrupts_held():
        pool.submit(_import_fits)
    try:
        yield SecondProcess(pool)
    finally:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        pool.shutdown()


class SecondProcess:
    """A process that computes while this one measures; if it dies, this one computes instead."""

    def __init__(self, pool: Executor) -> None:
        self._pool = pool

    def begin(self, function: Callable[[], Result]) -> Callable[[], Result]:
        """Start a picklable computation; return a function that waits for its result."""
        try:
            future = self._pool.submit(function)
        except BrokenExecutor:
            return function

        def wait() -> Result:
            try:
                return future.result()
            except BrokenExecutor:  # for lack of memory, for instance
                return function()

        return wait


def _serve() -> None:
    """Lower the priority of the second process, and end it with its parent."""
    with contextlib.suppress(AttributeError):  # Windows has no niceness
        os.nice(10)
    end_with_parent()


def _import_fits() -> None:
    """Import the modules for fits in advance."""
    import torquebench.campaign.fitting  # noqa: F401


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Start processes that ignore Ctrl-C, so that their parent ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
