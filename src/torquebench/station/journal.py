"""Write every acquired block to the raw stream of a run's folder."""

from __future__ import annotations

import queue
import threading
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.acquisition import JournalSink
from torquebench.bench.blocks import CONDITIONS, Block
from torquebench.bench.roles import CHANNELS, SIDES, torque_channel
from torquebench.chain import Torque
from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records import RunWriter
from torquebench.signals import Record

NOT_IN_USE = 255
"""Fault code of a channel that isn't measured."""
NO_COUNTS = int(np.iinfo(np.int64).min)
"""Counts of an encoder without samples."""


class RunJournal:
    """Writes one row per counter window, and every edge if the bench is configured so.

    A row contains the time; for each channel its signal, torque and fault; for each side angle,
    mean speed over the block, compensated torque and its standard uncertainty; and the probes'
    temperatures. Signals are as measured; torque is corrected for the present zero, and for a
    standard also by its certificate. Values are NaN where `fault` isn't 0, and compensated torque
    without a compensation. A channel that isn't in use has the code `NOT_IN_USE`, an encoder
    without samples `NO_COUNTS` and a probe that doesn't answer NaN, so that the loss of one signal
    doesn't end the recording of the others.

    Parameters
    ----------
    probes : sequence of str
        Temperature probes in the bench description.
    signals : mapping of channel to str
        Column of each channel's signal; by default its frequency.
    edges : bool
        Whether to write the edges.
    """

    def __init__(
        self,
        writer: RunWriter,
        probes: Sequence[str],
        signals: Mapping[str, str] | None = None,
        *,
        edges: bool = False,
    ) -> None:
        self._writer = writer
        self._probes = tuple(probes)
        self._signals = dict.fromkeys(CHANNELS, "frequency_hz") | dict(signals or {})
        self._edges = edges

    def write(self, block: Block) -> None:
        """Write a block; raises `RecordError` if that fails."""
        if self._edges:
            self._writer.edges(block.edges)
        axis = torque_channel("input")
        first = block.records.get(axis)
        if first is None or not len(first):
            return
        time_s, conditions = first.time_s, block.records[CONDITIONS]
        # speed and temperature are those at the end of the window's block
        row = conditions.time_s.searchsorted(time_s).clip(max=len(conditions) - 1)
        columns: dict[str, NDArray[np.generic]] = {"time_s": time_s}
        for name in CHANNELS:
            column = self._signals[name]
            signal, torque, fault = _on_axis(time_s, block.records.get(name), column)
            columns[f"{name}_{column.removeprefix('frequency_')}"] = signal
            columns[f"{name}_nm"] = torque
            columns[f"{name}_fault"] = fault
        for side in SIDES:
            columns[f"{side}_angle_counts"] = _counts(time_s, block.angle(side))
            columns[f"{side}_speed_rad_s"] = conditions[f"{side}_speed_rad_s"][row]
            torque, uncertainty = _compensated(time_s, block.torque(side), block.torques.get(side))
            columns[f"{side}_compensated_nm"] = torque
            columns[f"{side}_torque_uncertainty_nm"] = uncertainty
        for probe in self._probes:
            columns[f"{probe}_c"] = conditions[f"{probe}_c"][row]
        self._writer.samples(columns)


def _counts(time_s: NDArray[np.float64], angle: Record | None) -> NDArray[np.int64]:
    """Return an encoder's counts at the windows of a channel."""
    if angle is None or not len(angle):
        return np.full(time_s.shape, NO_COUNTS, dtype=np.int64)
    place = np.searchsorted(angle.time_s, time_s).clip(max=len(angle) - 1)
    return np.asarray(angle["angle_counts"][place])


def _compensated(
    time_s: NDArray[np.float64], own: Record | None, compensated: Torque | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return compensated torque and its standard uncertainty at the windows of another channel."""
    torque = np.full(time_s.shape, np.nan)
    uncertainty = np.full(time_s.shape, np.nan)
    if own is not None and compensated is not None:
        there, here = _places(time_s, own.time_s)
        torque[there] = compensated.value_nm[here]
        uncertainty[there] = compensated.standard_uncertainty_nm[here]
    return torque, uncertainty


def _on_axis(
    time_s: NDArray[np.float64], record: Record | None, column: str
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint8]]:
    """Return signal, torque and fault of a channel at the windows of another channel."""
    if record is not None and column in record and np.array_equal(record.time_s, time_s):
        return record[column], record["reading_nm"], record["fault"]
    signal = np.full(time_s.shape, np.nan)
    torque = np.full(time_s.shape, np.nan)
    fault = np.full(time_s.shape, NOT_IN_USE, dtype=np.uint8)
    if record is not None:
        there, here = _places(time_s, record.time_s)
        if column in record:
            signal[there] = record[column][here]
        torque[there] = record["reading_nm"][here]
        fault[there] = record["fault"][here]
    return signal, torque, fault


def _places(
    axis_s: NDArray[np.float64], time_s: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the positions of equal times on an axis and in an array."""
    place = np.searchsorted(axis_s, time_s - 1e-6).clip(max=axis_s.size - 1)
    here = np.flatnonzero(np.abs(axis_s[place] - time_s) < 1e-6)
    return place[here], here


WAITING_BLOCKS = 200
"""Largest number of blocks that wait for the disk: ten seconds with the usual 50 ms."""
POLL_INTERVAL_S = 0.05


class QueuedJournal:
    """Passes all blocks to a journal in order, on a separate thread.

    If the queue is full, the writer waits, and acquisition stops, which the supervisor treats as a
    stall after a while. If the journal fails, the next call raises its error.

    Parameters
    ----------
    maximum : int
        Largest number of waiting blocks.
    """

    def __init__(self, journal: JournalSink, maximum: int = WAITING_BLOCKS) -> None:
        self._journal = journal
        self._waiting: queue.Queue[Block | None] = queue.Queue(maximum)
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="torquebench-journal", daemon=True)
        self._thread.start()

    def write(self, block: Block) -> None:
        """Queue a block to be written.

        Raises
        ------
        RecordError
            The journal couldn't write earlier blocks.
        """
        self._put(block)

    def close(self) -> None:
        """Wait until every block is written, and end the thread; raises like `write`."""
        if self._thread.is_alive():
            self._put(None)
            self._thread.join()
        self._raise_failure()

    def _put(self, item: Block | None) -> None:
        while True:
            self._raise_failure()
            try:
                self._waiting.put(item, timeout=POLL_INTERVAL_S)
            except queue.Full:
                continue
            return

    def _raise_failure(self) -> None:
        if isinstance(self._failure, RecordError):
            raise self._failure  # this error already states a remedy
        if self._failure is not None:
            raise RecordError(
                Message("blocks since the failure weren't recorded: {failure}", self._failure),
                "every block kept",
                "make room on the disk or repair it, then repeat the run",
            ) from self._failure

    def _run(self) -> None:
        while (block := self._waiting.get()) is not None:
            try:
                self._journal.write(block)
            except Exception as error:  # a full disk or a bug: nothing more is recorded
                self._failure = error
                return
