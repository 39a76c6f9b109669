"""One session of an edge node: topics, births, data and deaths, numbered by the standard."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from torquebench_sparkplug.metrics import (
    BDSEQ,
    METRICS,
    NODE,
    REBIRTH,
    MetricSpec,
    Reading,
)
from torquebench_sparkplug.payload import DataType, Metric, Payload, Quality, encode

__all__ = ["Message", "Session", "Topics", "numbered"]

NUMBERS = 256
"""bdSeq and seq restart at 0 after 255."""


@dataclass(frozen=True)
class Topics:
    """Topics of one edge node.

    Examples
    --------
    >>> Topics("Hall 3", "Bench 7").of("DDATA", "input")
    'spBv1.0/Hall 3/DDATA/Bench 7/input'
    """

    group_id: str
    edge_node_id: str

    def of(self, kind: str, device: str = NODE) -> str:
        """Return the topic of a kind of message, such as "NBIRTH"."""
        own = f"spBv1.0/{self.group_id}/{kind}/{self.edge_node_id}"
        return f"{own}/{device}" if device else own

    @staticmethod
    def state(host_id: str) -> str:
        """Return the topic of a host application's online state."""
        return f"spBv1.0/STATE/{host_id}"


@dataclass(frozen=True)
class Message:
    """A message to publish: QoS 0, never retained; a will has QoS 1."""

    topic: str
    payload: bytes
    qos: int = 0


def numbered(
    metrics: Mapping[str, Sequence[MetricSpec]],
) -> dict[tuple[str, str], tuple[int, MetricSpec]]:
    """Return alias and specification of every metric by device and name, from 1 up."""
    named = ((device, spec) for device, specs in metrics.items() for spec in specs)
    return {(device, spec.name): (n, spec) for n, (device, spec) in enumerate(named, 1)}


ALIASES = numbered(METRICS)
TYPES: Mapping[int, DataType] = {alias: spec.datatype for alias, spec in ALIASES.values()}


class Session:
    """Messages between one CONNECT and its end.

    Parameters
    ----------
    topics : Topics
    bdseq : int
        Number of the connection, 0 to 255.

    Examples
    --------
    >>> session = Session(Topics("Hall 3", "Bench 7"), bdseq=4)
    >>> session.death(1_700_000_000_000).topic
    'spBv1.0/Hall 3/NDEATH/Bench 7'
    """

    def __init__(self, topics: Topics, bdseq: int) -> None:
        self.topics = topics
        self.bdseq = bdseq
        self._seq = 0
        self._born: set[str] = set()

    @property
    def born(self) -> bool:
        """Whether the node's birth was sent."""
        return NODE in self._born

    def alive(self, device: str) -> bool:
        """Whether a device's birth was sent, without a death since then."""
        return device in self._born

    def death(self, now: int) -> Message:
        """Return the death of the node: the will of CONNECT, also published on a clean end."""
        self._born.clear()
        metric = Metric(BDSEQ, timestamp=now, datatype=DataType.INT64, value=self.bdseq)
        payload = Payload((metric,), now)
        return Message(self.topics.of("NDEATH"), encode(payload), qos=1)

    def node_birth(self, readings: Mapping[str, Reading], now: int) -> Message:
        """Return the birth of the node; every device has to be born again after it."""
        self._born, self._seq = {NODE}, 0
        control = {BDSEQ: Reading(self.bdseq, now), REBIRTH: Reading(False, now)}
        return self._message("NBIRTH", NODE, self._birth(NODE, {**readings, **control}, now), now)

    def device_birth(self, device: str, readings: Mapping[str, Reading], now: int) -> Message:
        """Return the birth of a device."""
        self._require(NODE)
        self._born.add(device)
        return self._message("DBIRTH", device, self._birth(device, readings, now), now)

    def device_death(self, device: str, now: int) -> Message:
        """Return the death of a device."""
        self._require(device)
        self._born.remove(device)
        return self._message("DDEATH", device, (), now)

    def data(self, device: str, metrics: Iterable[Metric], now: int) -> Message:
        """Return changed values; their metrics have names, which are sent as aliases.

        Names that the birth lacks are left out: another version may have stored the history.
        """
        self._require(device)
        sent = [
            replace(each, name="", alias=ALIASES[device, each.name][0], datatype=None)
            for each in metrics
            if (device, each.name) in ALIASES
        ]
        kind = "DDATA" if device else "NDATA"
        return self._message(kind, device, tuple(sent), now)

    def _require(self, device: str) -> None:
        if device not in self._born:
            raise RuntimeError(f"{device or 'the node'} isn't born")

    def _birth(self, device: str, readings: Mapping[str, Reading], now: int) -> tuple[Metric, ...]:
        found = []
        for spec in METRICS[device]:
            reading = readings.get(spec.name, Reading(None, now, Quality.STALE))
            properties: dict[str, bool | int | float | str] = {"Quality": int(reading.quality)}
            properties |= {"engUnit": spec.unit} if spec.unit else {}
            properties |= {"readOnly": not spec.writable, "documentation": spec.text}
            found.append(
                Metric(
                    spec.name,
                    None if spec.name == REBIRTH else ALIASES[device, spec.name][0],
                    reading.timestamp,
                    spec.datatype,
                    reading.value,
                    properties=properties,
                )
            )
        return tuple(sorted(found, key=lambda each: each.timestamp or 0))

    def _message(self, kind: str, device: str, metrics: tuple[Metric, ...], now: int) -> Message:
        payload = Payload(metrics, now, self._seq)
        self._seq = (self._seq + 1) % NUMBERS
        return Message(self.topics.of(kind, device), encode(payload, TYPES))
