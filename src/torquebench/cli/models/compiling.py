"""The one wait that only follows an installation: kernels are compiled."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from typing import TypeVar

from rich.console import Console

from torquebench.cli.terminal.console import is_quiet
from torquebench.processes import end_with_parent

__all__ = ["SecondProcess", "compile_fits", "second_process", "telling_compilation"]

Result = TypeVar("Result")

_TOLD = "compiling numerical kernels, once after an installation: some 15 s"
_told = False


@contextlib.contextmanager
def telling_compilation(console: Console) -> Iterator[None]:
    """Say once in a process that kernels are compiled, if somebody looks at the terminal."""
    if "numba" not in sys.modules or is_quiet() or not console.is_terminal:
        yield
        return

    def tell(_: str) -> None:
        global _told
        if not _told:
            _told = True
            console.print(_TOLD, style="dim")

    with _at_compilation(tell):
        yield


@contextlib.contextmanager
def second_process(*, at_once: bool = False) -> Iterator[SecondProcess]:
    """Offer a second process, which compiles what fits need while this one measures.

    It is started by the first compilation here: where nothing is compiled, there is none.

    Parameters
    ----------
    at_once : bool
        Start it now, for somebody who also wants to compute in it.
    """
    before = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(1, mp_context=context, initializer=_serve)
    compiling = False

    def start(package: str) -> None:
        nonlocal compiling
        if not compiling and package != "torquebench.compensation":
            compiling = True
            with _interrupts_held(), contextlib.suppress(BrokenExecutor):
                pool.submit(compile_fits)

    if at_once:
        with _interrupts_held():
            pool.submit(_import_fits)
    with _at_compilation(start):
        try:
            yield SecondProcess(pool)
        finally:
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
            pool.shutdown()


class SecondProcess:
    """Computes while this process measures; if it dies, this one computes instead."""

    def __init__(self, pool: Executor) -> None:
        self._pool = pool

    def begin(self, function: Callable[[], Result]) -> Callable[[], Result]:
        """Begin a computation, which has to be picklable; return what waits for its result."""
        try:
            future = self._pool.submit(function)
        except BrokenExecutor:
            return function

        def wait() -> Result:
            try:
                return future.result()
            except BrokenExecutor:  # for want of memory, for instance
                return function()

        return wait


def _serve() -> None:
    """Let a bench that acquires go first, and end with the process that has asked."""
    with contextlib.suppress(AttributeError):  # no niceness on Windows
        os.nice(10)
    end_with_parent()


def _import_fits() -> None:
    """Import what fits need, before there is one."""
    import torquebench.campaign.fitting  # noqa: F401


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Start processes that Ctrl-C doesn't reach: whoever has started them ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def compile_fits() -> None:
    """Count a few edges, fit the demo's models to a few points, take a reading through each.

    That compiles the kernels: the counter's first, because a simulated bench needs it right after
    its own.
    """
    import numpy as np

    from torquebench.bench.active_chain import ActiveChain
    from torquebench.bench.description import default_bench
    from torquebench.calibration import CalibrationData
    from torquebench.campaign.demo import DemoSettings
    from torquebench.campaign.fitting import fit_models
    from torquebench.signals import EdgeBlock, FrequencyCounter

    counting = default_bench().counter
    counter = FrequencyCounter(counting.method, counting.window_s, counting.timebase_hz)
    stop_tick = 2 * counter.window_ticks
    counter.push(EdgeBlock(np.arange(0, stop_tick, 1600), 0, stop_tick, counting.timebase_hz))
    rising = np.linspace(0.1, 1.0, 10)
    torque_nm = np.concatenate((rising, rising[::-1], -rising, -rising[::-1]))
    branch = np.tile(np.repeat([1, -1], 10), 2)
    reading_nm = torque_nm * (1.001 + 1e-3 * branch * (1.0 - abs(torque_nm)))
    data = CalibrationData(reading_nm, torque_nm, np.repeat([1, 2], 20), branch, 1.0)
    for fitted in fit_models(data, DemoSettings().choices()):
        ActiveChain(fitted.chain, "", fitted.model.kind).warm_up()


@contextlib.contextmanager
def _at_compilation(act: Callable[[str], None]) -> Iterator[None]:
    """Call at every start of a compilation, with the package of what is compiled."""
    from numba.core import event

    class Compiling(event.Listener):
        def on_start(self, event: event.Event) -> None:
            module: str = event.data["dispatcher"].py_func.__module__
            act(".".join(module.split(".")[:2]))

        def on_end(self, event: event.Event) -> None:
            pass

    listener = Compiling()
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
