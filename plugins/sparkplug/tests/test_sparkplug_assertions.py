"""The edge-node assertions of the Sparkplug 3.0.0 specification, each as a test.

A session on a real broker is recorded once, by a host application that decodes with a foreign
library; each assertion is then checked on what it has seen and on the broker's log.
"""

import itertools
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.unknown_fields import UnknownFieldSet
from plugins.sparkplug.tests.mosquitto import Mosquitto, Seen, broker, host
from plugins.sparkplug.tests.scripted_bench import ScriptedBench
from plugins.sparkplug.tests.sparkplug_assertions import NOT_APPLICABLE

from torquebench.errors import InputError
from torquebench.validation import validated
from torquebench_sparkplug.history import History
from torquebench_sparkplug.metrics import METRICS, NODE
from torquebench_sparkplug.payload import DataType, Metric, Quality
from torquebench_sparkplug.settings import SparkplugSettings

DOCS = Path(__file__).parents[1] / "docs" / "sparkplug.md"
LOGGED = ("allow_anonymous true", "log_type all")
DATA = ("NDATA", "DDATA")
BIRTHS = ("NBIRTH", "DBIRTH")
EARLIEST_MS = 1_700_000_000_000


@dataclass
class Trace:
    """Messages of edge nodes that a host received, and the brokers' logs."""

    seen: list[Seen]
    log: str
    other_log: str = ""
    bench: ScriptedBench | None = None

    def of(self, *kinds: str, device: str | None = None) -> list[Seen]:
        found = [each for each in self.seen if each.kind in kinds]
        return [each for each in found if device is None or each.device == device]

    def sessions(self) -> list[list[Seen]]:
        """Return the node's messages by session, each beginning with a birth, without deaths."""
        found: list[list[Seen]] = []
        for each in self.seen:
            if each.kind == "NBIRTH":
                found.append([])
            if each.kind in (*BIRTHS, *DATA, "DDEATH"):
                found[-1].append(each)
        return found


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Trace:
    """Record two sessions: births, history, changes, a fault, a lost device, commands."""
    folder = tmp_path_factory.mktemp("sparkplug")
    old = int(time.time() * 1000) - 60_000
    kept = History(folder / "sparkplug.sqlite", 1.0)
    for number in range(150):  # by turns, so that each is a message of its own: seq wraps
        at = old + 100 * number
        speed = Metric("Speed/Value", None, at, DataType.DOUBLE, 1000.0 + number)
        state = Metric("Bench/State", None, at + 50, DataType.STRING, f"old {number}")
        kept.keep([("input", (speed,)), (NODE, (state,))])
    kept.close()
    bench = ScriptedBench()
    with broker(folder, *LOGGED) as server, host(server.port) as scada:
        with bench.publisher(folder, server.url) as node:
            ncmd, dcmd = node.topics.of("NCMD"), node.topics.of("DCMD", "input")
            scada.until(lambda each: _value(each, "Buffer/Waiting") == 0 and each.kind == "NDATA")
            bench.put("input", "Torque/Value", 20.0)
            scada.until_kind("DDATA", "input")
            bench.put("input", "Torque/Value", None, Quality.BAD)
            scada.until_kind("DDATA", "input")
            bench.put(NODE, "Bench/State", "running")
            scada.until_kind("NDATA")
            bench.alive = False
            scada.until_kind("DDEATH", "output")
            bench.alive = True
            scada.until_kind("DBIRTH", "output")
            scada.command(ncmd, "Node Control/Rebirth", True)
            scada.until_kind("DBIRTH", "output")
            scada.command(ncmd, "Node Control/Rebirth", False)
            scada.command(ncmd, "Bench/State", True)
            scada.command(dcmd, "Torque/Value", True)
            scada.until(lambda each: _value(each, "Commands/Refused") == 2)
        scada.until_kind("NDEATH")
        with bench.publisher(folder, server.url):
            scada.until_kind("DBIRTH", "output")
        scada.until_kind("NDEATH")
        return Trace(scada.seen, server.log(), bench=bench)


@pytest.fixture(scope="module")
def hosted(tmp_path_factory: pytest.TempPathFactory) -> Trace:
    """Record a primary host that is absent, online and offline; then one at the second broker."""
    folder = tmp_path_factory.mktemp("hosted")
    bench = ScriptedBench()
    with broker(folder, *LOGGED) as server, host(server.port, "scada") as scada:
        scada.say(online=False)
        with bench.publisher(folder, server.url, primary_host="scada") as node:
            _until_logged(server, r"STATE/scada \(QoS 1\)")
            scada.say(online=True, host_id="other")
            scada.say(online=True, before_ms=3_600_000)  # older than what it said
            scada.until(lambda each: "/other" in each.topic)
            scada.say(online=True)
            scada.until_kind("DBIRTH", "output")
            scada.say(online=False, before_ms=3_600_000)
            bench.put("input", "Torque/Value", 30.0)
            scada.until(lambda each: _told(each, 30.0))
            scada.say(online=False)
            scada.until_kind("NDEATH")
            bench.put("input", "Torque/Value", 40.0)
            bench.taken()
            bench.put("input", "Torque/Value", 50.0)
            bench.taken()
            scada.say(online=True)
            scada.until(lambda each: _told(each, 40.0, historical=True))
            assert node.settings.primary_host == "scada"
        scada.until_kind("NDEATH")
        log, seen = server.log(), scada.seen
    with (
        broker(folder, *LOGGED) as first,
        broker(folder, *LOGGED) as second,
        host(first.port, "scada") as away,
        host(second.port, "scada") as there,
    ):
        away.say(online=False)
        away.until(lambda each: "STATE" in each.topic and b"false" in each.payload)
        with bench.publisher(folder, first.url, second.url, primary_host="scada"):
            there.until_kind("DBIRTH", "output")
        _until_logged(first, "Received DISCONNECT from tb")
        assert not away.seen_of("NBIRTH")
        return Trace(seen, log + first.log(), second.log())


def _value(message: Seen, name: str) -> Any:
    """Return the integer value of a node's metric in a birth or data message; None without it."""
    if message.kind not in ("NBIRTH", "NDATA"):
        return None
    alias = _ALIASES[NODE, name]
    found = [each for each in message.payload.metrics if each.alias == alias]
    return found[-1].long_value if found and not found[-1].is_historical else None


def _told(message: Seen, value: float, *, historical: bool = False) -> bool:
    return message.kind == "DDATA" and any(
        each.is_historical == historical and each.double_value == value
        for each in message.payload.metrics
    )


def _until_logged(server: Mosquitto, pattern: str) -> None:
    deadline = time.monotonic() + 240.0
    while not re.search(pattern, server.log()):
        assert time.monotonic() < deadline, server.log()
        time.sleep(0.02)


_ALIASES = {
    (device, spec.name): number
    for number, (device, spec) in enumerate(
        ((device, spec) for device, specs in METRICS.items() for spec in specs), 1
    )
}

Check = Callable[[Trace], None]
CHECKS: dict[str, Check] = {}
HOSTED: dict[str, Check] = {}


def asserts(*names: str, of: dict[str, Check] = CHECKS) -> Callable[[Check], Check]:
    """Register a check for assertions, given without the prefix tck-id-."""

    def enter(check: Check) -> Check:
        for name in names:
            assert name not in of
            of[name] = check
        return check

    return enter


def _topics(kind: str, device: bool) -> Check:
    def check(trace: Trace) -> None:
        found = {each.topic for each in trace.of(kind)}
        end = ("/input", "/output") if device else ("",)
        assert found
        assert found <= {f"spBv1.0/Hall 3/{kind}/Bench 7{each}" for each in end}

    return check


def _sent_with(kind: str, qos: int) -> Check:
    def check(trace: Trace) -> None:
        assert trace.of(kind)
        assert all((each.qos, each.retain) == (qos, False) for each in trace.of(kind))

    return check


def _timed(kind: str) -> Check:
    def check(trace: Trace) -> None:
        now = time.time() * 1000
        assert trace.of(kind)
        assert all(EARLIEST_MS < each.payload.timestamp <= now for each in trace.of(kind))

    return check


def _numbered(kind: str) -> Check:
    def check(trace: Trace) -> None:
        assert trace.of(kind)
        for session in trace.sessions():
            for before, each in itertools.pairwise(session):
                if each.kind == kind:
                    assert each.payload.HasField("seq")
                    assert each.payload.seq == (before.payload.seq + 1) % 256

    return check


for _kind, _device in (
    ("NBIRTH", False),
    ("DBIRTH", True),
    ("NDATA", False),
    ("DDATA", True),
    ("DDEATH", True),
):
    _low = _kind.lower()
    asserts(f"topics-{_low}-topic")(_topics(_kind, _device))
    asserts(f"topics-{_low}-mqtt")(_sent_with(_kind, 0))
    if _kind != "DDEATH":
        asserts(f"topics-{_low}-timestamp")(_timed(_kind))
        asserts(f"payloads-{_low}-qos", f"payloads-{_low}-retain")(_sent_with(_kind, 0))
    asserts(f"payloads-{_low}-timestamp")(_timed(_kind))
    if _kind != "NBIRTH":
        _seq = "seq" if _kind == "DBIRTH" else "seq-num"
        asserts(f"topics-{_low}-{_seq}", f"payloads-{_low}-seq", f"payloads-{_low}-seq-inc")(
            _numbered(_kind)
        )
asserts("payloads-ddeath-seq-number")(_numbered("DDEATH"))
asserts("topics-ndeath-topic")(_topics("NDEATH", False))
asserts(
    "message-flow-edge-node-birth-publish-nbirth-topic",
)(_topics("NBIRTH", False))
asserts("message-flow-device-birth-publish-dbirth-topic")(_topics("DBIRTH", True))
asserts(
    "message-flow-edge-node-birth-publish-nbirth-qos",
    "message-flow-edge-node-birth-publish-nbirth-retained",
)(_sent_with("NBIRTH", 0))
asserts(
    "message-flow-device-birth-publish-dbirth-qos",
    "message-flow-device-birth-publish-dbirth-retained",
)(_sent_with("DBIRTH", 0))
asserts("message-flow-device-birth-publish-dbirth-payload-seq")(_numbered("DBIRTH"))


@asserts(
    "topic-structure",
    "topic-structure-namespace-a",
    "topic-structure-namespace-device-id-associated-message-types",
    "topic-structure-namespace-device-id-non-associated-message-types",
    "intro-group-id-string",
    "intro-edge-node-id-string",
    "intro-device-id-string",
)
def check_topics_have_their_levels(trace: Trace) -> None:
    for each in trace.seen:
        namespace, group, kind, node, *device = each.topic.split("/")
        if kind in ("NCMD", "DCMD"):
            continue
        assert (namespace, group, node) == ("spBv1.0", "Hall 3", "Bench 7")
        assert len(device) == (1 if kind in ("DBIRTH", "DDATA", "DDEATH") else 0)


def _refused_id(key: str) -> Check:
    def check(_trace: Trace) -> None:
        good = {"brokers": ["mqtt://127.0.0.1"], "group_id": "Halle 3", "edge_node_id": "Prüfstand"}
        validated(SparkplugSettings, good, "s.toml")
        for wrong in ("a+b", "a/b", "a#", "", "a\x00"):
            with pytest.raises(InputError):
                validated(SparkplugSettings, good | {key: wrong}, "s.toml")

    return check


asserts("intro-group-id-chars", "topic-structure-namespace-valid-group-id")(_refused_id("group_id"))
asserts("intro-edge-node-id-chars", "topic-structure-namespace-valid-edge-node-id")(
    _refused_id("edge_node_id")
)


@asserts(
    "intro-device-id-chars",
    "topic-structure-namespace-valid-device-id",
    "topic-structure-namespace-unique-device-id",
    "case-sensitivity-sparkplug-ids",
)
def check_devices_have_names_of_their_own(trace: Trace) -> None:
    assert {each.device for each in trace.of("DBIRTH")} == {"input", "output"}
    named = [each for each in METRICS if each]
    assert len({each.lower() for each in named}) == len(named)
    assert all(re.fullmatch(r"[a-z]+", each) for each in named)


@asserts("topic-structure-namespace-duplicate-device-id-across-edge-node")
def check_another_bench_may_have_the_same_devices(_trace: Trace) -> None:
    assert set(METRICS) == {NODE, "input", "output"}  # of every bench


@asserts("case-sensitivity-metric-names")
def check_metric_names_differ_beyond_case(_trace: Trace) -> None:
    for specs in METRICS.values():
        names = {spec.name.lower() for spec in specs}
        assert len(names) == len(specs)
        folders = {name.rpartition("/")[0] for name in names}
        assert not names & folders  # a tag isn't a folder, too


@asserts(
    "principles-rbe-recommended",
    "topics-ndata-payload",
    "topics-ddata-payload",
    "operational-behavior-data-publish-nbirth-change",
    "operational-behavior-data-publish-dbirth-change",
)
def check_data_carries_what_has_changed(trace: Trace) -> None:
    torque = _ALIASES["input", "Torque/Value"]
    live = [m for m in trace.of(*DATA) if not m.payload.metrics[0].is_historical]
    values = [each.double_value for m in live for each in m.payload.metrics if each.alias == torque]
    assert values == [20.0, 0.0]  # the fault has no value
    assert not any(m.payload.metrics for m in live if m.device == "output")
    assert len(live) < 20  # though it is read ten times a second


@asserts(
    "principles-birth-certificates-order",
    "message-flow-edge-node-birth-publish-connect",
    "message-flow-device-birth-publish-nbirth-wait",
    "message-flow-device-birth-publish-dbirth-match-edge-node-topic",
    "payloads-dbirth-order",
    "payloads-ndata-order",
    "payloads-ddata-order",
)
def check_births_come_first(trace: Trace) -> None:
    assert trace.of("NBIRTH", "NDEATH", *DATA)[0].kind == "NBIRTH"
    for session in trace.sessions():
        kinds = [each.kind for each in session]
        assert kinds[:3] == ["NBIRTH", "DBIRTH", "DBIRTH"]
        assert {each.device for each in session[1:3]} == {"input", "output"}


@asserts("principles-persistence-clean-session-311")
def check_sessions_are_clean(trace: Trace) -> None:
    assert len(re.findall(r"New client connected .* as tb\w+ \(p2, c1, k5", trace.log)) == 2


@asserts(
    "topics-nbirth-seq-num",
    "payloads-nbirth-seq",
    "payloads-sequence-num-req-nbirth",
    "message-flow-edge-node-birth-publish-nbirth-payload-seq",
)
def check_a_birth_begins_at_zero(trace: Trace) -> None:
    births = trace.of("NBIRTH")
    assert len(births) == 3
    assert all(each.payload.HasField("seq") and each.payload.seq == 0 for each in births)


@asserts("payloads-sequence-num-always-included")
def check_every_message_has_a_number(trace: Trace) -> None:
    assert all(each.payload.HasField("seq") for session in trace.sessions() for each in session)


@asserts("payloads-sequence-num-incrementing")
def check_numbers_wrap(trace: Trace) -> None:
    numbers = [each.payload.seq for each in trace.sessions()[0]]
    assert len(numbers) > 300
    assert numbers == [number % 256 for number in range(len(numbers))]


@asserts(
    "topics-nbirth-metric-reqs",
    "topics-dbirth-metric-reqs",
    "operational-behavior-data-publish-nbirth",
    "operational-behavior-data-publish-dbirth",
)
def check_births_state_every_metric(trace: Trace) -> None:
    for session in trace.sessions():
        born: dict[str, set[int]] = {}
        for each in session:
            if each.kind in BIRTHS:
                born[each.device] = {metric.alias for metric in each.payload.metrics}
            elif each.kind in DATA:
                assert {metric.alias for metric in each.payload.metrics} <= born[each.device]


@asserts(
    "topics-nbirth-metrics",
    "topics-dbirth-metrics",
    "payloads-name-requirement",
    "payloads-metric-datatype-req",
    "payloads-metric-datatype-value",
    "payloads-metric-datatype-value-type",
    "operational-behavior-data-publish-nbirth-values",
    "operational-behavior-data-publish-dbirth-values",
)
def check_births_name_type_and_value(trace: Trace) -> None:
    for each in trace.of(*BIRTHS):
        for metric in each.payload.metrics:
            assert metric.name
            assert 1 <= metric.datatype <= 34
            assert bool(metric.is_null) != (metric.WhichOneof("value") is not None)


@asserts("payloads-metric-datatype-not-req")
def check_data_leaves_types_out(trace: Trace) -> None:
    assert not any(m.HasField("datatype") for each in trace.of(*DATA) for m in each.payload.metrics)


@asserts("payloads-alias-uniqueness")
def check_an_alias_means_one_metric(trace: Trace) -> None:
    for session in trace.sessions():
        named = {
            (metric.alias, each.device, metric.name)
            for each in session
            if each.kind in BIRTHS
            for metric in each.payload.metrics
            if metric.HasField("alias")
        }
        assert len({alias for alias, *_ in named}) == len(named)


@asserts("payloads-alias-birth-requirement")
def check_births_give_aliases(trace: Trace) -> None:
    without = [
        metric.name
        for each in trace.of(*BIRTHS)
        for metric in each.payload.metrics
        if not metric.HasField("alias")
    ]
    assert set(without) == {"Node Control/Rebirth"}


@asserts("payloads-alias-data-cmd-requirement")
def check_data_has_aliases_alone(trace: Trace) -> None:
    for each in trace.of(*DATA):
        for metric in each.payload.metrics:
            assert metric.HasField("alias")
            assert not metric.HasField("name")


@asserts("payloads-name-birth-data-requirement")
def check_every_metric_has_a_time(trace: Trace) -> None:
    for each in trace.of(*BIRTHS, *DATA):
        assert all(metric.HasField("timestamp") for metric in each.payload.metrics)


@asserts("payloads-timestamp-in-UTC", "payloads-metric-timestamp-in-UTC")
def check_times_are_utc(trace: Trace) -> None:
    now = time.time() * 1000
    for each in trace.of(*BIRTHS, *DATA, "DDEATH", "NDEATH"):
        assert now - 3_600_000 < each.payload.timestamp <= now
        assert all(now - 3_600_000 < m.timestamp <= now for m in each.payload.metrics)


@asserts(
    "operational-behavior-data-publish-nbirth-order",
    "operational-behavior-data-publish-dbirth-order",
)
def check_values_are_in_the_order_of_time(trace: Trace) -> None:
    for each in trace.of(*BIRTHS, *DATA):
        times = [metric.timestamp for metric in each.payload.metrics]
        assert times == sorted(times)


def _properties(trace: Trace) -> Iterator[tuple[Seen, Any]]:
    for each in trace.of(*BIRTHS, *DATA):
        for metric in each.payload.metrics:
            if metric.HasField("properties"):
                yield each, metric.properties


@asserts("payloads-propertyset-keys-array-size", "payloads-propertyset-values-array-size")
def check_properties_have_keys_and_values(trace: Trace) -> None:
    found = [properties for _, properties in _properties(trace)]
    assert found
    assert all(len(each.keys) == len(each.values) for each in found)


@asserts(
    "payloads-metric-propertyvalue-type-type",
    "payloads-metric-propertyvalue-type-value",
    "payloads-metric-propertyvalue-type-req",
)
def check_properties_have_types(trace: Trace) -> None:
    types = {part.type for _, properties in _properties(trace) for part in properties.values}
    assert types == {3, 11, 12}


@asserts("payloads-propertyset-quality-value-type", "payloads-propertyset-quality-value-value")
def check_qualities(trace: Trace) -> None:
    found = set()
    for each, properties in _properties(trace):
        for key, part in zip(properties.keys, properties.values, strict=True):
            if key == "Quality":
                assert part.type == 3
                found.add((each.kind, part.int_value))
    assert {value for _, value in found} == {0, 192, 500}
    assert ("DDATA", 0) in found  # the fault


@asserts(
    "topics-nbirth-bdseq-included",
    "payloads-nbirth-bdseq",
    "topics-nbirth-bdseq-matching",
    "payloads-nbirth-bdseq-repeat",
    "payloads-ndeath-bdseq",
    "message-flow-edge-node-birth-publish-nbirth-payload-bdSeq",
    "message-flow-edge-node-birth-publish-will-message-payload-bdSeq",
    "operational-behavior-data-commands-rebirth-action-3",
)
def check_births_and_deaths_have_the_number_of_the_connection(trace: Trace) -> None:
    found = [(each.kind, each.metric("bdSeq")) for each in trace.of("NBIRTH", "NDEATH")]
    assert all(metric.datatype == 4 for _, metric in found)
    assert [(kind, metric.long_value) for kind, metric in found] == [
        ("NBIRTH", 0),
        ("NBIRTH", 0),
        ("NDEATH", 0),
        ("NBIRTH", 1),
        ("NDEATH", 1),
    ]


@asserts("topics-nbirth-bdseq-increment")
def check_the_number_of_the_connection_wraps(trace: Trace) -> None:
    assert [each.metric("bdSeq").long_value for each in trace.of("NBIRTH")] == [0, 0, 1]
    history = History(Path(":memory:"), 1.0)
    used = []
    for _ in range(257):
        used.append(history.bdseq)
        history.connected()
    history.close()
    assert used == [*range(256), 0]


@asserts(
    "topics-nbirth-rebirth-metric",
    "payloads-nbirth-rebirth-req",
    "operational-behavior-data-commands-rebirth-name",
    "operational-behavior-data-commands-rebirth-name-aliases",
    "operational-behavior-data-commands-rebirth-datatype",
    "operational-behavior-data-commands-rebirth-value",
)
def check_births_offer_rebirth(trace: Trace) -> None:
    for each in trace.of("NBIRTH"):
        metric = each.metric("Node Control/Rebirth")
        assert metric.datatype == 11
        assert metric.HasField("boolean_value")
        assert metric.boolean_value is False
        assert not metric.HasField("alias")


@asserts(
    "topics-ncmd-topic",
    "operational-behavior-data-commands-rebirth-action-1",
    "operational-behavior-data-commands-rebirth-action-2",
)
def check_a_rebirth_is_whole(trace: Trace) -> None:
    asked = next(n for n, each in enumerate(trace.seen) if each.kind == "NCMD")
    assert trace.seen[asked].topic == "spBv1.0/Hall 3/NCMD/Bench 7"
    after = [(each.kind, each.device) for each in trace.seen[asked + 1 : asked + 4]]
    assert after == [("NBIRTH", ""), ("DBIRTH", "input"), ("DBIRTH", "output")]
    assert len(trace.of("NBIRTH")) == 3  # false asks for none


@asserts("message-flow-edge-node-ncmd-subscribe")
def check_commands_to_the_node_are_subscribed_to(trace: Trace) -> None:
    assert re.search(r"\tspBv1.0/Hall 3/NCMD/Bench 7 \(QoS 1\)", trace.log)


@asserts("topics-dcmd-topic", "message-flow-device-dcmd-subscribe")
def check_commands_to_devices_are_seen_and_refused(trace: Trace) -> None:
    assert re.search(r"\tspBv1.0/Hall 3/DCMD/Bench 7/\+ \(QoS 1\)", trace.log)
    assert any(_value(each, "Commands/Refused") == 2 for each in trace.seen)
    assert trace.bench is not None
    refused = [note for note in trace.bench.notes if "refused" in note]
    assert "nothing on this bench is commanded by MQTT" in refused[0]


@asserts(
    "message-flow-edge-node-birth-publish-will-message",
    "message-flow-edge-node-birth-publish-will-message-topic",
    "message-flow-edge-node-birth-publish-will-message-qos",
    "message-flow-edge-node-birth-publish-will-message-will-retained",
    "payloads-ndeath-will-message",
    "payloads-ndeath-will-message-qos",
    "payloads-ndeath-will-message-retain",
)
def check_the_will_is_the_death(trace: Trace) -> None:
    will = r"Will message specified \(\d+ bytes\) \(r0, q1\)\.\n.*spBv1\.0/Hall 3/NDEATH/Bench 7\n"
    assert len(re.findall(will, trace.log)) == 2


@asserts(
    "message-flow-edge-node-birth-publish-will-message-payload",
    "message-flow-edge-node-birth-publish-nbirth-payload",
    "message-flow-device-birth-publish-dbirth-payload",
)
def check_payloads_are_protobuf(trace: Trace) -> None:
    for each in trace.of("NDEATH", *BIRTHS):  # decoded by a foreign library
        assert each.payload.metrics
        parts = [each.payload, *each.payload.metrics]
        parts += [metric.properties for metric in each.payload.metrics]
        assert not any(len(UnknownFieldSet(part)) for part in parts)


@asserts("topics-ndeath-payload")
def check_a_death_has_one_metric(trace: Trace) -> None:
    for each in trace.of("NDEATH"):
        assert [metric.name for metric in each.payload.metrics] == ["bdSeq"]


@asserts("topics-ndeath-seq", "payloads-ndeath-seq")
def check_a_death_has_no_number(trace: Trace) -> None:
    assert trace.of("NDEATH")
    assert not any(each.payload.HasField("seq") for each in trace.of("NDEATH"))


@asserts(
    "operational-behavior-edge-node-intentional-disconnect-ndeath",
    "operational-behavior-edge-node-intentional-disconnect-packet",
    "payloads-ndeath-will-message-publisher",
    "payloads-ndeath-will-message-publisher-disconnect-mqtt311",
)
def check_a_clean_end_publishes_the_death_itself(trace: Trace) -> None:
    end = r"Received PUBLISH from tb\w+ \(d0, q1, r0, m\d+, 'spBv1.0/Hall 3/NDEATH/Bench 7'"
    ends = [match.start() for match in re.finditer(end, trace.log)]
    left = [match.start() for match in re.finditer("Received DISCONNECT from tb", trace.log)]
    assert len(ends) == len(left) == 2
    assert all(death < gone for death, gone in zip(ends, left, strict=True))


@asserts("operational-behavior-device-ddeath")
def check_a_lost_device_dies(trace: Trace) -> None:
    kinds = [each.kind for each in trace.of("DBIRTH", "DDEATH", device="output")]
    assert kinds == ["DBIRTH", "DDEATH", "DBIRTH", "DBIRTH", "DBIRTH"]


@asserts(
    "message-flow-edge-node-birth-publish-phid-wait",
    "message-flow-edge-node-birth-publish-phid-wait-id",
    "message-flow-edge-node-birth-publish-phid-wait-online",
    "message-flow-edge-node-birth-publish-phid-wait-timestamp",
    "operational-behavior-edge-node-birth-sequence-wait",
    of=HOSTED,
)
def check_births_wait_for_the_primary_host(trace: Trace) -> None:
    said = [each for each in trace.seen if each.kind in ("STATE", "NBIRTH")]
    birth = next(n for n, each in enumerate(said) if each.kind == "NBIRTH")
    before = said[birth - 1]
    assert before.topic == "spBv1.0/STATE/scada"
    assert b'"online": true' in before.payload
    assert any("/other" in each.topic for each in said[:birth])


@asserts(
    "operational-behavior-edge-node-termination-host-offline",
    "message-flow-edge-node-birth-publish-phid-offline",
    of=HOSTED,
)
def check_the_node_leaves_with_its_host(trace: Trace) -> None:
    death = next(n for n, each in enumerate(trace.seen) if each.kind == "NDEATH")
    state = [each for each in trace.seen[:death] if each.kind == "STATE"][-1]
    assert b'"online": false' in state.payload
    births = trace.of("NBIRTH")
    assert [each.metric("bdSeq").long_value for each in births] == [0, 1]


@asserts("operational-behavior-edge-node-termination-host-offline-timestamp", of=HOSTED)
def check_old_words_of_the_host_are_ignored(trace: Trace) -> None:
    told = trace.of("NBIRTH", "NDEATH", "DDATA", "STATE")
    old = [m for m in told if m.kind == "DDATA" and m.payload.metrics[0].is_historical]
    kinds = [each.kind for each in told if each not in old]
    first = kinds[kinds.index("NBIRTH") : kinds.index("NDEATH")]
    assert first == ["NBIRTH", "STATE", "DDATA", "STATE"]  # offline of an hour ago, data, offline


@asserts(
    "operational-behavior-edge-node-termination-host-offline-reconnect",
    "operational-behavior-primary-application-state-with-multiple-servers-walk",
    "operational-behavior-primary-application-state-with-multiple-servers-single-server",
    of=HOSTED,
)
def check_the_node_goes_to_the_broker_where_its_host_is(trace: Trace) -> None:
    left = re.findall(r"^(\d+): Received DISCONNECT from tb", trace.log, re.MULTILINE)[-1]
    came = re.findall(r"^(\d+): New client connected .* as tb", trace.other_log, re.MULTILINE)[0]
    assert int(left) <= int(came)
    assert len(re.findall("New client connected .* as tb", trace.other_log)) == 1


@pytest.mark.parametrize("name", CHECKS)
def test_assertion(name: str, trace: Trace) -> None:
    CHECKS[name](trace)


@pytest.mark.parametrize("name", HOSTED)
def test_assertion_with_a_primary_host(name: str, hosted: Trace) -> None:
    HOSTED[name](hosted)


def test_the_reference_counts_every_assertion_once() -> None:
    page = DOCS.read_text("utf-8")
    assert not set(CHECKS) & set(HOSTED)
    assert not set(NOT_APPLICABLE) & (set(CHECKS) | set(HOSTED))
    assert f" {len(CHECKS) + len(HOSTED)} have a test each" in page
    assert f" {len(NOT_APPLICABLE)} don't apply" in page
