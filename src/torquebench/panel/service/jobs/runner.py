"""The job runner: one job at a time, each on a thread of its own."""

from __future__ import annotations

import secrets
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

from pydantic import BaseModel, ConfigDict

from torquebench.bench.mounting_record import MountingRecord
from torquebench.bench.prompts import PromptQueue
from torquebench.bench.roles import SIDES
from torquebench.campaign.measuring import RunAbortedError, acting_as, mounted_as
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.panel.run_in_process import ProcessEndedError
from torquebench.panel.service.access.actors import Actor, Role, require
from torquebench.panel.service.access.lease import CommandLease
from torquebench.panel.service.fields import plain
from torquebench.panel.service.jobs.job import Job
from torquebench.panel.service.jobs.log import JobLog
from torquebench.panel.service.jobs.values import (
    JobPoint,
    JobPreview,
    JobResult,
    JobState,
    JobView,
    PendingPrompt,
    Problem,
)
from torquebench.panel.service.problems import BusyError, NotFoundError
from torquebench.panel.service.settings.store import SettingsStore
from torquebench.records.signatures import Signature, authenticated
from torquebench.station import Station
from torquebench.validation import validated

__all__ = ["JobContext", "JobKind", "JobRequest", "JobRunner", "MountedRequest", "Workplace"]

KEPT = 20
ABORT_POLL_S = 0.1


class JobRequest(BaseModel):
    """Request of a job; every kind has its own fields."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class MountedRequest(JobRequest):
    """Request of a job with a mounted part.

    `mounting` is the record of the mounting, for the run, the report and the certificate.
    """

    mounting: MountingRecord = MountingRecord()


@dataclass(frozen=True)
class Workplace:
    """Surroundings of a job: the open bench, and the settings with profiles and reducers."""

    station: Station
    settings: SettingsStore


@dataclass(frozen=True)
class JobContext(Workplace):
    """Objects that a job uses.

    Parameters
    ----------
    station : Station
    settings : SettingsStore
    job : Job
        Takes the progress.
    actor : Actor
        Who has started it.
    """

    job: Job
    actor: Actor

    def check(self) -> None:
        """End here where an abort was requested."""
        if self.job.cancelled.is_set():
            raise ProcessEndedError("the job was ended")


@dataclass(frozen=True)
class JobKind:
    """A kind of job.

    Parameters
    ----------
    name, title : str
    request : type
        Pydantic model of its request.
    run : callable
        Does it, on the job's thread.
    preview : callable or None
        Returns its preview; None if it moves nothing.
    check : callable
        Refuses impossible requests before the start; one field, `bench_clear`, the runner checks.
    role : str
        Who may start it.
    moves : bool
        Whether the bench moves: then no alarm may be latched.
    can_pause : bool
    can_finish : bool
        Whether it runs until a user finishes it.
    """

    name: str
    title: Callable[[Any], str]
    request: type[JobRequest]
    run: Callable[[JobContext, Any], JobResult]
    preview: Callable[[Workplace, Any], JobPreview] | None = None
    check: Callable[[Workplace, Any], object] = lambda _place, _request: None
    role: Role = "operator"
    moves: bool = True
    can_pause: bool = True
    can_finish: bool = False

    def job(self, asked: JobRequest, document: Mapping[str, Any], actor: Actor) -> Job:
        """Return a job of this kind."""
        state = JobView(
            job_id=secrets.token_hex(6),
            kind=self.name,
            title=self.title(asked),
            request=document,
            started_by=actor.label,
            started=datetime.now(UTC),
            can_pause=self.can_pause,
            can_finish=self.can_finish,
        )
        return Job(state, actor)


class JobRunner:
    """Starts, watches and ends jobs; safe to use from any thread.

    Parameters
    ----------
    place : Workplace
    lease : CommandLease
    prompts : PromptQueue
    kinds : mapping of str to JobKind
    note : callable
        Called with an actor, the action, and details.
    log : JobLog
        Reports the results of jobs to the users who started them.
    on_done : callable
        Called with its kind, on the job's thread, when one has done its work.
    """

    def __init__(
        self,
        place: Workplace,
        lease: CommandLease,
        prompts: PromptQueue,
        kinds: Mapping[str, JobKind],
        note: Callable[..., None],
        log: JobLog,
        on_done: Callable[[str], None] = lambda _kind: None,
    ) -> None:
        self._place = place
        self._lease = lease
        self._prompts = prompts
        self._note = note
        self.log = log
        self.ended = 0
        """How many jobs have ended since the server was started."""
        self._on_done = on_done
        self._lock = threading.RLock()
        self._rehearsing = threading.Lock()
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._current: Job | None = None
        self._thread: threading.Thread | None = None
        self._closed = False
        self.kinds = kinds
        self._subscribe()

    @property
    def _station(self) -> Station:
        return self._place.station

    def _subscribe(self) -> None:
        self._token: int | None = self._station.engine.run_engine.subscribe(self._document)

    def move(self, place: Workplace) -> None:
        """Work in another place from now on: the bench was opened again."""
        self._place = place
        self._subscribe()

    # -- starting ---------------------------------------------------------------------------

    def preview(self, kind: str, request: Mapping[str, Any] | JobRequest) -> JobPreview:
        """Rehearse a job: steps, duration and limits, without moving anything.

        Raises
        ------
        InputError
            The request is wrong, or this kind moves nothing.
        LimitError, InterlockError
            An operation that the bench would refuse.
        BusyError
            A job is under way.
        """
        job_kind = self._kind(kind)
        if job_kind.preview is None:
            raise InputError(Message("a preview of {kind}", kind), "a job that moves the bench")
        asked = self._request(job_kind, request)
        with self._rehearsing:  # in a separate thread: starting or ending a job doesn't wait for it
            self._refuse_busy()
            shown = job_kind.preview(self._place, asked)
        self._refuse_busy()
        limits = {side: self._station.description.module(side).limits for side in SIDES}
        return replace(
            shown,
            limit_torque_nm={side: limits[side].torque_nm for side in SIDES},
            limit_speed_rpm={side: limits[side].speed_rpm for side in SIDES},
        )

    def start(self, actor: Actor, kind: str, request: Mapping[str, Any] | JobRequest) -> JobView:
        """Start a job.

        Parameters
        ----------
        actor : Actor
            Takes the command lease if it is free.
        kind : str
            One of `kinds`.
        request : mapping or JobRequest
            Fields of the kind's request.

        Raises
        ------
        PermissionDeniedError, LeaseError
            The actor has no permission.
        InputError
            The request is wrong.
        BusyError
            Another job is under way.
        TorquebenchError
            An alarm is latched.
        """
        return self.start_kind(actor, self._kind(kind), request)

    def start_kind(
        self,
        actor: Actor,
        kind: JobKind,
        request: Mapping[str, Any] | JobRequest,
        signature: Signature | None = None,
    ) -> JobView:
        """Start a job of a kind that may not be among `kinds`; raises like `start`.

        `signature` is that of a person who has given the password for it.
        """
        require(actor, kind.role)
        asked = self._request(kind, request)
        self.command(actor)
        self._refuse_busy()
        self._confirm_clear(asked)
        kind.check(self._place, asked)
        with self._lock:
            self._refuse_busy()
            if kind.moves:
                self._station.supervisor.raise_if_latched()
            document = asked.model_dump(mode="json")
            job = kind.job(asked, document, actor)
            job.signature = signature
            view = job.view()
            self._note(actor, "started a job", job_id=view.job_id, kind=view.kind, request=document)
            self.log.began(actor, view)
            self._current = job
            self._keep(job)
            self._thread = threading.Thread(
                target=self._work, args=(kind, job, asked), name=f"job {kind.name}", daemon=True
            )
            self._thread.start()
        return job.view()

    def _confirm_clear(self, request: JobRequest) -> None:
        """Refuse to load a real bench that nobody has confirmed to be clear."""
        description = self._station.description
        if not (getattr(request, "bench_clear", True) or description.simulated):
            raise InputError(
                Message(
                    "{name} is a real bench and nobody has confirmed that it is clear",
                    description.name,
                ),
                "bench_clear: true",
                "check that nobody is at the bench, then confirm it",
            )

    def recall(
        self, actor: Actor, kind: str, request: Mapping[str, Any], result: JobResult
    ) -> JobView:
        """List a job of the records as done, so that its results can be continued.

        Raises
        ------
        BusyError
            A job is under way.
        InputError, NotFoundError
            The request is wrong.
        """
        job_kind = self._kind(kind)
        asked = self._request(job_kind, request)
        with self.idle():
            document = asked.model_dump(mode="json")
            job = job_kind.job(asked, document, actor)
            job.end("done", result=result)
            self._keep(job)
        return job.view()

    def _keep(self, job: Job) -> None:
        self._jobs[job.view().job_id] = job
        while len(self._jobs) > KEPT:
            self._jobs.popitem(last=False)

    def _kind(self, kind: str) -> JobKind:
        if kind not in self.kinds:
            raise NotFoundError(
                Message("no job {name!r}", kind[:40]),
                Message("one of {list}", ", ".join(self.kinds)),
            )
        return self.kinds[kind]

    @staticmethod
    def _request(kind: JobKind, request: Mapping[str, Any] | JobRequest) -> JobRequest:
        if isinstance(request, kind.request):
            return request
        if isinstance(request, JobRequest):
            raise InputError(
                Message("a request of {name}", type(request).__name__), kind.request.__name__
            )
        return validated(kind.request, request, kind.name)

    def command(self, actor: Actor) -> None:
        """Refuse an actor without the lease; a free lease is taken."""
        if self._lease.state().holder is None:
            self._lease.take(actor)
        self._lease.require(actor)

    def _refuse_busy(self) -> None:
        if self._closed:
            raise BusyError("the panel is being closed", "an open panel")
        if self._current is not None:
            raise BusyError(
                Message("{title} is under way", self._current.view().title),
                "one job at a time",
                "wait or abort it",
            )

    # -- working ----------------------------------------------------------------------------

    def _work(self, kind: JobKind, job: Job, request: JobRequest) -> None:
        context = JobContext(self._station, self._place.settings, job, job.actor)
        state: JobState = "done"
        result = problem = None
        try:
            mounting = getattr(request, "mounting", None)
            signature = job.signature or job.actor.signature
            with acting_as(job.actor.label), authenticated(signature), mounted_as(mounting):
                result = kind.run(context, request)
            self._on_done(kind.name)
        except (RunAbortedError, ProcessEndedError) as error:
            state, problem = "aborted", Problem.of(error)
        except Exception as error:  # the panel continues after any error
            state = "aborted" if job.cancelled.is_set() else "failed"
            problem = Problem.of(error)
        with self._lock:  # an observer of the end may start the next job
            job.end(state, problem=problem, result=result)
            self._current = None
        view = job.view()
        self.log.ended(view)
        self.ended += 1
        found = "" if problem is None else problem.found
        self._note(job.actor, "a job ended", job_id=view.job_id, state=state, found=found)

    def _document(self, name: str, document: Mapping[str, Any]) -> None:
        job = self._current
        if job is None:
            return
        if name == "start" and job.view().state == "pausing":  # requested between two runs
            self._station.pause()
        job.points(name, document)

    # -- watching ---------------------------------------------------------------------------

    @property
    def current(self) -> JobView | None:
        """The job under way, or None."""
        job = self._current
        return None if job is None else self._view(job)

    @property
    def busy(self) -> bool:
        """Whether a job is under way."""
        return self._current is not None

    def get(self, job_id: str) -> JobView:
        """Return a job; the last twenty are kept.

        Raises
        ------
        NotFoundError
            There is none with this identifier.
        """
        return self._view(self._job(job_id))

    def recent(self) -> list[JobView]:
        """Return the jobs that are kept, the newest first."""
        with self._lock:
            jobs = list(self._jobs.values())
        return [self._view(job) for job in reversed(jobs)]

    def points(self, job_id: str, since: int = 0) -> list[JobPoint]:
        """Return the points of a job after a number, up to now."""
        return self._job(job_id).points.since(since)

    def _job(self, job_id: str) -> Job:
        job = self._jobs.get(job_id)
        if job is None:
            raise NotFoundError(Message("no job {name!r}", job_id[:40]), "a job of the list")
        return job

    def _view(self, job: Job) -> JobView:
        view = job.view()
        if view.state == "pausing" and self._station.paused:
            return replace(view, state="paused")
        return view

    @property
    def prompt(self) -> PendingPrompt | None:
        """The pending request to the person at the bench, or None."""
        pending = self._prompts.pending
        return None if pending is None else PendingPrompt(pending.number, pending.text)

    # -- commanding -------------------------------------------------------------------------

    def pause(self, actor: Actor, job_id: str) -> JobView:
        """Hold a job at its next point, without torque.

        Raises
        ------
        LeaseError
            Another session commands.
        BusyError
            The job has ended, or can't be paused.
        """
        job, view = self._commanded(actor, job_id)
        if not (view.can_pause and job.change(("running", "pausing"), "pausing")):
            raise BusyError(
                Message("{title} can't be paused now", view.title), "a running job with points"
            )
        self._station.pause()
        self._note(actor, "paused a job", job_id=job_id)
        return self._view(job)

    def resume(self, actor: Actor, job_id: str) -> JobView:
        """Let a paused job go on; raises like `pause`."""
        job, view = self._commanded(actor, job_id)
        if not job.change(("pausing",), "running"):
            raise BusyError(Message("{title} isn't paused", view.title), "a paused job")
        self._station.resume()
        self._note(actor, "resumed a job", job_id=job_id)
        return self._view(job)

    def finish(self, actor: Actor, job_id: str) -> JobView:
        """End a job that continues until then, with its result; raises like `pause`."""
        job, view = self._commanded(actor, job_id)
        if not (view.can_finish or job.finishing.is_set()):
            raise BusyError(Message("{title} can't be finished", view.title), "a recording")
        job.finishing.set()
        self._note(actor, "finished a job", job_id=job_id)
        return self._view(job)

    def abort(self, actor: Actor, job_id: str, reason: str = "") -> JobView:
        """End a job with zero torque; raises like `pause`."""
        job, _ = self._commanded(actor, job_id)
        reason = plain(reason, 200)
        self._abort(job, reason or Message("aborted by {who}", actor.label))
        self._note(actor, "aborted a job", job_id=job_id, reason=reason)
        return self._view(job)

    def _abort(self, job: Job, reason: str) -> None:
        job.cancelled.set()
        if job.change(("running", "pausing"), "aborting"):
            self._station.abort(reason)
            threading.Thread(
                target=self._abort_what_begins, args=(job, reason), name="job abort", daemon=True
            ).start()

    def _abort_what_begins(self, job: Job, reason: str) -> None:
        """Abort a run that began between the request and the job's next check."""
        engine = self._station.engine.run_engine
        while not job.ended.wait(ABORT_POLL_S):
            if str(engine.state) in ("running", "paused"):
                self._station.abort(reason)

    def answer(self, actor: Actor, number: int, *, done: bool) -> None:
        """Answer the request to the person at the bench.

        Raises
        ------
        LeaseError
            Another session commands.
        NotFoundError
            This question doesn't wait (any more).
        """
        self.command(actor)
        if not self._prompts.answer(number, done=done, who=actor.label):
            raise NotFoundError(
                Message("question {number} isn't open", number), "the open question"
            )
        self._note(actor, "answered a prompt", number=number, done=done)

    def _commanded(self, actor: Actor, job_id: str) -> tuple[Job, JobView]:
        job = self._job(job_id)
        self.command(actor)
        view = job.view()
        if not view.open:
            raise BusyError(Message("{title} has ended", view.title), "a job under way")
        return job, view

    @contextmanager
    def idle(self) -> Iterator[None]:
        """Let no job start until the block ends.

        Raises
        ------
        BusyError
            A job is under way.
        """
        with self._lock:
            self._refuse_busy()
            yield

    def close(self) -> None:
        """Abort the running job and wait for its end; refuse further jobs.

        A second call waits for the first one's work.
        """
        with self._lock:
            self._closed = True
            job, thread = self._current, self._thread
            token, self._token = self._token, None
        if job is not None:
            self._abort(job, "the panel is being closed")
        if thread is not None:
            thread.join()
        if token is not None:
            self._station.engine.run_engine.unsubscribe(token)
