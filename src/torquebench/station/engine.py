"""The run engine of an open bench, with bench time and pauses between points."""

from __future__ import annotations

import asyncio
import contextlib
import io
import logging
import threading
from collections.abc import Callable, Coroutine, Generator, Iterator
from typing import Any, TypeVar

from bluesky.run_engine import RunEngine, RunEngineResult, set_bluesky_event_loop
from bluesky.utils import (
    DuringTask,
    FailedStatus,
    Msg,
    RequestAbort,
    RunEngineInterrupted,
    TransitionError,
)

from torquebench.bench.clock import BenchClock
from torquebench.bench.safety import SafetySupervisor
from torquebench.progress import NO_PROGRESS, Progress

Plan = Generator[Msg, Any, Any]
Result = TypeVar("Result")

ENGINE, PROCEDURE = "run engine", "procedure"
"""Names of the heartbeats of loop and plan."""
LOOP_TIMEOUT_S = 2.0
"""For how long the run engine's loop may be unresponsive in real time, s."""
INTERRUPT_POLL_S = 0.1
"""Interval at which the waiting caller checks for Ctrl-C and pauses, s of wall time."""

for _name in ("bluesky", "ophyd_async"):  # a failed run raises its error and needs no log on stderr
    logging.getLogger(_name).addHandler(logging.NullHandler())


class _Waiting(DuringTask):
    """Blocks the caller during a run, but handles Ctrl-C and pauses."""

    def __init__(self, engine: BenchEngine) -> None:
        super().__init__()
        self._engine = engine

    def block(self, blocking_event: threading.Event) -> None:
        """Wait until the run is over."""
        while True:
            try:
                while not blocking_event.wait(INTERRUPT_POLL_S):
                    self._engine.attend()
            except KeyboardInterrupt:
                self._engine.on_interrupt()
            else:
                return


class BenchEngine:
    """A Bluesky run engine on a separate event loop, in bench time.

    A pause takes effect at the plan's next checkpoint: the torque goes to zero and the plan waits
    there. Unlike Bluesky's own pause, it doesn't repeat messages afterwards.

    Parameters
    ----------
    procedure_s : float
        For how long a monitored plan may neither send a message nor wait for the bench, s.

    Attributes
    ----------
    pauses : int
        Number of pauses of the present or the last run.
    """

    def __init__(
        self, clock: BenchClock, supervisor: SafetySupervisor, procedure_s: float = 60.0
    ) -> None:
        self._clock = clock
        self._procedure_s = procedure_s
        self._computing = False
        self._supervisor = supervisor
        self.progress: Progress = NO_PROGRESS
        self.on_interrupt: Callable[[], None] = self.abort
        self.attend: Callable[[], None] = lambda: None
        self.pauses = 0
        self._pausing = False
        self._reason = ""
        self._resumed: asyncio.Event | None = None
        self._aborting: asyncio.Task[None] | None = None
        self.loop = clock.new_event_loop()
        self._engine = RunEngine(
            loop=self.loop,
            context_managers=[],  # Bluesky's handler of Ctrl-C would replace this one
            during_task=_Waiting(self),
            call_returns_result=True,
        )
        self._engine.msg_hook = self._on_message
        self._engine.register_command("sleep", self._sleep)
        self._engine.register_command("checkpoint", self._checkpoint)
        self._engine.register_command("progress", self._report)
        self._engine.register_command("tighten", self._tighten)
        self._engine.register_command("loosen", self._loosen)

    @property
    def run_engine(self) -> RunEngine:
        """The Bluesky engine itself."""
        return self._engine

    @property
    def running(self) -> bool:
        """Whether a plan is running or paused."""
        return str(self._engine.state) != "idle"

    @property
    def pausing(self) -> bool:
        """Whether a pause was requested or is in progress."""
        return self._pausing

    @property
    def held(self) -> bool:
        """Whether the plan is paused."""
        return self._resumed is not None

    # -- running ----------------------------------------------------------------------------

    def run(
        self, plan: Plan, on_document: Callable[[str, dict[str, Any]], None]
    ) -> RunEngineResult:
        """Run a plan to its end and return the engine's result.

        Raises
        ------
        Exception
            The plan's error, not wrapped in Bluesky's.
        """
        self._pausing, self._reason, self.pauses = False, "", 0
        try:
            return self._engine(plan, on_document)
        except RunEngineInterrupted:  # aborted, or paused by Bluesky itself
            return self._interrupted()
        except FailedStatus as failed:
            raise _cause(failed) from failed
        finally:
            self._resumed = None

    def _interrupted(self) -> RunEngineResult:
        """Abort a run that Bluesky paused, and return the result of an aborted run."""
        if str(self._engine.state) == "paused":
            self.abort("Bluesky's own pause was used: use Station.pause, which pauses at points")
        return RunEngineResult((), None, "abort", True, self._reason, None)

    @property
    def on_own_thread(self) -> bool:
        """Whether the caller runs on the engine's thread, in a plan or its callbacks."""
        return threading.current_thread() is self._engine._th

    def call(self, coroutine: Coroutine[Any, Any, Result]) -> Result:
        """Run a coroutine on the engine's loop and wait for it."""
        return asyncio.run_coroutine_threadsafe(coroutine, self.loop).result()

    # -- pause, resume, abort ---------------------------------------------------------------

    def pause(self) -> None:
        """Pause the plan at its next checkpoint."""
        self._pausing = True

    def resume(self) -> None:
        """Resume a paused plan."""
        self._pausing = False
        resumed, self._resumed = self._resumed, None
        if resumed is not None:
            self.loop.call_soon_threadsafe(resumed.set)

    def abort(self, reason: str = "") -> None:
        """Abort the running plan, which then cleans up.

        If called on the engine's thread, the plan ends after the caller has returned.
        """
        self._reason = reason
        if self.on_own_thread:
            self._aborting = self.loop.create_task(self._abort_soon(reason))
            return
        if str(self._engine.state) == "paused":  # paused by Bluesky itself: resume it, too
            with _quietly():
                self._engine.abort(reason)
        elif not self.loop.is_closed():
            self.call(self._abort_soon(reason))

    async def _abort_soon(self, reason: str) -> None:
        """Abort the plan even if `asyncio.wait_for` loses the cancellation.

        Bluesky cancels the awaited operation. `asyncio.wait_for`, which every signal of ophyd uses,
        loses the cancellation if the signal answers at the same moment, and the plan would
        continue.
        """
        ends_already = str(self._engine.state) == "aborting"
        with _quietly():
            await self._engine._abort_coro(reason)
            if not ends_already:
                with self._engine._state_lock:
                    self._engine._exception = RequestAbort()

    def close(self) -> None:
        """End the loop and its thread. A second call does nothing."""
        if self.loop.is_closed():
            return
        self.call(_finish_tasks())
        self.loop.call_soon_threadsafe(self.loop.stop)
        self._engine._th.join()
        self.loop.close()
        set_bluesky_event_loop(None)

    def watch(self) -> None:
        """Let the supervisor monitor that the loop responds and the plan makes progress.

        A plan isn't monitored while it is paused, waits for the bench or for another process, or
        while the drives have no power.
        """

        def beat() -> None:
            self._supervisor.heartbeats.beat(ENGINE)
            if self.held or self._clock.sleeping or self._computing:
                self._supervisor.heartbeats.beat(PROCEDURE)

        def ping() -> None:
            self.loop.call_soon_threadsafe(beat)

        self._supervisor.heartbeats.expect(ENGINE, LOOP_TIMEOUT_S, ping)
        self._supervisor.heartbeats.expect(PROCEDURE, self._procedure_s)

    def unwatch(self) -> None:
        """End the monitoring that `watch` began."""
        for name in (ENGINE, PROCEDURE):
            self._supervisor.heartbeats.release(name)

    def _on_message(self, message: Msg) -> None:
        self._computing = message.command == "wait_for"
        self._supervisor.heartbeats.beat(PROCEDURE)

    # -- commands that plans may use --------------------------------------------------------

    async def _sleep(self, message: Msg) -> None:
        """Sleep for a duration in bench time."""
        self._supervisor.raise_if_latched()
        await self._clock.sleep(float(message.args[0]))

    async def _report(self, message: Msg) -> None:
        """Report progress to the run's `Progress`."""
        done, _, detail = message.args
        self.progress.reach(done, detail)

    async def _tighten(self, message: Msg) -> tuple[int, ...]:
        """Apply narrower limits until `_loosen`."""
        return self._supervisor.limits.tighten(*message.args)

    async def _loosen(self, message: Msg) -> None:
        """Remove narrower limits."""
        self._supervisor.limits.loosen(message.args[0])

    async def _checkpoint(self, message: Msg) -> bool:
        """Wait at zero torque while a pause is requested; return whether the plan was paused."""
        await self._engine._checkpoint(message)
        if not self._pausing:
            return False
        await self._clock.sleep(self._supervisor.unload())
        self.pauses += 1
        resumed = self._resumed = asyncio.Event()
        try:
            if self._pausing:  # the pause may have been cancelled meanwhile
                await resumed.wait()
        finally:
            self._resumed = None
        return True


@contextlib.contextmanager
def _quietly() -> Iterator[None]:
    """Suppress Bluesky's output, and its error if the run has ended already."""
    with contextlib.suppress(TransitionError), contextlib.redirect_stdout(io.StringIO()):
        yield


def _cause(failed: BaseException) -> BaseException:
    """Return the original exception of a failed status."""
    found = failed
    while isinstance(found, FailedStatus) and found.__cause__ is not None:
        found = found.__cause__
    return found


async def _finish_tasks() -> None:
    """Cancel the loop's remaining tasks and wait for their end."""
    tasks = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
