"""Record one run: folder, blocks, documents, and its part of the audit log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from torquebench.bench.audit.entries import AuditLog
from torquebench.bench.channels import described_transducer
from torquebench.bench.devices.context import BenchContext
from torquebench.bench.roles import CHANNELS
from torquebench.bench.safety import Alarm, AlarmKind
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records import Registry, RunFolder, RunLock
from torquebench.records.accounts import Accounts
from torquebench.records.runs.folder import ANNOTATION
from torquebench.records.signatures import Signature
from torquebench.station.journal import QueuedJournal, RunJournal
from torquebench.station.registration import run_metadata
from torquebench.station.registry_queue import RegistryQueue

LONGEST_BEFORE_S = 60.0
"""Longest time before a run whose data can be recorded with it, s."""

ExitStatus = Literal["success", "abort", "fail"]
RunEnd = Literal["completed", "aborted", "failed"]


@dataclass(frozen=True)
class RunRecord:
    """Result of a run: its folder and how it ended.

    Parameters
    ----------
    folder : pathlib.Path
        The sealed run folder.
    exit_status : {"success", "abort"}
        How the run ended; a failed run raises an error instead.
    result : object
        Return value of the plan; None if it was aborted.
    reason : str
        Why the run was aborted.
    bench_seconds : float
        Duration of the run in bench time, s.
    interruptions : int
        Number of pauses.
    alarms : tuple of Alarm
        Alarms during the run.
    metadata : mapping
        Metadata at the start.
    """

    run_id: str
    kind: str
    folder: Path
    exit_status: ExitStatus
    result: Any = None
    reason: str = ""
    bench_seconds: float = 0.0
    interruptions: int = 0
    alarms: tuple[Alarm, ...] = ()
    metadata: Mapping[str, Any] = field(default_factory=dict)


class OpenRun:
    """The folder of a run that is being recorded: locked, and entered into the registry.

    Parameters
    ----------
    registry : Registry
        Registry whose chain end is noted in the folder; only the queue writes to it.
    queue : RegistryQueue
        Enters the run into the registry at its start and end.
    runs : pathlib.Path
        Folder of all runs.
    metadata : mapping
        Metadata of the run in addition to the bench's.
    on_end : callable
        Called with it when nothing more is recorded.
    """

    def __init__(
        self,
        context: BenchContext,
        registry: Registry,
        queue: RegistryQueue,
        runs: Path,
        kind: str,
        metadata: Mapping[str, Any],
        on_end: Callable[[OpenRun], None],
    ) -> None:
        self._on_end = on_end
        self._began_s = context.clock.now() - float(metadata.get("before_s", 0.0))
        self._context, self._queue, self.kind = context, queue, kind
        head = str(registry.known_head)  # links the folder to all earlier records
        signature = metadata.get("signature") or Signature.typed()
        self.operator = str(metadata.get("operator", ""))
        if self.operator != signature.who:  # a typed name, not the user who is logged in
            Accounts.of(registry.root).refuse_typed(self.operator, signature)
        self.known: dict[str, Any] = {
            **run_metadata(context),
            "registry_head": head,
            "signature": signature,
            **metadata,
        }
        self.writer = RunFolder.create(runs, self.known, kind=kind)
        try:
            self._hold = RunLock(self.writer.path)
        except BaseException:
            self.writer.discard()
            raise
        queue.enter(self.writer.path)

    def journal(self) -> RunJournal:
        """Return the writer of its samples."""
        described = self._context.description
        readout = self._context.drivers.reference is not None
        signals = {
            name: transducer.scale().column
            for name in CHANNELS
            if (transducer := described_transducer(name, described, "calibrator", readout))
        }
        return RunJournal(
            self.writer, described.temperatures, signals, edges=described.recording.edges
        )

    def annotate(self, annotation: Mapping[str, Any]) -> None:
        """Write an annotation beside the samples, if its time belongs to the run."""
        if annotation["bench_time_s"] >= self._began_s:
            self.writer.document(ANNOTATION, annotation)

    def seal(self, status: RunEnd, reason: str) -> None:
        """Seal the folder and queue it; if that fails, the next start of torquebench seals it."""
        self._on_end(self)
        try:
            self.writer.seal(status, reason)
        except (OSError, InputError) as error:
            what = getattr(error, "strerror", None) or error
            raise RecordError(
                Message("{run} can't be sealed ({error})", self.writer.path, what),
                "space on a working disk",
                "make room on the disk; all measured data are kept, and are sealed at "
                "the next start",
            ) from error
        self._queue.enter(self.writer.path)
        self._queue.settle()

    def release(self) -> None:
        """Unlock the folder. A second call does nothing."""
        self._on_end(self)
        self._hold.release()


class Recording:
    """Records the run of a plan from its first block until its folder is sealed.

    Parameters
    ----------
    run : OpenRun
    context : BenchContext
    audit : AuditLog
    """

    def __init__(self, run: OpenRun, context: BenchContext, audit: AuditLog) -> None:
        self._context, self._audit, self._run = context, audit, run
        self.writer, self.known = run.writer, run.known
        audit.begin_run(self.writer.run_id, run.operator, self.writer.path)
        side = str(self.known.get("side", ""))
        audit.write("run begins", kind=run.kind, side=side)
        journal = run.journal()
        # In fast simulated time acquisition waits for the disk, in real time it doesn't.
        self._queued = None if context.clock.fast else QueuedJournal(journal)
        context.acquisition.set_journal(self._queued or journal)

    def document(self, name: str, document: dict[str, Any]) -> None:
        """Write a document; stop the bench if that fails."""
        try:
            self.writer.document(name, document)
        except Exception as error:
            self._context.supervisor.trip(
                AlarmKind.JOURNAL,
                "documents",
                Message.of(error),
                "every document kept",
                "make room on the disk or repair it, then repeat the run",
            )
            raise

    def end(self, status: RunEnd, reason: str) -> None:
        """End the recording, seal the folder and queue it for the registry.

        Raises
        ------
        RecordError
            Data couldn't be written; the folder is then sealed as failed. If the registry fails, no
            error is raised: the run is entered later.
        """
        self._context.acquisition.set_journal(None)
        try:
            lost = self._flush()
            if lost is not None and status != "failed":
                status, reason = "failed", Message.of(lost)
            else:
                lost = None
            self._audit.write("run ends", status=status, reason=reason)
            self._audit.end_run()
            self._run.seal(status, reason)
            if lost is not None:
                raise lost
        finally:
            self._audit.end_run()
            self._run.release()

    def _flush(self) -> RecordError | None:
        """Wait until every block is written; if that fails, stop the bench and return the error."""
        queued, self._queued = self._queued, None
        try:
            if queued is not None:
                queued.close()
        except RecordError as error:
            self._context.supervisor.trip(
                AlarmKind.JOURNAL, "journal", error.found, error.allowed, error.remedy
            )
            return error
        return None

    def end_failed(self, end: Callable[[RunEnd, str], None], error: BaseException) -> None:
        """End a failed run; if its folder can't be sealed, add that as a note to the error."""
        try:
            end("failed", Message.of(error) or "the program was interrupted")
        except (RecordError, OSError) as unsealed:
            error.add_note(f"{self.writer.path} stays open to be recovered: {unsealed}")
