"""A connection to one broker, in a thread of its own, as a queue of events."""

from __future__ import annotations

import contextlib
import hashlib
import ssl
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

from torquebench_sparkplug.session import Message
from torquebench_sparkplug.settings import Broker, SparkplugSettings

__all__ = ["Confirmed", "Down", "Event", "Link", "Opened", "Received", "Subscribed", "tls_context"]

CONNECT_S = 10.0
REFUSED = 128


@dataclass(frozen=True)
class Opened:
    """The broker has been reached: it is sent a CONNECT."""

    link: Link


@dataclass(frozen=True)
class Subscribed:
    """The broker has taken the connection and the subscriptions."""

    link: Link


@dataclass(frozen=True)
class Received:
    """A message has arrived."""

    link: Link
    topic: str
    payload: bytes
    retained: bool


@dataclass(frozen=True)
class Confirmed:
    """The broker has read everything that was sent before a marker."""

    link: Link
    marker: int


@dataclass(frozen=True)
class Down:
    """The connection has ended, or never began."""

    link: Link
    reason: str


Event = Opened | Subscribed | Received | Confirmed | Down


def tls_context(settings: SparkplugSettings) -> ssl.SSLContext:
    """Return how brokers are checked, and how this edge node identifies itself.

    Raises
    ------
    OSError
        A file can't be used; `ssl.SSLError` is one, too.
    """
    context = ssl.create_default_context(cafile=settings.tls.ca_file)
    if settings.tls.cert_file is not None:
        context.load_cert_chain(settings.tls.cert_file, settings.tls.key_file)
    return context


class Link:
    """One connection; it isn't repeated.

    Parameters
    ----------
    broker : Broker
    settings : SparkplugSettings
    will : Message
        Published by the broker where this connection ends without a farewell.
    topics : sequence of str
        Topics to subscribe to, with QoS 1.
    post : callable
        Takes the events, on the connection's thread.
    """

    def __init__(
        self,
        broker: Broker,
        settings: SparkplugSettings,
        will: Message,
        topics: Sequence[str],
        post: Callable[[Event], None],
    ) -> None:
        self.broker = broker
        self._keep_alive_s = settings.keep_alive_s
        self._topics = [(topic, 1) for topic in topics]
        # never subscribed to: the broker's acknowledgement is all that is needed
        self._marker_topic = will.topic
        self._post = post
        self._reason = ""
        named = f"{settings.group_id}/{settings.edge_node_id}".encode()
        self._client = client = mqtt.Client(
            CallbackAPIVersion.VERSION2,
            client_id=f"tb{hashlib.sha256(named).hexdigest()[:20]}",
            clean_session=True,
            protocol=mqtt.MQTTv311,
            reconnect_on_failure=False,
        )
        client.connect_timeout = CONNECT_S
        client.will_set(will.topic, will.payload, will.qos, retain=False)
        if settings.user is not None:
            client.username_pw_set(settings.user, settings.password())
        if broker.secure:
            client.tls_set_context(tls_context(settings))
        client.on_socket_open = lambda *_: post(Opened(self))
        client.on_connect = self._connected
        client.on_disconnect = self._disconnected
        client.on_subscribe = self._subscribed
        client.on_unsubscribe = self._unsubscribed
        client.on_message = self._received
        self._thread = threading.Thread(target=self._run, name="torquebench-mqtt", daemon=True)

    def start(self) -> None:
        """Connect; the result is an event."""
        self._thread.start()

    def _run(self) -> None:
        try:
            self._client.connect(self.broker.host, self.broker.port, self._keep_alive_s)
            self._client.loop_forever()
        except (OSError, ValueError) as error:  # refused, not found, no route, TLS
            self._reason = self._reason or str(error)
        self._post(Down(self, self._reason or "the broker has closed the connection"))

    def publish(self, message: Message) -> Any:
        """Send a message."""
        return self._client.publish(message.topic, message.payload, message.qos, retain=False)

    def mark(self) -> int | None:
        """Request an event once the broker has read everything so far; None without connection.

        A broker reads in order and answers every UNSUBSCRIBE, even without a subscription (MQTT
        3.1.1, 3.10.4). That is all the confirmation there is for messages with QoS 0.
        """
        marker: int | None = self._client.unsubscribe(self._marker_topic)[1]
        return marker

    def farewell(self, message: Message, timeout_s: float) -> bool:
        """Send a last message and disconnect; return whether the broker has confirmed it."""
        sent = self.publish(message)
        with contextlib.suppress(RuntimeError, ValueError):  # not connected
            sent.wait_for_publish(timeout_s)
        return bool(sent.rc == mqtt.MQTT_ERR_SUCCESS and sent.is_published())

    def close(self, reason: str = "ended by this side") -> None:
        """Disconnect."""
        self._reason = self._reason or reason
        self._client.disconnect()

    def join(self, timeout_s: float) -> None:
        """Wait for the connection's thread."""
        if self._thread.is_alive():
            self._thread.join(timeout_s)

    # -- callbacks of paho ------------------------------------------------------------------

    def _connected(self, client: mqtt.Client, _data: Any, _flags: Any, code: Any, _p: Any) -> None:
        if code.is_failure:
            self._reason = f"the broker refuses: {code}"
        else:
            client.subscribe(self._topics)

    def _subscribed(self, _client: Any, _data: Any, _mid: int, codes: Any, _p: Any) -> None:
        refused = [t for (t, _), c in zip(self._topics, codes, strict=False) if c.value >= REFUSED]
        if refused:
            self.close(f"the broker refuses the subscription to {', '.join(refused)}")
        else:
            self._post(Subscribed(self))

    def _disconnected(self, _client: Any, _data: Any, _flags: Any, code: Any, _p: Any) -> None:
        if code.is_failure:
            self._reason = self._reason or str(code)

    def _unsubscribed(self, _client: Any, _data: Any, mid: int, _codes: Any, _p: Any) -> None:
        self._post(Confirmed(self, mid))

    def _received(self, _client: Any, _data: Any, message: mqtt.MQTTMessage) -> None:
        self._post(Received(self, message.topic, bytes(message.payload), bool(message.retain)))
