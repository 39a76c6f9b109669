"""Publishes the bench at a broker: births, changes, deaths, and the history of unsent data."""

from __future__ import annotations

import contextlib
import itertools
import json
import queue
import random
import sqlite3
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.panel.beside import ServedBench
from torquebench.panel.service import Actor
from torquebench.units import MS_PER_S
from torquebench_sparkplug.history import History
from torquebench_sparkplug.link import (
    Confirmed,
    Down,
    Event,
    Link,
    Opened,
    Received,
    Subscribed,
    tls_context,
)
from torquebench_sparkplug.metrics import (
    DEVICES,
    METRICS,
    NODE,
    REBIRTH,
    MetricSpec,
    Reading,
    Readings,
    read_bench,
)
from torquebench_sparkplug.payload import Metric, decode
from torquebench_sparkplug.session import Message as MqttMessage
from torquebench_sparkplug.session import Session, Topics
from torquebench_sparkplug.settings import Broker, SparkplugSettings

__all__ = ["Publisher"]

FILE = "sparkplug.sqlite"
CHUNK = 100
"""Most records of history that are sent before the broker has confirmed them."""
CLOSING_S = 2.0
REFUSALS_S = 10.0
"""Shortest interval at which refused commands are logged, s."""
ACTOR = Actor("Sparkplug", "operator", "sparkplug", "client")
Record = tuple[str, tuple[Metric, ...]]


@dataclass(frozen=True)
class _Sent:
    """Messages sent before a marker: changes, or the history up to a record's number."""

    marker: int | None
    records: tuple[Record, ...] = ()
    history: int = 0


class Publisher:
    """Publishes a bench as an edge node; only `Node Control/Rebirth` can be written.

    Use `of` for an open bench.

    Parameters
    ----------
    settings : SparkplugSettings
        With `edge_node_id`.
    folder : path
        The data directory, where history is kept.
    read : callable
        Reads the bench; returns None while the bench can't be read.
    note : callable
        Called with a message when a broker is connected or lost, and when a command is refused.

    Raises
    ------
    InputError
        A certificate's file can't be used.
    RecordError
        The buffer's file can't be used.
    """

    def __init__(
        self,
        settings: SparkplugSettings,
        folder: Path,
        read: Callable[[], Readings | None],
        note: Callable[[str], None],
    ) -> None:
        try:
            tls_context(settings)
        except OSError as error:
            raise InputError(
                Message("TLS files: {error}", error),
                "PEM files that can be used, the key without password",
            ) from error
        self.settings = settings
        self._read = read
        self._note = note
        self.topics = Topics(settings.group_id, str(settings.edge_node_id))
        self._brokers = itertools.cycle([Broker(url) for url in settings.brokers])
        self._history = History(folder / FILE, settings.buffer_mb)
        self._events: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        self._ended = threading.Event()
        self._link: Link | None = None
        self._session = Session(self.topics, 0)
        self._told: dict[str, dict[str, Reading]] = {device: {} for device in METRICS}
        self._sent: deque[_Sent] = deque()
        self._flushing = False
        self._pause_s = settings.reconnect_first_s
        self._attempt_at = self._sample_at = time.monotonic()
        self._host_by = float("inf")
        self._host_time: int | None = None
        self._refused = 0
        self._noted_at = float("-inf")
        self._problem = ""
        self._thread = threading.Thread(target=self._run, name="torquebench-sparkplug", daemon=True)

    @classmethod
    def of(
        cls, bench: ServedBench, settings: SparkplugSettings, tell: Callable[[str], None]
    ) -> Self:
        """Return the publisher of an open bench; the panel's log also gets its messages."""

        def note(text: str) -> None:
            tell(text)
            with contextlib.suppress(RecordError):
                bench.note(ACTOR, text)

        named = settings.named(bench.description.name)
        return cls(named, bench.data_dir, lambda: read_bench(bench), note)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._events.put(None)
        self._thread.join()

    # -- its thread -------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                self._turn()
            except (sqlite3.Error, RecordError) as error:
                self._trouble(
                    Message("the buffer {path} fails: {error}", self._history.path, error)
                )
            except Exception as error:  # an error here mustn't stop the bench
                self._trouble(Message("unforeseen {name}: {error}", type(error).__name__, error))
        with contextlib.suppress(sqlite3.Error):
            self._farewell()
            self._history.close()

    def _turn(self) -> None:
        now = time.monotonic()
        due = min(self._sample_at, self._attempt_at if self._link is None else self._host_by)
        with contextlib.suppress(queue.Empty):
            event = self._events.get(timeout=min(max(due - now, 0.0), 1.0))
            if event is not None and event.link is self._link:
                self._handle(event)
        now = time.monotonic()
        if now >= self._sample_at:
            interval_s = self.settings.interval_s
            self._sample_at = max(self._sample_at + interval_s, now + 0.5 * interval_s)
            self._sample()
        if self._link is None and now >= self._attempt_at:
            self._connect()
        elif self._link is not None and now >= self._host_by:
            self._link.close(f"the primary host {self.settings.primary_host} isn't there")
            self._host_by = float("inf")

    def _trouble(self, text: str) -> None:
        if text != self._problem:
            self._note(text)
        self._problem = text
        if self._link is not None:
            self._link.close(text)
        self._ended.wait(0.1)

    # -- the connection ---------------------------------------------------------------------

    def _connect(self) -> None:
        self._session = Session(self.topics, self._history.bdseq)
        topics = [self.topics.of("NCMD"), self.topics.of("DCMD", "+")]
        host = self.settings.primary_host
        topics += [self.topics.state(host)] if host else []
        will = self._session.death(_now())
        self._host_time = None
        self._link = Link(next(self._brokers), self.settings, will, topics, self._events.put)
        self._link.start()

    def _handle(self, event: Event) -> None:
        match event:
            case Opened():
                self._history.connected()
            case Subscribed(link):
                self._problem, self._pause_s = "", self.settings.reconnect_first_s
                host = self.settings.primary_host
                self._note(
                    Message("connected to {url}, waits for {host}", link.broker.url, host)
                    if host
                    else Message("connected to {url}", link.broker.url)
                )
                if host is None:
                    self._birth()
                elif len(self.settings.brokers) > 1:
                    self._host_by = time.monotonic() + self.settings.keep_alive_s
            case Confirmed(marker=marker):
                self._confirm(marker)
            case Received():
                self._take(event)
            case Down(reason=reason):
                self._lost(reason)

    def _lost(self, reason: str) -> None:
        link, self._link = self._link, None
        if link is not None and reason != self._problem:
            self._note(
                Message(
                    "no connection to {url}: {reason}; changes are kept", link.broker.url, reason
                )
            )
        self._problem = reason
        self._keep()
        # random, so that benches that lost the same broker don't reconnect simultaneously
        spread = random.uniform(0.8, 1.2)
        self._attempt_at = time.monotonic() + self._pause_s * spread
        self._pause_s = min(2.0 * self._pause_s, self.settings.reconnect_longest_s)
        self._host_by = float("inf")

    def _keep(self) -> None:
        """Store sent but unconfirmed data as history."""
        self._flushing = False
        records = [record for sent in self._sent for record in sent.records]
        self._sent.clear()
        self._history.keep(records)
        self._session = Session(self.topics, self._session.bdseq)

    def _farewell(self) -> None:
        """Publish the death of the node, and store unconfirmed data."""
        link = self._link
        if link is not None:
            self._leave(link, "ended")
            link.join(CLOSING_S)
        self._keep()

    def _leave(self, link: Link, reason: str) -> None:
        if self._session.born and link.farewell(self._session.death(_now()), CLOSING_S):
            for sent in self._sent:  # confirmed by the acknowledgement of a later message
                self._history.forget(sent.history)
            self._sent.clear()
        link.close(reason)

    # -- commands and the primary host ------------------------------------------------------

    def _take(self, message: Received) -> None:
        host = self.settings.primary_host
        if host is not None and message.topic == self.topics.state(host):
            self._host_says(message.payload)
            return
        if not message.retained:
            self._command(message)

    def _command(self, message: Received) -> None:
        try:
            metrics = decode(message.payload).metrics
        except InputError:
            metrics = ()
        node = message.topic == self.topics.of("NCMD")
        wanted = [each for each in metrics if node and each.name == REBIRTH]
        if any(each.value is True for each in wanted) and self._session.born:
            self._birth()
        if len(wanted) < len(metrics) or not metrics:
            self._refused += 1
            if time.monotonic() - self._noted_at >= REFUSALS_S:
                self._noted_at = time.monotonic()
                names = ", ".join(repr(m.name[:60] or m.alias) for m in metrics[:5]) or "unreadable"
                self._note(
                    Message(
                        "refused a command to {topic}: {names}; nothing on this bench is "
                        "commanded by MQTT",
                        message.topic[:200],
                        names,
                    )
                )

    def _host_says(self, payload: bytes) -> None:
        """Follow the primary host's newest state."""
        try:
            said = json.loads(payload)
            online, moment = said["online"], said["timestamp"]
        except (ValueError, TypeError, KeyError):
            return
        if not isinstance(online, bool) or isinstance(moment, bool) or not isinstance(moment, int):
            return
        if self._host_time is not None and moment < self._host_time:
            return
        self._host_time = moment
        link = self._link
        if link is None:
            return
        if online:
            self._host_by = float("inf")
            if not self._session.born:
                self._birth()
        elif self._session.born:
            self._leave(link, f"the primary host {self.settings.primary_host} is offline")
        elif len(self.settings.brokers) > 1:
            link.close(f"the primary host {self.settings.primary_host} is offline there")

    # -- publishing -------------------------------------------------------------------------

    def _readings(self) -> Readings | None:
        found = self._read()
        if found is None:
            return None
        now = _now()
        counted = {
            "Buffer/Waiting": Reading(self._history.waiting, now),
            "Buffer/Lost": Reading(self._history.lost, now),
            "Commands/Refused": Reading(self._refused, now),
        }
        return replace(found, values={**found.values, NODE: {**found.values[NODE], **counted}})

    def _birth(self) -> None:
        readings = self._readings()
        values: Mapping[str, Mapping[str, Reading]] = self._told
        alive = False
        if readings is not None:
            values, alive = readings.values, readings.alive
        self._publish(self._session.node_birth(values[NODE], _now()))
        self._told[NODE] = dict(values[NODE])
        for device in DEVICES:
            if alive:
                self._device_birth(device, values[device])
        self._flush()

    def _device_birth(self, device: str, values: Mapping[str, Reading]) -> None:
        self._publish(self._session.device_birth(device, values, _now()))
        self._told[device] = dict(values)

    def _sample(self) -> None:
        readings = self._readings()
        if readings is None:
            return
        if not self._session.born:
            self._history.keep(self._changes(readings, kept=True))
            return
        for device in DEVICES:
            if readings.alive and not self._session.alive(device):
                self._device_birth(device, readings.values[device])
            elif not readings.alive and self._session.alive(device):
                self._publish(self._session.device_death(device, _now()))
        records = tuple(self._changes(readings, kept=False))
        for device, metrics in records:
            self._publish(self._session.data(device, metrics, _now()))
        if records:
            self._mark(_Sent(None, records))
        self._flush()

    def _changes(self, readings: Readings, *, kept: bool) -> Iterator[Record]:
        """Yield values that differ from the last published values, and update the latter."""
        for device, specs in METRICS.items():
            if device != NODE and not (readings.alive and (kept or self._session.alive(device))):
                continue
            told, values = self._told[device], readings.values[device]
            stated = values.get("Torque/Range")
            range_nm = stated.value if stated and isinstance(stated.value, float) else 0.0
            found = [
                _metric(spec, values[spec.name], told.get(spec.name))
                for spec in specs
                if spec.name in values
                and not (kept and spec.name.startswith("Buffer/"))
                and self._differs(spec, told.get(spec.name), values[spec.name], range_nm)
            ]
            if found:
                told |= {metric.name: values[metric.name] for metric in found}
                yield device, tuple(sorted(found, key=lambda each: each.timestamp or 0))

    def _differs(
        self, spec: MetricSpec, before: Reading | None, now: Reading, range_nm: float
    ) -> bool:
        if before is None or before.quality is not now.quality:
            return True
        return spec.differs(before.value, now.value, self.settings.deadband, range_nm)

    def _publish(self, message: MqttMessage) -> None:
        if self._link is not None:
            self._link.publish(message)

    # -- acknowledgements -------------------------------------------------------------------

    def _mark(self, sent: _Sent) -> None:
        marker = None if self._link is None else self._link.mark()
        self._sent.append(replace(sent, marker=marker))

    def _confirm(self, marker: int) -> None:
        if all(sent.marker != marker for sent in self._sent):
            return
        while self._sent:
            sent = self._sent.popleft()
            if sent.history:
                self._history.forget(sent.history)
                self._flushing = False
            if sent.marker == marker:
                break
        self._flush()

    def _flush(self) -> None:
        """Send the oldest history, up to the limit of unconfirmed records."""
        if self._flushing or not self._session.born or not self._history.waiting:
            return
        records = self._history.oldest(CHUNK)
        records = [*itertools.takewhile(lambda each: self._session.alive(each.device), records)]
        if not records:  # records of a dead device wait for its next birth
            return
        for device, group in itertools.groupby(records, lambda each: each.device):
            metrics = [replace(m, historical=True) for each in group for m in each.metrics]
            self._publish(self._session.data(device, metrics, _now()))
        self._flushing = True
        self._mark(_Sent(None, (), records[-1].number))


def _metric(spec: MetricSpec, reading: Reading, before: Reading | None) -> Metric:
    """Return a changed value, with its quality if the quality has changed."""
    stated = before is not None and before.quality is reading.quality
    return Metric(
        spec.name,
        None,
        reading.timestamp,
        spec.datatype,
        reading.value,
        properties={} if stated else {"Quality": int(reading.quality)},
    )


def _now() -> int:
    return round(time.time() * MS_PER_S)
