"""A journal behind a bounded queue, so that acquisition doesn't wait for the disk in real time."""

from __future__ import annotations

import queue
import threading

from torquebench.bench.acquisition import JournalSink
from torquebench.bench.samples import Stretch
from torquebench.errors import RecordError
from torquebench.message import Message

__all__ = ["WAITING_BLOCKS", "QueuedJournal"]

WAITING_BLOCKS = 200
"""Most blocks that wait for the disk: ten seconds of the usual 50 ms."""
POLL_INTERVAL_S = 0.05


class QueuedJournal:
    """Passes blocks to a journal on a separate thread, in order, without dropping any.

    If the queue is full the writer waits: acquisition stops, which the supervisor treats as a stall
    if it lasts. If the journal fails, the next call raises its error.

    Parameters
    ----------
    journal : JournalSink
    maximum : int
        Blocks that may wait.
    """

    def __init__(self, journal: JournalSink, maximum: int = WAITING_BLOCKS) -> None:
        self._journal = journal
        self._waiting: queue.Queue[Stretch | None] = queue.Queue(maximum)
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="torquebench-journal", daemon=True)
        self._thread.start()

    def write(self, stretch: Stretch) -> None:
        """Keep blocks.

        Raises
        ------
        RecordError
            The journal couldn't keep these blocks or earlier ones.
        """
        self._put(stretch)

    def close(self) -> None:
        """Wait until every block is kept, and end the thread; raises like `write`."""
        if self._thread.is_alive():
            self._put(None)
            self._thread.join()
        self._raise_failure()

    def _put(self, item: Stretch | None) -> None:
        while True:
            self._raise_failure()
            try:
                self._waiting.put(item, timeout=POLL_INTERVAL_S)
            except queue.Full:
                continue
            return

    def _raise_failure(self) -> None:
        if isinstance(self._failure, RecordError):
            raise self._failure  # the error already states a remedy
        if self._failure is not None:
            raise RecordError(
                Message("blocks since the failure aren't kept: {failure}", self._failure),
                "every block kept",
                "make room on the disk or repair it, then repeat the run",
            ) from self._failure

    def _run(self) -> None:
        while (stretch := self._waiting.get()) is not None:
            try:
                self._journal.write(stretch)
            except Exception as error:  # a full disk or a bug: either way nothing is recorded
                self._failure = error
                return
