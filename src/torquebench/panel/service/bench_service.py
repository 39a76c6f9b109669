"""The service that owns the open bench of a server; pages and HTTP clients use only this."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

from torquebench.atomic_write import private_folder
from torquebench.bench.description import BenchDescription, default_bench, load_bench
from torquebench.bench.prompts import PromptQueue, QueuedOperator
from torquebench.bench.roles import SIDES, Side
from torquebench.bench.safety import AlarmKind
from torquebench.bench.safety.priority import prefer_this_thread
from torquebench.chain import EffectState
from torquebench.errors import (
    InputError,
    InterlockError,
    ModelMismatchError,
    RecordError,
    TorquebenchError,
)
from torquebench.message import Message
from torquebench.operations import (
    Operation,
    Request,
    Result,
    Role,
    allows,
    find_operation,
    plain_text,
)
from torquebench.panel.service.access.actors import Actor, require
from torquebench.panel.service.access.clients import Clients
from torquebench.panel.service.access.lease import CommandLease
from torquebench.panel.service.access.people import People
from torquebench.panel.service.files import FileStore
from torquebench.panel.service.jobs.job import JobView
from torquebench.panel.service.jobs.log import JobLog
from torquebench.panel.service.jobs.queue import JobQueue
from torquebench.panel.service.jobs.runner import JobRunner
from torquebench.panel.service.live.alarms import AlarmView, StopReport, alarm_view
from torquebench.panel.service.live.hub import STALE_AFTER_S, Connection, LiveHub
from torquebench.panel.service.live.layout import LiveLayout
from torquebench.panel.service.live.markers import Marker, Markers
from torquebench.panel.service.live.snapshot import (
    BenchSnapshot,
    CompensationState,
    compensation_state,
    side_snapshots,
)
from torquebench.panel.service.problems import NotSignedInError
from torquebench.panel.service.records.queries import RecordQueries
from torquebench.panel.service.records.views import UnfinishedView
from torquebench.panel.service.settings.store import SettingsStore
from torquebench.panel.service.store import Event, PanelStore
from torquebench.reports.certificate import (
    DEFAULT_TOLERANCE_PERCENT_FS,
    Issue,
    build_record,
    certificate_pages,
    kept_letterhead,
)
from torquebench.station import LONGEST_BEFORE_S, Station, data_directory

LIVE_BLOCK_S = 0.03
"""Longest block for a live display, which gives thirty-three updates per second, s."""
IDLE_PERIOD_S = 0.05


class BenchService:
    """An open bench with all functions of the panel.

    Use `open`; the package's docstring lists the parts.

    Attributes
    ----------
    station : Station
        The open bench, only for the parts of the service; interfaces must not use it.
    live : LiveHub
    people : People
    clients : Clients
    lease : CommandLease
    jobs : JobRunner
    queue : JobQueue
    records : RecordQueries
    settings : SettingsStore
    files : FileStore
    """

    def __init__(
        self, base: BenchDescription, data_dir: Path, store: PanelStore, *, fast: bool
    ) -> None:
        self._closed = threading.Event()
        self._later = ThreadPoolExecutor(1, "torquebench-panel-log")
        self._later.submit(int)  # so that an entry needs no new thread
        self._stoppers = ThreadPoolExecutor(2, "torquebench-stop", prefer_this_thread)
        self._stoppers.submit(int)  # so that the first stop needs no new thread
        self._unloading: threading.Thread | None = None
        self._log_fails = False
        self._store = store
        self._fast = fast
        self._data_dir = data_dir
        self._prompts = PromptQueue()
        self._compensation: dict[Side, tuple[CompensationState | None, str]] = {}
        self.settings = SettingsStore(store, base)
        self.people = People(store, later=self._later.submit)
        self.clients = Clients(store)
        self.files = FileStore()
        self.lease = CommandLease(self.note, self._lives, lambda: self.jobs.busy)
        self.station = self._open_station()
        self._watch()
        self.jobs = JobRunner(
            self.station,
            self.settings,
            self.lease,
            self._prompts,
            self.note,
            JobLog(store),
            self.files,
            self.people.names,
            on_done=self._done,
        )
        self.queue = JobQueue(self.jobs, store, self.note)
        self._idle = threading.Thread(target=self._keep_time, name="torquebench-idle", daemon=True)
        if fast:
            self._idle.start()

    @classmethod
    def open(
        cls,
        description: BenchDescription | Path | None = None,
        data_dir: Path | None = None,
        *,
        fast: bool = False,
    ) -> Self:
        """Open the bench and the service's other parts.

        Parameters
        ----------
        description : BenchDescription, path or None
            None opens the packaged simulated bench.
        data_dir : path, optional
            Default: `$TORQUEBENCH_DATA`, else `./torquebench-data`.
        fast : bool
            Whether a simulated bench runs procedures as fast as possible, and otherwise in real
            time; for tests and demonstrations.

        Raises
        ------
        InputError
            The description is invalid, or contradicts the panel's changes.
        BenchError
            An instrument doesn't answer.
        RecordError
            The data directory can't be written.
        """
        if description is None:
            description = default_bench()
        elif not isinstance(description, BenchDescription):
            description = load_bench(description)
        folder = data_directory(data_dir)
        try:
            private_folder(folder)
        except OSError as error:
            raise RecordError(
                Message(
                    "can't create the data directory {folder}: {strerror}", folder, error.strerror
                ),
                "a folder with write permission",
                "choose another with --data",
            ) from error
        store = PanelStore(folder)
        try:
            return cls(description, folder, store, fast=fast)
        except BaseException:
            store.close()
            raise

    def _open_station(self) -> Station:
        description = self.settings.bench()
        operator = None if description.simulated else QueuedOperator(self._prompts)
        station = Station.open(
            _live_paced(description), self._data_dir, real_time=not self._fast, operator=operator
        )
        self._opened = description
        return station

    def _watch(self) -> None:
        """Connect the service's parts to the newly opened station."""
        station = self.station
        try:
            self.records = RecordQueries(station.registry)
            self._viewer = station.acquisition.add_viewer(maximum=400)
            station.acquisition.remember(LONGEST_BEFORE_S)
            self.live = LiveHub(
                station.description, station.clock, self._viewer, station.drivers.operator.mounted
            )
            self.markers = Markers()
            for side in SIDES:
                self.refresh_compensation(side)
        except BaseException:
            station.close()
            raise
        self.live.start()

    @property
    def description(self) -> BenchDescription:
        """Description of the open bench."""
        return self.station.description

    @property
    def data_dir(self) -> Path:
        """Data directory."""
        return self._data_dir

    @property
    def reopen_needed(self) -> bool:
        """Whether the bench must be reopened to apply changed settings."""
        try:
            return self.settings.bench() != self._opened
        except InputError:
            return True

    def reopen(self, actor: Actor) -> None:
        """Close the bench and open it again with the present settings.

        Raises
        ------
        PermissionDeniedError, LeaseError
            The actor isn't an administrator with the lease.
        BusyError
            A job is under way.
        BenchError, InputError
            The bench can't be opened, and stays closed until the next attempt.
        """
        require(actor, "administrator")
        self.jobs.command(actor)
        with self.jobs.idle():
            self.note(actor, "opens the bench again")
            self.live.close()
            self.station.close()
            self.station = self._open_station()
            self._watch()
            self.jobs.move(self.station)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def ending(self) -> bool:
        """Whether the bench is being unloaded, or is closed."""
        return self._unloading is not None or self._closed.is_set()

    def unload_aside(self) -> None:
        """Begin the shutdown on another thread: abort the running job, and start no other."""
        if self._unloading is None:
            self._unloading = threading.Thread(target=self.jobs.close, name="torquebench-unload")
            self._unloading.start()

    def close(self) -> None:
        """Bring the bench to zero torque and close everything. A second call does nothing."""
        if self._closed.is_set():
            return
        self._closed.set()
        if self._unloading is not None:
            self._unloading.join()
        self.jobs.close()
        self.queue.close()
        if self._idle.is_alive():
            self._idle.join()
        self.live.close()
        with contextlib.ExitStack() as closing:  # close the other parts even if a drive isn't off
            closing.callback(self._store.close)
            closing.callback(self.files.close)
            closing.callback(self.people.close)
            closing.callback(self._later.shutdown)
            closing.callback(self._stoppers.shutdown)
            closing.callback(self.station.close)

    def _keep_time(self) -> None:
        """Advance a fast bench in real time while no procedure runs."""
        while not self._closed.wait(IDLE_PERIOD_S):
            clock = self.station.clock
            clock.require(clock.now() + IDLE_PERIOD_S)

    # -- reading ----------------------------------------------------------------------------

    @property
    def connection(self) -> tuple[Connection, str]:
        """Whether samples arrive, and the reason if not."""
        age_s = self.live.age_s
        if age_s <= STALE_AFTER_S:
            return "live", ""
        ended = not self.station.acquisition.running
        alarm = self.station.supervisor.alarm
        said = (
            "acquisition has ended" if ended else Message("no samples for {seconds:.1f} s", age_s)
        )
        if alarm is not None:
            said = Message("{found}: {reason}", said, alarm.found)
        return "lost" if ended else "stale", said

    def snapshot(self) -> BenchSnapshot:
        """Return the present state of the bench; fast enough for every repaint of every page."""
        station = self.station
        connection, problem = self.connection
        job = self.jobs.current
        return BenchSnapshot(
            bench_name=station.description.name,
            simulated=station.description.simulated,
            connection=connection,
            connection_problem=problem,
            bench_time_s=self.live.bench_time_s,
            age_s=self.live.age_s,
            sequence=self.live.sequence,
            mounted=station.drivers.operator.mounted(),
            sides=side_snapshots(station, self.live, self._compensation),
            efficiency=self.live.latest()["efficiency_percent"],
            alarms=len(station.supervisor.alarms),
            stopped=station.supervisor.alarm is not None,
            job_id=None if job is None else job.job_id,
            paused=job is not None and job.state == "paused",
            commanded_by=self.lease.state().holder,
        )

    def refresh_compensation(self, side: Side) -> None:
        """Compensate a side by its active model in the registry, if there is one."""
        station = self.station
        try:
            active = station.activate_compensation(side)
        except (InputError, ModelMismatchError, RecordError) as error:
            station.acquisition.set_compensation(side, None)
            self._compensation[side] = (None, error.found)
            return
        today = datetime.now(UTC).date()
        state = compensation_state(station.registry, int(active.model_id), today)
        self._compensation[side] = (state, "")

    def wait_for_live(self) -> None:
        """Wait briefly for live values of a block that began after this call."""
        station = self.station
        self.live.wait_beyond(station.clock.now() + 1.5 * station.description.counter.block_s)

    def layout(self, actor: Actor) -> LiveLayout:
        """Return a person's layout of the live page."""
        try:
            kept = self._store.preference(actor.name, "live")
            return LiveLayout.model_validate(kept) if kept is not None else LiveLayout()
        except ValidationError:  # another version with other signals stored it
            return LiveLayout()

    def keep_layout(self, actor: Actor, layout: LiveLayout) -> None:
        """Store a person's layout of the live page."""
        self._store.keep_preference(actor.name, "live", layout.model_dump(mode="json"))

    # -- actions ----------------------------------------------------------------------------

    def mark(self, actor: Actor, note: str, bench_time_s: float | None = None) -> Marker:
        """Add a marker with a note at the present or an earlier bench time.

        The runs that are being recorded keep it as an annotation.

        Raises
        ------
        PermissionDeniedError
            The actor isn't an operator.
        InputError
            The note is empty or too long, or the time isn't in the past of this bench.
        RecordError
            A run that is being recorded can't keep it.
        """
        require(actor, "operator")
        newest_s = self.live.bench_time_s
        moment_s = newest_s if bench_time_s is None else bench_time_s
        if not 0.0 <= moment_s <= newest_s:
            raise InputError(
                Message("a marker at {time:g} s", moment_s),
                Message("0 to {newest:.1f} s of bench time", newest_s),
            )
        at = datetime.fromtimestamp(moment_s + self.live.clock_offset_s, UTC)
        marker = self.markers.add(moment_s, at, note, actor.label)
        self.station.annotate(
            {
                "time": at.timestamp(),
                "bench_time_s": moment_s,
                "note": marker.note,
                "who": marker.who,
            }
        )
        self.note(actor, "put a marker", note=marker.note, bench_time_s=round(moment_s, 3))
        return marker

    def note(self, actor: Actor, what: str, **details: Any) -> None:
        """Enter a person's action into the panel's log and the bench's audit log.

        If the log can't be written, the action continues, but an alarm is raised.
        """
        try:
            self._store.note(actor.label, what, **details)
            self._log_fails = False
        except RecordError as error:
            told, self._log_fails = self._log_fails, True
            if not told:
                self.station.supervisor.warn(
                    AlarmKind.AUDIT, "panel log", error.found, error.allowed, error.remedy
                )
        self.station.audit.write(f"panel: {what}", who=actor.label, **details)

    def log(self, limit: int = 100, before: int | None = None) -> list[Event]:
        """Return the log of actions, the newest first; `before` is an event's number."""
        return self._store.events(min(max(limit, 1), 1000), before)

    def laboratory_people(self) -> tuple[str, ...]:
        """Return the laboratory's people: those with an account, and those named in its file.

        Raises
        ------
        InputError
            The laboratory's file is invalid.
        """
        named = kept_letterhead(self.station.registry.root).people
        return tuple(dict.fromkeys((*self.people.names(), *named)))

    def identify(self, name: str, secret: str, address: str) -> Actor:
        """Return a person by name and password, or a client by its name and token.

        Raises
        ------
        NotSignedInError, SignInError, LockedOutError
            Name and secret are neither a person's nor a client's.
        """
        client = self.clients.find(secret)
        if client is None:
            return self.people.identify(name, secret, address)
        if client.name != name:
            raise NotSignedInError("a token of another client", "its own name")
        return client

    def present(self, actor: Actor, role: Role | None = None) -> Actor | None:
        """Return an actor with its present role; None if it no longer has access or this role."""
        if actor.kind == "client":
            found = actor if self.clients.lives(actor.session_id) else None
        else:
            try:
                user = self.people.user(actor.name)
            except TorquebenchError:
                return None
            found = Actor(user.name, user.role, actor.session_id) if user.active else None
        return found if found is None or role is None or allows(found.role, role) else None

    def _lives(self, actor: Actor) -> bool:
        if actor.kind == "person":
            return self.people.signed_in(actor.session_id)
        return self.present(actor) is not None

    def _done(self, done: Operation) -> None:
        """After an operation that may have changed them, use the registry's active models."""
        if done.activates:
            for side in SIDES:
                self.refresh_compensation(side)

    def start(
        self,
        actor: Actor,
        kind: str,
        request: Mapping[str, Any] | Request,
        *,
        bench_clear: bool = False,
        password: str = "",
    ) -> JobView:
        """Start an operation as a job; an operation that needs a signature needs the password.

        Raises
        ------
        SignInError, LockedOutError
            The password is wrong.
        TorquebenchError
            As in `JobRunner.start`.
        """
        signed = self._confirm_signature(actor, kind, password)
        return self.jobs.start(actor, kind, request, bench_clear=bench_clear, signed=signed)

    def perform(
        self, actor: Actor, kind: str, request: Mapping[str, Any] | Request, *, password: str = ""
    ) -> Result:
        """Perform an operation that isn't a job; raises like `start` and `JobRunner.perform`."""
        signed = self._confirm_signature(actor, kind, password)
        return self.jobs.perform(actor, kind, request, signed=signed)

    def _confirm_signature(self, actor: Actor, kind: str, password: str) -> bool:
        """Check the password, which a signature requires; return whether it was given."""
        found = find_operation(kind)
        if found.signed or password:
            require(actor, found.role)
            self.people.confirm_password(actor, password)
        return found.signed or bool(password)

    def effects(self, side: Side) -> tuple[EffectState, ...]:
        """Return the state of every effect of a side's measuring chain at the newest window.

        Empty if the side isn't compensated.
        """
        active = self.station.acquisition.compensation(side)
        return () if active is None else active.states()

    def switch_off(self, actor: Actor, side: Side, off: Sequence[str], reason: str = "") -> None:
        """Switch off some corrections of a side until the bench is closed; all others are applied.

        Raises
        ------
        PermissionDeniedError, LeaseError
            The actor isn't a metrologist with the lease.
        ModelMismatchError
            The side isn't compensated.
        InputError
            A correction doesn't exist.
        BusyError
            A job is under way.
        """
        require(actor, "metrologist")
        self.jobs.command(actor)
        self.station.acquisition.switch_off(side, off)
        self.note(
            actor, "switched corrections", side=side, off=", ".join(off) or "none", reason=reason
        )

    def unfinished(self) -> list[UnfinishedView]:
        """Return unfinished runs, the oldest first."""
        if self.jobs.busy or self.jobs.beside:  # the running job would be listed, too
            return []
        return self.records.unfinished()

    def certificate_preview(
        self,
        calibration_id: int,
        *,
        model_id: int | None = None,
        languages: Sequence[str] = ("en",),
        tolerance_percent_fs: float = DEFAULT_TOLERANCE_PERCENT_FS,
    ) -> list[bytes]:
        """Return the pages of a certificate's draft as pictures, without storing them.

        Parameters
        ----------
        calibration_id : int
        model_id : int, optional
            The model to be activated; by default the active one, or the latest.
        languages : sequence of str
            Languages; the first one is drawn.
        tolerance_percent_fs : float

        Raises
        ------
        RecordError, InputError
            The calibration doesn't exist, was changed, or gets no certificate.
        """
        registry = self.station.registry
        laboratory, customer = kept_letterhead(registry.root).parties
        issue = Issue(
            (),
            laboratory=laboratory,
            customer=customer,
            languages=languages,
            tolerance_percent_fs=tolerance_percent_fs,
            draft=True,
            model_id=model_id,
        )
        record = build_record(registry, registry.calibration(calibration_id), issue)
        return certificate_pages(record, next(iter(languages), "en"))

    # -- alarms and stop --------------------------------------------------------------------

    def alarms(self, *, active: bool = False) -> list[AlarmView]:
        """Return alarms and warnings since the bench was opened, the newest first.

        Parameters
        ----------
        active : bool
            Whether to return only active ones, the most severe first.
        """
        supervisor = self.station.supervisor
        if active:
            return [alarm_view(entry) for entry in supervisor.alarms]
        return [alarm_view(entry) for entry in reversed(supervisor.entries)]

    def acknowledge(
        self, actor: Actor, alarm_ids: Collection[str] | None = None
    ) -> AlarmView | None:
        """Acknowledge the latched alarm after its cause is removed; return it.

        Parameters
        ----------
        actor : Actor
        alarm_ids : collection of str, optional
            Identifiers of the alarms that the person has seen; by default all active ones.

        Raises
        ------
        InterlockError
            The bench isn't in its safe state yet, or the person hasn't seen a critical alarm.
        """
        if self.jobs.busy:
            raise InterlockError(
                "acknowledgement while a job ends", "an ended job", "wait a moment"
            )
        seen = None
        if alarm_ids is not None:
            seen = {each.number for each in self.alarms() if each.alarm_id in alarm_ids}
        cleared = self.station.acknowledge_alarm(actor.label, seen)
        if cleared is None:
            return None
        self.note(actor, "acknowledged an alarm", number=cleared.number, found=cleared.found)
        entries = self.station.supervisor.entries
        return next(alarm_view(entry) for entry in entries if entry.alarm.number == cleared.number)

    @property
    def presence_wanted(self) -> bool:
        """Whether the bench requires confirmed presence while a drive has power."""
        return bool(self.station.description.safety.presence_s)

    @property
    def presence_left_s(self) -> float:
        """Remaining time of the last confirmation, s; 0 without one."""
        return self.station.supervisor.heartbeats.present_s()

    def confirm_presence(self, actor: Actor) -> None:
        """Confirm the operator's presence at the bench; see `[safety] presence_s`.

        Raises
        ------
        LeaseError
            Another session has the command lease.
        """
        self.jobs.command(actor)
        self.station.supervisor.heartbeats.confirm_presence(actor.label)

    def stop(self, actor: Actor, reason: str = "") -> StopReport:
        """Bring the bench to its safe state at once; any signed-in user may do this without lease.

        This isn't an emergency stop in the sense of machine safety, which needs a hardware button.
        """
        started = time.perf_counter()
        said = plain_text(reason, 200) or "stop button"
        alarm = self.station.emergency_stop(Message("{reason}, by {who}", said, actor.label))
        seconds = time.perf_counter() - started
        # The alarm is in the audit log already, so the caller needn't wait for the disk.
        self._later.submit(
            self.note, actor, "stopped the bench", reason=said, seconds=round(seconds, 4)
        )
        return StopReport(alarm.number, seconds)

    def stop_aside(self, actor: Actor, reason: str = "") -> Future[StopReport]:
        """Call `stop` on a dedicated thread, for callers that must not block."""
        return self._stoppers.submit(self.stop, actor, reason)


def _live_paced(description: BenchDescription) -> BenchDescription:
    """Shorten the counter's blocks for a smooth live display."""
    counter = description.counter
    if counter.block_s <= LIVE_BLOCK_S:
        return description
    return description.model_copy(update={"counter": counter.with_blocks(LIVE_BLOCK_S)})
