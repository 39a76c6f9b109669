"""Run long computations in a separate process, so that the bench's threads aren't delayed."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from typing import Any, TypeVar

from torquebench.errors import BenchError, InputError, TorquebenchError
from torquebench.message import Message
from torquebench.operations import EndedError
from torquebench.processes import end_with_parent, limit_process
from torquebench.progress import NO_PROGRESS, Progress

Result = TypeVar("Result")
POLL_INTERVAL_S = 0.2
NICE = 5
PRELOADED = (
    "torquebench.panel.service.jobs.runner",
    "torquebench.campaign.fitting",
    "torquebench.operations.compensating",
    "torquebench.operations.evaluating",
    "torquebench.operations.static",
)
"""Modules that computations need."""
MOST_MB, MOST_S, MOST_RESULT_MB = 4096, 900.0, 32
"""Address space, processor time and result of a computation with foreign files."""
IDLE_S = 120.0
"""Time after the last computation at which the server of forks ends, which holds 200 MB."""


def run_in_process(
    function: Callable[..., Result],
    *arguments: Any,
    progress: Progress = NO_PROGRESS,
    cancelled: Callable[[], str] = str,
    folder: Path | None = None,
    job: bool = False,
) -> Result:
    """Call a function in a separate process and wait for its result.

    Parameters
    ----------
    function : callable
        Function that is importable by name; its last argument is a `Progress`.
    *arguments
        Values that can be pickled.
    progress : Progress
        Receives the function's progress.
    cancelled : callable
        Called every 0.2 s; returns why the process ends, or an empty text.
    folder : path, optional
        The process's working directory, with foreign files: memory and processor time are limited.
    job : bool
        Whether a person watches it and can end it: its processor time isn't limited, and it may
        start processes of its own.

    Raises
    ------
    EndedError
        The computation was cancelled.
    TorquebenchError
        The function's error.
    BenchError
        The process died, or the function failed otherwise.
    """
    with _server():
        return _run(function, arguments, progress, cancelled, folder, job=job)


def _run(
    function: Callable[..., Result],
    arguments: tuple[Any, ...],
    progress: Progress,
    cancelled: Callable[[], str],
    folder: Path | None,
    *,
    job: bool,
) -> Result:
    context = _context()
    here, there = context.Pipe()
    process = context.Process(
        target=_work,
        args=(there, function, arguments, folder, None if job else MOST_S),
        name="torquebench-computation",
        daemon=not job,
    )
    process.start()
    there.close()
    try:
        while True:
            if reason := cancelled():
                raise EndedError(reason)
            if not here.poll(POLL_INTERVAL_S):
                continue
            try:
                kind, content = here.recv()
            except EOFError:
                raise BenchError(
                    "the computing process ended without a result", "", "look at the free memory"
                ) from None
            if kind == "failed":
                raise content
            if kind == "done":
                return content  # type: ignore[no-any-return]
            getattr(progress, kind)(*content)
    finally:
        here.close()
        process.terminate()
        process.join()


@cache
def _context() -> Any:
    """Return how processes begin: as forks of a server with the imports done, where that exists.

    Importing takes seconds of processor time, which would be missing beside the bench.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():  # on Windows
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__, *PRELOADED])
    return context


class _Computations:
    """Number of the running computations; the server of forks ends a while after the last."""

    lock = threading.Lock()
    running = 0
    waiting: threading.Timer | None = None


@contextmanager
def _server() -> Iterator[None]:
    """Keep the server of forks while a computation runs, and end it when it has been idle."""
    with _Computations.lock:
        _Computations.running += 1
        if _Computations.waiting is not None:
            _Computations.waiting.cancel()
            _Computations.waiting = None
    try:
        yield
    finally:
        with _Computations.lock:
            _Computations.running -= 1
            if not _Computations.running:
                _Computations.waiting = threading.Timer(IDLE_S, _end_idle_server)
                _Computations.waiting.name = "torquebench-idle"
                _Computations.waiting.daemon = True
                _Computations.waiting.start()


def _end_idle_server() -> None:
    with _Computations.lock:
        if not _Computations.running and _context().get_start_method() == "forkserver":
            from multiprocessing import forkserver

            # The next computation starts it again. Python has no public way to end it.
            forkserver._forkserver._stop()  # type: ignore[attr-defined]


class _Sent:
    """Sends progress to the waiting process."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def start(self, title: str, total: int | None = None) -> None:
        """Send the beginning of a stage."""
        self._pipe.send(("start", (title, total)))

    def reach(self, done: int, detail: str = "") -> None:
        """Send the number of finished steps."""
        self._pipe.send(("reach", (done, detail)))

    def finish(self, detail: str = "") -> None:
        """Send the end of a stage."""
        self._pipe.send(("finish", (detail,)))


def _work(
    pipe: Connection,
    function: Callable[..., Any],
    arguments: tuple[Any, ...],
    folder: Path | None,
    most_s: float | None,
) -> None:
    end_with_parent()
    if folder is not None:
        os.chdir(folder)
        os.environ["TMPDIR"] = tempfile.tempdir = str(folder)  # an ended process leaves its files
        limit_process(MOST_MB, most_s)
    if hasattr(os, "setpriority"):
        os.setpriority(os.PRIO_PROCESS, 0, NICE)  # the bench's priority is inherited
    try:
        found = function(*arguments, _Sent(pipe))
        content = ForkingPickler.dumps(("done", found))
        if folder is not None and len(content) > MOST_RESULT_MB << 20:
            raise InputError(
                Message("a result of {size} MB", len(content) >> 20),
                Message("at most {size} MB", MOST_RESULT_MB),
                "evaluate a larger file by the command line",
            )
        pipe.send_bytes(content)
    except TorquebenchError as error:
        pipe.send(("failed", error))
    except Exception as error:
        pipe.send(("failed", BenchError(Message("{name}: {error}", type(error).__name__, error))))
