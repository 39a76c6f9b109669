"""The station: an open bench, which commands and panel control through it."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, Self

from torquebench.bench.acquisition import Acquisition
from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.audit.entries import AUDIT_FOLDER, AuditLog
from torquebench.bench.audit.writing import audited
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription, default_bench, load_bench
from torquebench.bench.devices import BenchDevices
from torquebench.bench.devices.context import BenchContext
from torquebench.bench.drivers import open_drivers
from torquebench.bench.drivers.base import DriverSet, OperatorPrompts
from torquebench.bench.interlocks import PresentState, check_identities
from torquebench.bench.roles import SIDES, Side, torque_channel
from torquebench.bench.safety import Alarm, AlarmKind, RaisedAlarm, SafetySupervisor
from torquebench.bench.safety.priority import available_priority
from torquebench.bench.state import CommandState
from torquebench.chain import Timebase
from torquebench.compensation import CompensationModel
from torquebench.errors import BenchError, RecordError, TorquebenchError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import Registry, RunFolder
from torquebench.records.runs.time_check import clock_behind
from torquebench.station.bench_lock import BenchLock
from torquebench.station.engine import BenchEngine, Plan
from torquebench.station.matching import compensation_for
from torquebench.station.recording import OpenRun, Recording, RunEnd, RunRecord
from torquebench.station.registration import register_equipment
from torquebench.station.registry_queue import RegistryQueue
from torquebench.station.unfinished import RecoveredRun, recover_unfinished

logger = logging.getLogger(__name__)

UNLOADED_WITHIN_S = 1.0
"""Longest bench time to wait for unloaded readings after both drives have zero torque, s."""
REST_TIMEOUT_S = 5.0
"""Longest wait for the drives' safe state in addition to `stall_s`, s of wall time."""

REGISTRY_WAIT_S = 10.0
"""Longest wait for the registry's server when a bench is opened, s of wall time."""

OnPause = Callable[["Station"], Literal["resume", "abort"]]


def data_directory(data_dir: Path | str | None = None) -> Path:
    """Return the data directory: as given, `$TORQUEBENCH_DATA`, or `./torquebench-data`."""
    return Path(data_dir or os.environ.get("TORQUEBENCH_DATA") or "torquebench-data")


class Station:
    """An open bench.

    As a context manager it brings the bench to zero torque at the end, ends every thread and closes
    the instruments::

        with Station.open(None, "torquebench-data") as station:
            record = station.run(plan(station.devices), kind="calibrate-output")

    Plans have additional commands: `Msg("sleep", None, seconds)` (sent by `bps.sleep`) sleeps in
    bench time; `Msg("progress", None, done, total, detail)` reports the number of finished steps to
    the `Progress` of `run`.

    Attributes
    ----------
    interrupt_action : {"abort", "pause"}
        Action of the first Ctrl-C during a run; a second one always aborts.
    """

    def __init__(
        self,
        description: BenchDescription,
        drivers: DriverSet,
        data_dir: Path,
        *,
        real_time: bool = False,
    ) -> None:
        self.description = description
        self.data_dir = data_dir
        self.interrupt_action: Literal["abort", "pause"] = "abort"
        self.clock = BenchClock(fast=drivers.simulated_time and not real_time)
        commands = CommandState()
        self.audit = AuditLog(
            data_dir / AUDIT_FOLDER, bench=description.name, bench_time=self.clock.now
        )
        ramp_s = description.safety.ramp_to_zero_s
        own = audited(drivers, self.audit, "supervisor", lambda: None, ramp_s)
        self.supervisor = SafetySupervisor(description, own, self.clock, commands)
        self.supervisor.subscribe(self._audit_alarm)
        self.audit.on_failure = self._warn_of_audit
        drivers = audited(drivers, self.audit, "procedure", lambda: self.supervisor.alarm, ramp_s)
        self.drivers = drivers
        self.recovered: tuple[RecoveredRun, ...] = ()
        self.acquisition = Acquisition(description, drivers, self.clock, self.supervisor, commands)
        self.state = PresentState(description, drivers, self.supervisor, commands, self.acquisition)
        self._commands = commands
        context = BenchContext(
            description,
            drivers,
            self.clock,
            self.acquisition,
            self.supervisor,
            self.state,
            commands,
        )
        self.devices = BenchDevices(context)
        self.engine = BenchEngine(self.clock, self.supervisor, description.safety.procedure_s)
        self.engine.on_interrupt = self._on_interrupt
        self._run_lock = threading.Lock()
        self._open_runs: set[OpenRun] = set()
        self._lock: BenchLock | None = None
        self._registry_warning: int | None = None
        self._closed = False

    # -- opening and closing ----------------------------------------------------------------

    @classmethod
    def open(
        cls,
        description: BenchDescription | Path | str | None = None,
        data_dir: Path | str | None = None,
        *,
        real_time: bool = False,
        operator: OperatorPrompts | None = None,
        drivers: DriverSet | None = None,
    ) -> Self:
        """Open the bench: drivers, acquisition, devices, run engine, registry.

        Parameters
        ----------
        description : BenchDescription, path or None
            None opens the packaged simulated bench.
        data_dir : path, optional
            Default: `$TORQUEBENCH_DATA`, else `./torquebench-data`.
        real_time : bool
            Whether simulated time runs in real time instead of as fast as possible.
        operator : OperatorPrompts, optional
            Interface to the operator; by default the driver's.
        drivers : DriverSet, optional
            Instruments that are open already, which the station closes; by default it opens those
            of the description.

        Raises
        ------
        InputError
            The description is invalid, or another process has locked the bench or its records.
        BenchError
            An instrument doesn't answer.
        """
        if description is None:
            description = default_bench()
        elif not isinstance(description, BenchDescription):
            description = load_bench(description)
        with contextlib.ExitStack() as opened:
            lock = BenchLock(description, data_directory(data_dir))
            opened.callback(lock.release)
            description = description.certified_by({})
            drivers = drivers or open_drivers(description)
            description = description.certified_by(drivers.certificates)
            if operator is not None:
                drivers = replace(drivers, operator=operator)
            station = cls(description, drivers, data_directory(data_dir), real_time=real_time)
            station._lock = lock
            opened.callback(station.close)
            station._start()
            opened.pop_all()
        return station

    def _start(self) -> None:
        self.registry = Registry.open(self.data_dir, longest_s=REGISTRY_WAIT_S)
        self.clock_behind = clock_behind(self.registry)
        check_identities(self.description, self.drivers.identities())
        self.registry.patiently(lambda: register_equipment(self.registry, self.description))
        self.registry.head()
        self.recovered = self.registry.patiently(lambda: recover_unfinished(self.registry))
        self.queue = RegistryQueue(self.registry, self._warn_of_registry, self._clear_registry)
        for run in self.recovered:
            if run.problem and (folder := RunFolder(self.data_dir / "runs" / run.run_id)).sealed:
                self.queue.enter(folder.path)
        self.audit.write_soon(
            "bench opens",
            recovered=[run.run_id for run in self.recovered],
            priority=("usual" if self.clock.fast else available_priority().description),
        )
        self.supervisor.start()
        self.acquisition.start()
        self.engine.call(self.devices.connect())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _traceback: object) -> None:
        try:
            self.close()
        except BenchError as unsafe:
            if error is None or str(error) != str(unsafe):  # otherwise reported already
                raise

    def close(self) -> None:
        """Bring the bench to zero torque, end every thread and close the instruments.

        Raises
        ------
        BenchError
            A running plan calls this method, which would wait for the plan; or a drive isn't off
            after closing, and the message states its torque and power.
        """
        if self._closed:
            return
        if self.engine.on_own_thread:
            raise BenchError(
                "a running plan tried to close its bench",
                "closing by the program that opened it",
                "abort the run and close the bench when it has returned",
            )
        self._closed = True
        if self.engine.running:
            self.abort("the bench is being closed")
        self._come_to_rest(disable=True)
        unsafe = self.supervisor.unsafe
        if unsafe is None and self.supervisor.unconfirmed:
            unsafe = self.supervisor.read_off(torque=True)
        self.acquisition.close()
        self.supervisor.close()
        self.engine.close()
        self.drivers.close()
        self.audit.write("bench closes")
        self.audit.close()
        if hasattr(self, "queue"):
            self.queue.close()
        if hasattr(self, "registry"):
            self._note_audit_end()
            self.registry.close()
        if self._lock is not None:
            self._lock.release()
        if unsafe is not None:
            raise unsafe.error()

    def _note_audit_end(self) -> None:
        """Register the end of the audit log, so that a later removal of lines is detected."""
        end = self.audit.end
        if not end.line:
            return
        try:
            self.registry.add_audit_end(self.audit.path.parent, end.line, end.sha256)
        except RecordError as error:  # the next closing registers these lines, too
            logger.warning("the end of the audit log can't be noted: %s", error)

    def _come_to_rest(self, *, disable: bool) -> None:
        """Bring both drives to zero torque; ignore errors of a bench that stopped already."""
        if not self._commands.any_enabled:
            return
        unloading_s = self.supervisor.unload()
        with contextlib.suppress(TorquebenchError):
            self.clock.wait(unloading_s)
        if disable:
            self.supervisor.disable()
        with contextlib.suppress(TorquebenchError):
            self._await_unloaded()

    def _await_unloaded(self) -> None:
        """Wait until the readings are near zero, so that the next run starts without torque."""
        block_s = self.description.counter.block_s
        for _ in range(round(UNLOADED_WITHIN_S / block_s)):
            if all(self._is_unloaded(side) for side in SIDES):
                return
            self.clock.wait(block_s)

    def _is_unloaded(self, side: Side) -> bool:
        reading = self.acquisition.reading_nm(torque_channel(side))
        return abs(reading) <= self.description.unloaded_nm(side)

    # -- runs -------------------------------------------------------------------------------

    def run(
        self,
        plan: Plan,
        *,
        kind: str,
        metadata: Mapping[str, Any] | None = None,
        progress: Progress = NO_PROGRESS,
        on_pause: OnPause | None = None,
        files: Callable[[], Mapping[str, bytes]] = dict,
    ) -> RunRecord:
        """Run a plan to its end and record it in a run folder.

        The caller is blocked; `pause`, `resume` and `abort` are called from other threads, and
        Ctrl-C pauses, too. The bench is at zero torque at the end, even after an error.

        Parameters
        ----------
        kind : str
            Kind of run, such as "calibrate-output": letters, digits and hyphens.
        metadata : mapping, optional
            Stored at the start of the run: operator, profile and other data known beforehand.
        progress : Progress, optional
            Receives the number of finished steps, on the engine's thread.
        on_pause : callable, optional
            Called on the calling thread at a pause; returns how to continue. Without it, a paused
            run waits for `resume` or `abort`.
        files : callable, optional
            Returns additional files of the run by name. They are written at the end of the plan
            before the results, even if the plan failed.

        Returns
        -------
        RunRecord
            Record with `exit_status` "success" or "abort".

        Raises
        ------
        BenchError
            Another run is under way.
        TorquebenchError
            The plan's error, or the alarm that ended it. The folder is sealed as failed.
        """
        with self._only_run(plan):
            self.supervisor.raise_if_latched()
            started_s = self.clock.now()
            alarms_before = len(self.supervisor.history)
            recording = Recording(
                self.open_run(kind, metadata or {}), self.devices.context, self.audit
            )
            writer = recording.writer
            self.engine.progress = progress
            self.engine.attend = lambda: self._attend(on_pause)

            finish = partial(self._finish, recording)
            if not self.clock.fast:
                self.engine.watch()
            try:
                try:
                    outcome = self.engine.run(plan, recording.document)
                except BaseException:
                    with contextlib.suppress(TorquebenchError):  # the plan's error counts
                        writer.write_files(files())
                    raise
                writer.write_files(files())
                aborted = outcome.exit_status != "success"
                if not aborted and outcome.plan_result is not None:
                    writer.write_results(outcome.plan_result)
            except Exception as error:
                recording.end_failed(finish, self._cause(error, alarms_before))
                cause = self._cause(
                    error, alarms_before
                )  # no drive may have torque or power at rest
                if cause is error:
                    raise
                raise cause from error
            except BaseException as error:  # a second Ctrl-C: seal the folder nevertheless
                recording.end_failed(finish, error)
                raise
            reason = outcome.reason if aborted else ""
            finish("aborted" if aborted else "completed", reason)
            return RunRecord(
                run_id=writer.run_id,
                kind=kind,
                folder=writer.path,
                exit_status="abort" if aborted else "success",
                result=None if aborted else outcome.plan_result,
                reason=reason,
                bench_seconds=self.clock.now() - started_s,
                interruptions=self.engine.pauses,
                alarms=self.supervisor.history[alarms_before:],
                metadata=recording.known,
            )

    @contextlib.contextmanager
    def _only_run(self, plan: Plan) -> Iterator[None]:
        """Refuse a second run meanwhile; close the plan afterwards, even one that never started."""
        try:
            if not self._run_lock.acquire(blocking=False):
                raise BenchError(
                    "another run is in progress", "one run at a time", "wait for it, or abort it"
                )
            try:
                yield
            finally:
                self._run_lock.release()
        finally:
            with contextlib.suppress(ValueError):  # the engine's loop hangs in this run
                plan.close()

    def open_run(self, kind: str, metadata: Mapping[str, Any]) -> OpenRun:
        """Make the folder of a run, and enter its beginning into the registry."""
        runs, ended = self.data_dir / "runs", self._open_runs.discard
        run = OpenRun(self.devices.context, self.registry, self.queue, runs, kind, metadata, ended)
        self._open_runs.add(run)
        return run

    def annotate(self, annotation: Mapping[str, Any]) -> None:
        """Write an annotation into every run that is being recorded.

        Parameters
        ----------
        annotation : mapping
            `time` (s since 1970), `bench_time_s`, `note` and `who`.

        Raises
        ------
        RecordError
            It can't be written.
        """
        for run in tuple(self._open_runs):
            run.annotate(annotation)

    def _finish(self, recording: Recording, status: RunEnd, reason: str) -> None:
        """Bring the bench to rest, end the recording, seal the folder and register the run."""
        self.engine.unwatch()
        self.supervisor.limits.loosen()
        self._come_to_rest(disable=status != "completed")
        self.supervisor.wait_safe(self.description.safety.stall_s + REST_TIMEOUT_S)
        self.engine.progress = NO_PROGRESS
        self.engine.attend = lambda: None
        recording.end(status, reason)

    def _cause(self, error: Exception, alarms_before: int) -> Exception:
        """Return why a run failed: remaining torque or power, else an alarm, else the error."""
        if (unsafe := self.supervisor.unsafe) is not None:
            return unsafe.error()
        alarms = self.supervisor.history[alarms_before:]
        return alarms[0].error() if alarms else error

    @property
    def alarms(self) -> tuple[RaisedAlarm, ...]:
        """Active alarms and warnings, the most severe first."""
        return self.supervisor.alarms

    def _audit_alarm(self, entry: RaisedAlarm) -> None:
        """Write a change of an alarm into the audit log."""
        alarm = entry.alarm
        event = alarm.level.name.lower() + " alarm"
        if entry.acknowledged is not None:
            event += " acknowledged"
        elif entry.cleared is not None:
            event += " cleared"
        # Acquisition and supervisor, which report changes, must not wait for the disk.
        write = self.audit.write_soon if entry.acknowledged is None else self.audit.write
        write(
            event,
            number=alarm.number,
            alarm=alarm.name,
            found=alarm.found,
            allowed=alarm.allowed,
            **({"by": entry.acknowledged_by} if entry.acknowledged_by else {}),
        )

    def _warn_of_audit(self, failure: str) -> None:
        self.supervisor.warn(
            AlarmKind.AUDIT,
            "audit log",
            Message("a line can't be written: {failure}", failure),
            "every command in the audit log",
            "make room on the disk or repair it",
        )

    def _warn_of_registry(self, failure: str, waiting: int) -> None:
        runs = "1 run waits" if waiting == 1 else Message("{count} runs wait", waiting)
        alarm = self.supervisor.warn(
            AlarmKind.REGISTRY,
            "registry",
            Message(
                "it can't store measured runs: {failure}; {runs} in the data directory",
                failure,
                runs,
            ),
            "a registry that answers",
            "check whether its server runs and has free space; waiting runs are then "
            "stored automatically",
        )
        self._registry_warning = alarm.number

    def _clear_registry(self) -> None:
        number, self._registry_warning = self._registry_warning, None
        if number is not None:
            self.supervisor.clear_warning(number)

    def acknowledge_alarm(self, who: str, seen: Collection[int] | None = None) -> Alarm | None:
        """Clear the latched alarm once its cause is gone; see `SafetySupervisor.acknowledge`."""
        return self.supervisor.acknowledge(who, seen)

    # -- pause, resume, abort ---------------------------------------------------------------

    def pause(self) -> None:
        """Pause the run at its next point with zero torque."""
        self.engine.pause()

    def resume(self) -> None:
        """Resume a paused run."""
        self.engine.resume()

    @property
    def paused(self) -> bool:
        """Whether a run is paused."""
        return self.engine.held

    def abort(self, reason: str = "") -> None:
        """End the run with zero torque.

        The drives are commanded directly first, so this works even if the event loop is blocked.
        """
        self.supervisor.unload()
        self.drivers.operator.cancel()  # a plan that waits for a person couldn't end
        self.engine.abort(reason)

    def emergency_stop(self, reason: str) -> Alarm:
        """Bring the bench to its safe state and latch an alarm, from any thread.

        This isn't an emergency stop in the sense of machine safety, which needs a hardware button.
        """
        return self.supervisor.trip(
            AlarmKind.STOP, "station", reason, "", "acknowledge it when the cause is removed"
        )

    def _attend(self, on_pause: OnPause | None) -> None:
        """At a pause, ask `on_pause` on the thread that called `run` how to continue."""
        if on_pause is None or not self.engine.held:
            return
        if on_pause(self) == "resume":
            self.resume()
        else:
            self.abort("ended during a pause")

    def _on_interrupt(self) -> None:
        """Pause at the first Ctrl-C if configured so, otherwise abort."""
        if self.interrupt_action == "pause" and not self.engine.pausing:
            self.pause()
        else:
            self.abort("interrupted from the keyboard")

    # -- compensation -----------------------------------------------------------------------

    def activate_compensation(
        self,
        side: Side,
        accepted: Timebase | None = None,
        fitted: CompensationModel | None = None,
    ) -> ActiveChain:
        """Use the registry's active model of a side's transducer and counter for compensation.

        Parameters
        ----------
        side : {"input", "output"}
        accepted : Timebase, optional
            Another counter whose model is accepted, with more uncertainty, if there is none of the
            present counter.
        fitted : CompensationModel, optional
            A model whose table is already compiled; used if it is the active one.

        Raises
        ------
        ModelMismatchError
            There is no active model for this transducer serial and this counter.
        RecordError
            The model's file is missing or was changed.
        """
        description, counter = self.description, self.drivers.counter.clock_identity
        active = self.registry.patiently(
            lambda: compensation_for(self.registry, description, counter, side, accepted, fitted)
        )
        self.acquisition.set_compensation(side, active)
        return active
