"""The job runner: one job at a time on the bench, and recordings beside it, each on a thread."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

from torquebench.bench.prompts import PromptQueue
from torquebench.campaign import RunAbortedError
from torquebench.errors import InputError
from torquebench.kernels import release_compiler
from torquebench.message import Message
from torquebench.operations import (
    EndedError,
    Library,
    Operation,
    Place,
    Preview,
    Request,
    Result,
    allows,
    find_operation,
    parameters,
    plain_text,
)
from torquebench.panel.run_in_process import run_in_process
from torquebench.panel.service.access.actors import Actor, require
from torquebench.panel.service.access.lease import CommandLease
from torquebench.panel.service.files import FileStore, KnownNames
from torquebench.panel.service.jobs.job import (
    Job,
    JobPoint,
    JobState,
    JobView,
    PendingPrompt,
    Problem,
)
from torquebench.panel.service.jobs.log import JobLog
from torquebench.panel.service.problems import BusyError, NotFoundError, PermissionDeniedError
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.station import Station
from torquebench.validation import validated

KEPT = 20
ABORT_POLL_S = 0.1
MOST_BESIDE = 4
"""Recordings at a time, beside a job: each occupies a thread and the disk."""
MOST_AT_ONCE = 4
"""Operations on files at a time, beside a job: each occupies a thread and a process."""


class JobRunner:
    """Starts, monitors and ends operations as jobs; safe to use from any thread.

    Parameters
    ----------
    station : Station
    library : Library
        Profiles and reducers.
    lease : CommandLease
    prompts : PromptQueue
    note : callable
        Called with an actor, the action, and details.
    log : JobLog
        Stores the results of jobs for the users who started them.
    files : FileStore
        Files that operations read and write.
    people : callable
        Returns the names of people with an account.
    on_done : callable
        Called with the operation, on the job's thread, after it was performed.
    """

    def __init__(
        self,
        station: Station,
        library: Library,
        lease: CommandLease,
        prompts: PromptQueue,
        note: Callable[..., None],
        log: JobLog,
        files: FileStore,
        people: Callable[[], Iterable[str]],
        on_done: Callable[[Operation], None] = lambda _operation: None,
    ) -> None:
        self._library = library
        self._lease = lease
        self._prompts = prompts
        self._note = note
        self.log = log
        self._files = files
        self._people = people
        self._at_once = threading.BoundedSemaphore(MOST_AT_ONCE)
        self.ended = 0
        """How many jobs have ended since the server was started."""
        self._on_done = on_done
        self._lock = threading.RLock()
        self._rehearsing = threading.Lock()
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._current: Job | None = None
        self._threads: list[threading.Thread] = []
        self._closed = False
        self.move(station)

    def move(self, station: Station) -> None:
        """Use another station for the following jobs."""
        self._station = station
        self._token: int | None = station.engine.run_engine.subscribe(self._document)

    def _place(
        self, actor: Actor | None = None, job: Job | None = None, *, signed: bool = False
    ) -> Place:
        """Return the `Place` of an operation that a person starts."""
        place = Place(
            operator="" if actor is None else actor.label,
            library=self._library,
            registry=self._station.registry,
            station=self._station,
            folder=self._station.registry.root.resolve(),
            compute=partial(run_in_process, folder=self._files.folder),
            people=self._people,
        )
        if actor is not None:
            signature = actor.signed if signed else actor.signature
            place = replace(place, signature=signature, may=partial(allows, actor.role))
        if job is not None:
            reason = partial(getattr, job, "abort_reason")
            compute = partial(place.compute, cancelled=reason, job=True)
            place = replace(place, finishing=job.finishing, cancelled=reason, compute=compute)
        return place

    def _perform(
        self, operation: Operation, place: Place, request: Request, progress: Progress
    ) -> Result:
        """Perform an operation; an operation on files in a process of its own."""
        request = self._files.checked(request, absolute=operation.where != "files")
        if operation.where != "files":
            return self._files.copied(operation.run(place, request, progress))
        known = KnownNames.of(place.library, request)
        result: Result = place.compute(
            perform_on_files, operation.name, request, place.operator, known, progress=progress
        )
        return self._files.named(result)

    # -- starting ---------------------------------------------------------------------------

    def preview(self, kind: str, request: Mapping[str, Any] | Request) -> Preview:
        """Rehearse an operation: steps, duration and limits, without moving anything.

        Raises
        ------
        InputError
            The request is invalid, or the operation moves nothing.
        LimitError, InterlockError
            The bench would refuse the operation.
        BusyError
            A job is under way.
        """
        found = _operation(kind)
        if found.preview is None:
            raise InputError(Message("a preview of {kind}", kind), "what moves the bench")
        asked = _request(found, request)
        with self._rehearsing:  # starting or ending a job doesn't wait for it
            self._refuse_busy()
            doubts = found.doubts(self._place(), asked)
            preview = found.preview(self._place(), asked)
        self._refuse_busy()
        return replace(preview, doubts=doubts, simulated=self._station.description.simulated)

    def perform(
        self,
        actor: Actor,
        kind: str,
        request: Mapping[str, Any] | Request,
        *,
        signed: bool = False,
    ) -> Result:
        """Perform an operation that isn't a job, such as activating a model.

        Raises
        ------
        PermissionDeniedError, LeaseError
            The actor has no permission.
        InputError, RecordError
            The request is invalid.
        """
        found = _operation(kind)
        require(actor, found.role)
        asked = _request(found, request)
        require_person(actor, asked)
        if found.commands:
            self.command(actor)
        place = self._place(actor, signed=signed)
        if found.where == "files":
            if not self._at_once.acquire(blocking=False):
                raise BusyError(
                    Message("{count} operations on files are under way", MOST_AT_ONCE),
                    Message("{count} at a time", MOST_AT_ONCE),
                    "try again in a few seconds",
                )
            try:
                return self._perform(found, place, asked, NO_PROGRESS)
            finally:
                self._at_once.release()
        found.doubts(place, asked)
        result = self._perform(found, place, asked, NO_PROGRESS)
        self._note(actor, found.summary, kind=found.key, request=asked.model_dump(mode="json"))
        self._on_done(found)
        return result

    def perform_and_store(self, actor: Actor, kind: str, request: Request) -> JobView:
        """Perform an operation that isn't a job, and store it with its result as one."""
        job = Job(_operation(kind), request, actor)
        job.end("done", result=self.perform(actor, kind, request))
        view = job.view()
        self.log.began(actor, view, told=True)
        self.log.ended(view)
        self.log.store(view)
        return view

    def start(
        self,
        actor: Actor,
        kind: str,
        request: Mapping[str, Any] | Request,
        *,
        bench_clear: bool = False,
        signed: bool = False,
    ) -> JobView:
        """Start a job, or a recording beside it.

        Parameters
        ----------
        actor : Actor
            Takes the command lease if it is free; a recording doesn't need it.
        kind : str
            Name or key of an operation.
        request : mapping or Request
            Fields of the operation's request.
        bench_clear : bool
            Whether a person has confirmed that a real bench may be loaded.
        signed : bool
            Whether the person has given the password for it.

        Raises
        ------
        PermissionDeniedError, LeaseError
            The actor has no permission.
        InputError
            The request is invalid.
        BusyError
            Another job is under way.
        TorquebenchError
            An alarm is latched.
        """
        found = _operation(kind)
        require(actor, found.role)
        asked = _request(found, request)
        require_person(actor, asked)
        if not found.beside:
            self.command(actor)
        self._refuse(found)
        if found.loads and not bench_clear:
            self.refuse_unconfirmed()
        if found.where != "files":
            found.doubts(self._place(actor, signed=signed), asked)
        with self._lock:
            self._refuse(found)
            if found.moves:
                self._station.supervisor.raise_if_latched()
            job = Job(found, asked, actor, signed=signed)
            view = job.view()
            self._note(
                actor, "started a job", job_id=view.job_id, kind=view.kind, request=view.request
            )
            self.log.began(actor, view)
            if not found.beside:
                self._current = job
            self._keep(job)
            thread = threading.Thread(
                target=self._work, args=(job,), name=f"job {found.name}", daemon=True
            )
            self._threads = [*(each for each in self._threads if each.is_alive()), thread]
            thread.start()
        return job.view()

    def refuse_unconfirmed(self) -> None:
        """Raise an error for a real bench if nobody has confirmed that it is clear."""
        description = self._station.description
        if not description.simulated:
            raise InputError(
                Message(
                    "{name} is a real bench and nobody has confirmed that it is clear",
                    description.name,
                ),
                "bench_clear: true",
                "check that nobody is at the bench, then confirm it",
            )

    def _keep(self, job: Job) -> None:
        self._jobs[job.view().job_id] = job
        ended = [number for number, each in self._jobs.items() if each.ended.is_set()]
        for number in ended[: max(0, len(self._jobs) - KEPT)]:
            del self._jobs[number]

    def command(self, actor: Actor) -> None:
        """Take a free lease for an actor; raise an error if another session has it."""
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
                "wait for it, or abort it",
            )

    def _refuse(self, operation: Operation) -> None:
        """Raise an error while the bench, or for a recording the disk, has enough to do."""
        if not operation.beside:
            self._refuse_busy()
        elif len(self.beside) >= MOST_BESIDE or self._closed:
            raise BusyError(
                Message("{count} recordings are under way", len(self.beside)),
                Message("{count} at a time", MOST_BESIDE),
                "finish one of them",
            )

    # -- working ----------------------------------------------------------------------------

    def _work(self, job: Job) -> None:
        state: JobState = "done"
        result = problem = None
        try:
            place = self._place(job.actor, job, signed=job.signed)
            result = self._perform(job.operation, place, job.request, job)
            self._on_done(job.operation)
        except (RunAbortedError, EndedError) as error:
            state, problem = "aborted", Problem.of(error)
        except Exception as error:  # the panel continues after any error
            state = "aborted" if job.abort_reason else "failed"
            problem = Problem.of(error)
        self._lease.state()  # a program idles from the end of its work
        with self._lock:  # whoever sees the end may start the next job
            job.end(state, problem=problem, result=result)
            if self._current is job:
                self._current = None
        view = job.view()
        self.log.ended(view)
        self.ended += 1
        found = "" if problem is None else problem.found
        self._note(job.actor, "a job ended", job_id=view.job_id, state=state, found=found)
        self.log.store(view)
        release_compiler()

    def _document(self, name: str, document: Mapping[str, Any]) -> None:
        job = self._current
        if job is None:
            return
        if name == "start" and job.view().state == "pausing":  # requested between runs
            self._station.pause()
        job.points(name, document)

    # -- watching ---------------------------------------------------------------------------

    @property
    def current(self) -> JobView | None:
        """The running job, or None."""
        job = self._current
        return None if job is None else self._view(job)

    @property
    def beside(self) -> list[JobView]:
        """The open recordings, the oldest first."""
        with self._lock:
            jobs = [job for job in self._jobs.values() if job.operation.beside]
        return [job.view() for job in jobs if not job.ended.is_set()]

    @property
    def busy(self) -> bool:
        """Whether a job is running on the bench."""
        return self._current is not None

    def get(self, job_id: str) -> JobView:
        """Return a job, also one that ended before the server was started.

        Raises
        ------
        NotFoundError
            No job has this identifier.
        """
        job = self._jobs.get(job_id)
        return self.log.job(job_id) if job is None else self._view(job)

    def wait(self, job_id: str, timeout_s: float) -> JobView:
        """Wait for the end of a job or a timeout, and return the job."""
        self._job(job_id).ended.wait(timeout_s)
        return self.get(job_id)

    def last(self) -> list[JobView]:
        """Return the last twenty jobs, also those before the server's start, the newest first."""
        recent = self.recent()
        known = {each.job_id for each in recent}
        earlier = () if len(recent) >= KEPT else self.log.newest(KEPT)
        stored = [self.log.job(each.job_id) for each in earlier if each.job_id not in known]
        return [*recent, *stored][: max(KEPT, len(recent))]

    def recent(self) -> list[JobView]:
        """Return the last twenty jobs since the server's start, the newest first."""
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
        """Pause a job at its next point, with zero torque.

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
        """Resume a paused job; raises like `pause`."""
        job, view = self._commanded(actor, job_id)
        if not job.change(("pausing",), "running"):
            raise BusyError(Message("{title} isn't paused", view.title), "a paused job")
        self._station.resume()
        self._note(actor, "resumed a job", job_id=job_id)
        return self._view(job)

    def finish(self, actor: Actor, job_id: str) -> JobView:
        """Finish a job without a fixed end, so that it returns its result; raises like `pause`."""
        job, view = self._commanded(actor, job_id)
        if not (view.can_finish or job.finishing.is_set()):
            raise BusyError(Message("{title} can't be finished", view.title), "a recording")
        job.finishing.set()
        self._note(actor, "finished a job", job_id=job_id)
        return self._view(job)

    def abort(self, actor: Actor, job_id: str, reason: str = "") -> JobView:
        """Abort a job with zero torque; raises like `pause`."""
        job, _ = self._commanded(actor, job_id)
        reason = plain_text(reason, 200)
        self._abort(job, reason or Message("aborted by {who}", actor.label))
        self._note(actor, "aborted a job", job_id=job_id, reason=reason)
        return self._view(job)

    def _abort(self, job: Job, reason: str) -> None:
        job.abort_reason = job.abort_reason or reason
        if job.change(("running", "pausing"), "aborting") and not job.operation.beside:
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
            The question isn't open, or no longer.
        """
        self.command(actor)
        if not self._prompts.answer(number, done=done, who=actor.label):
            raise NotFoundError(
                Message("question {number} isn't open", number), "the open question"
            )
        self._note(actor, "answered a prompt", number=number, done=done)

    def _commanded(self, actor: Actor, job_id: str) -> tuple[Job, JobView]:
        job = self._job(job_id)
        if job.operation.beside:
            require(actor, job.operation.role)
        else:
            self.command(actor)
        view = job.view()
        if not view.open:
            raise BusyError(Message("{title} has ended", view.title), "a job under way")
        return job, view

    @contextmanager
    def idle(self) -> Iterator[None]:
        """Prevent jobs from starting until the block ends.

        Raises
        ------
        BusyError
            A job or a recording is under way.
        """
        with self._lock:
            self._refuse_busy()
            for recording in self.beside:
                raise BusyError(
                    Message("{title} is under way", recording.title),
                    "no recording",
                    "finish it, or abort it",
                )
            yield

    def close(self) -> None:
        """Abort all running jobs and wait for their end; refuse further jobs.

        A second call waits until the first one has finished.
        """
        with self._lock:
            self._closed = True
            jobs = [job for job in self._jobs.values() if not job.ended.is_set()]
            token, self._token = self._token, None
        for job in jobs:
            self._abort(job, "the panel is being closed")
        for thread in self._threads:
            thread.join()
        if token is not None:
            self._station.engine.run_engine.unsubscribe(token)


def _operation(kind: str) -> Operation:
    try:
        return find_operation(kind)
    except InputError as unknown:
        raise NotFoundError(unknown.found, unknown.allowed) from None


def perform_on_files(
    name: str, request: Request, operator: str, known: KnownNames, progress: Progress
) -> Result:
    """Check and perform an operation on files, in a process of its own."""
    operation, place = find_operation(name), Place(operator, known)
    operation.doubts(place, request)
    return operation.run(place, request, progress)


def require_person(actor: Actor, request: Request) -> None:
    """Raise an error if a program makes a decision that needs a person."""
    for each in parameters(type(request)):
        chosen = getattr(request, each.name)
        if each.decision and chosen != each.default and actor.kind != "person":
            raise PermissionDeniedError(
                Message("{title} by {name}", each.title, actor.label), "a person's decision"
            )


def _request(found: Operation, request: Mapping[str, Any] | Request) -> Request:
    if isinstance(request, found.request):
        return request
    if isinstance(request, Request):
        raise InputError(
            Message("a request of {name}", type(request).__name__), found.request.__name__
        )
    return validated(found.request, request, found.name)
