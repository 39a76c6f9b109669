"""A mosquitto broker for the tests, and a host application with an independent decoder."""

import json
import os
import queue
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import paho.mqtt.client as mqtt
from esio_spb_builder.core import sparkplug_b_pb2 as foreign
from paho.mqtt.enums import CallbackAPIVersion
from tests.programs import program

PATIENCE_S = 120.0


class Mosquitto:
    """A broker on a free port, which can be killed and started again."""

    def __init__(self, folder: Path, *options: str) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = int(free.getsockname()[1])
        self._config = folder / f"mosquitto-{self.port}.conf"
        self._log = folder / f"mosquitto-{self.port}.log"
        lines = [f"listener {self.port} 127.0.0.1", "persistence false", "max_queued_messages 0"]
        lines += ["user root"] if os.geteuid() == 0 else []
        lines += options or ("allow_anonymous true",)
        self._config.write_text("\n".join(lines) + "\n")
        self._process: subprocess.Popen[bytes] | None = None
        self.start()

    @property
    def url(self) -> str:
        return f"mqtt://127.0.0.1:{self.port}"

    def start(self) -> None:
        found = program("mosquitto")
        assert found is not None, "mosquitto isn't installed (Debian package: mosquitto)"
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                [found, "-c", str(self._config)], stdout=log, stderr=log
            )
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=5).close()
                return
            except OSError:
                assert self._process.poll() is None, self._log.read_text()
                assert time.monotonic() < deadline
                time.sleep(0.02)

    def kill(self) -> None:
        """Kill the broker, as by a power cut."""
        assert self._process is not None
        self._process.kill()
        self._process.wait()

    def freeze(self) -> None:
        """Stop the broker's process, so that it doesn't answer but its connections stay open."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def log(self) -> str:
        return self._log.read_text()


@dataclass(frozen=True)
class Seen:
    """A message as received by the host."""

    topic: str
    payload: Any
    qos: int
    retain: bool

    @property
    def kind(self) -> str:
        levels = self.topic.split("/")
        return "STATE" if levels[1] == "STATE" else levels[2]

    @property
    def device(self) -> str:
        return "/".join(self.topic.split("/")[4:])

    def metric(self, name: str) -> Any:
        return next(each for each in self.payload.metrics if each.name == name)


@dataclass
class Host:
    """A host application that receives all messages in order, decoded by an independent library."""

    port: int
    host_id: str = ""
    seen: list[Seen] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._new: queue.SimpleQueue[Seen] = queue.SimpleQueue()
        self._ready: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self.client = mqtt.Client(CallbackAPIVersion.VERSION2, protocol=mqtt.MQTTv311)
        self.client.reconnect_delay_set(1, 1)
        self._state = f"spBv1.0/STATE/{self.host_id}"
        self.client.on_connect = lambda client, *_: client.subscribe("spBv1.0/#", 1)
        self.client.on_subscribe = lambda *_: self._subscribed()
        self.client.on_message = lambda _c, _d, message: self._take(message)
        self.client.connect("127.0.0.1", self.port)
        self.client.loop_start()
        self.connected()

    def _subscribed(self) -> None:
        if self.host_id:
            self.say(online=True)
        self._ready.put(True)

    def say(self, *, online: bool, host_id: str = "", before_ms: int = 0) -> None:
        """Publish whether this host, or another host, is online."""
        said = {"online": online, "timestamp": round(time.time() * 1000) - before_ms}
        topic = f"spBv1.0/STATE/{host_id}" if host_id else self._state
        self.client.publish(topic, json.dumps(said), 1, retain=True)

    def connected(self) -> None:
        """Wait until the host has subscribed after its latest connection."""
        assert self._ready.get(timeout=PATIENCE_S)

    def _take(self, message: mqtt.MQTTMessage) -> None:
        payload: Any = message.payload
        if "/STATE/" not in message.topic:
            payload = foreign.Payload()
            payload.ParseFromString(message.payload)
        self._new.put(Seen(message.topic, payload, message.qos, bool(message.retain)))

    def until(self, condition: Callable[[Seen], bool], patience_s: float = PATIENCE_S) -> Seen:
        """Wait for a message; earlier messages are also stored in `seen`."""
        deadline = time.monotonic() + patience_s
        while True:
            try:
                message = self._new.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                shown = [(each.topic, len(str(each.payload))) for each in self.seen[-20:]]
                raise AssertionError(f"waited in vain; the last messages: {shown}") from None
            self.seen.append(message)
            if condition(message):
                return message

    def until_kind(self, kind: str, device: str = "") -> Seen:
        return self.until(lambda each: each.kind == kind and each.device == device)

    def seen_of(self, *kinds: str, device: str | None = None) -> list[Seen]:
        found = [each for each in self.seen if each.kind in kinds]
        return [each for each in found if device is None or each.device == device]

    def command(self, topic: str, name: str, value: bool, *, retain: bool = False) -> None:
        """Write a Boolean metric as a host does."""
        payload = foreign.Payload(timestamp=round(time.time() * 1000))
        payload.metrics.add(name=name, datatype=foreign.Boolean, boolean_value=value)
        self.client.publish(topic, payload.SerializeToString(), 0, retain=retain)

    def close(self) -> None:
        self.client.disconnect()
        self.client.loop_stop()


@contextmanager
def broker(folder: Path, *options: str) -> Iterator[Mosquitto]:
    """Run a broker until the block ends."""
    running = Mosquitto(folder, *options)
    try:
        yield running
    finally:
        running.kill()


@contextmanager
def host(port: int, host_id: str = "") -> Iterator[Host]:
    """Run a host application; with a name, it publishes that it is online."""
    running = Host(port, host_id)
    try:
        yield running
    finally:
        running.close()
