"""Injected faults of simulated instruments: on the wire, in their actions and in their values.

===============  ============================================================================
`delay`          each answer comes `amount` seconds late (default 1 s): with 0.005 a slow wire
`drop`           no answer
`cut`            only the first half of the answer comes
`garble`         bytes of the answer are changed
`disconnect`     connections are closed, new ones too until it is over
`freeze`         answers come, and state what was true when it began
`lie`            answers come, and state the opposite: an enabled drive is off, a closed
                 clamp open, a probe 20 K warmer, a standard's torque of the other sign
`scale`          answers come, and state `amount` times what is true (1.03 by default); a drive
                 does `amount` times what it is told
`jitter`         what is stated is up to `amount` seconds older than the answer (50 ms by
                 default), drawn anew for each answer; a counter's answer is so late on the bench
`ignore`         commands are acknowledged, and nothing is done
`unguarded`      a drive's own watchdog never acts
`slow`           a drive needs `amount` seconds for each step from off to ready and to power
`local`          a CANopen drive is in local control: it says so, and does nothing
`not yet`        a CANopen drive refuses commands in its present state (0x08000022)
`busy`           a Modbus server answers that it is busy (exception 6)
===============  ============================================================================

A fault lasts until `replies` answers were affected, until `duration_s` of wall time have passed, or
until it is healed, whichever comes first. Endpoints have the names of the sections of `[driver]`:
`counter`, `input_drive`, `output_drive`, `reference`, `temperature`, `modes`, `clamp`, `angles`.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from torquebench.errors import InputError
from torquebench.message import Message

MisbehaviourKind = Literal[
    "delay",
    "drop",
    "cut",
    "garble",
    "disconnect",
    "freeze",
    "lie",
    "scale",
    "jitter",
    "ignore",
    "unguarded",
    "slow",
    "local",
    "not yet",
    "busy",
]
KINDS: tuple[MisbehaviourKind, ...] = get_args(MisbehaviourKind)
AMOUNTS: dict[MisbehaviourKind, tuple[float, float, float]] = {
    "delay": (1.0, 0.0, 60.0),
    "slow": (1.0, 0.0, 60.0),
    "scale": (1.03, 0.0, 10.0),
    "jitter": (0.05, 0.0, 1.0),
}
"""Default, lowest and highest amount of the kinds that have one; their units are given above."""
GARBLED_SHARE = 4
"""Number of bytes of which one is changed; at least one byte is changed."""


@dataclass
class _Order:
    amount: float
    replies: int | None
    until: float | None

    def over(self) -> bool:
        """Return whether its replies are used up or its time has passed."""
        spent = self.replies is not None and self.replies <= 0
        return spent or (self.until is not None and time.monotonic() >= self.until)


class WireFaults:
    """Injected faults of one endpoint, which its simulator checks before every answer.

    Parameters
    ----------
    random_source : random.Random
        Random source for the garbled bytes.
    """

    def __init__(self, name: str, random_source: random.Random) -> None:
        self.name = name
        self._random = random_source
        self._lock = threading.Lock()
        self._orders: dict[MisbehaviourKind, _Order] = {}
        self.disconnect: Callable[[], None] = lambda: None
        """Function, set by the simulator, that closes every connection."""

    def start(
        self, kind: MisbehaviourKind, amount: float, replies: int | None, duration_s: float | None
    ) -> None:
        """Begin a fault."""
        until = None if duration_s is None else time.monotonic() + duration_s
        with self._lock:
            self._orders[kind] = _Order(amount, replies, until)
        if kind == "disconnect":
            self.disconnect()
            if replies is None and duration_s is None:  # only once
                self.heal(kind)

    def heal(self, kind: MisbehaviourKind | None = None) -> None:
        """End one kind of fault, or all kinds."""
        with self._lock:
            if kind is None:
                self._orders.clear()
            else:
                self._orders.pop(kind, None)

    def _order(self, kind: MisbehaviourKind) -> _Order | None:
        """Return a misbehaviour that was started and isn't over."""
        order = self._orders.get(kind)
        if order is not None and order.over():
            self._orders.pop(kind, None)
            return None
        return order

    def active(self, kind: MisbehaviourKind) -> bool:
        """Return whether a fault is active."""
        return self._order(kind) is not None

    def _amount(self, kind: MisbehaviourKind, otherwise: float) -> float:
        order = self._order(kind)
        return otherwise if order is None else order.amount

    def _take(self, kind: MisbehaviourKind) -> float | None:
        """Use a fault for one answer: return its amount, None if there is none."""
        with self._lock:
            order = self._order(kind)
            if order is not None and order.replies is not None:
                order.replies -= 1
            return None if order is None else order.amount

    @property
    def frozen(self) -> bool:
        """Whether the values are frozen."""
        return self.active("freeze")

    @property
    def lying(self) -> bool:
        """Whether the opposite of the true values is reported."""
        return self.active("lie")

    @property
    def ignoring(self) -> bool:
        """Whether this command is acknowledged without effect."""
        return self._take("ignore") is not None

    @property
    def local(self) -> bool:
        """Whether a drive is in local control."""
        return self.active("local")

    @property
    def not_yet(self) -> bool:
        """Whether this command is refused in the present state."""
        return self._take("not yet") is not None

    @property
    def busy(self) -> bool:
        """Whether this request is answered by "busy"."""
        return self._take("busy") is not None

    @property
    def slowness_s(self) -> float:
        """Duration of each step of a drive to its power, s."""
        return self._amount("slow", 0.0)

    @property
    def scale(self) -> float:
        """Factor on a value; 1 without a fault."""
        return self._amount("scale", 1.0)

    def age_s(self) -> float:
        """Draw the age of the reported value, s."""
        amount_s = self._amount("jitter", 0.0)
        return self._random.uniform(0.0, amount_s) if amount_s else 0.0

    @property
    def refusing(self) -> bool:
        """Whether a new connection is closed at once."""
        return self._take("disconnect") is not None

    def pause(self) -> None:
        """Wait if the answer is delayed by a fault."""
        delay_s = self._take("delay")
        if delay_s is not None:
            time.sleep(delay_s)

    def dropping(self) -> bool:
        """Return whether this answer is dropped."""
        return self._take("drop") is not None

    def garbling(self) -> bool:
        """Return whether this answer is garbled."""
        return self._take("garble") is not None

    def outgoing(self, data: bytes) -> bytes | None:
        """Apply the faults to one answer, and wait if it is late; None drops the answer."""
        if not self._orders:
            return data
        self.pause()
        if self.dropping():
            return None
        if self._take("cut") is not None:
            return data[: len(data) // 2]
        if not self.garbling():
            return data
        spoilt = bytearray(data)
        for _ in range(max(1, len(data) // GARBLED_SHARE)):
            spoilt[self._random.randrange(len(data))] ^= self._random.randrange(1, 256)
        return bytes(spoilt)


class Misbehaviour:
    """Faults of all endpoints of a set of simulators.

    Parameters
    ----------
    seed : int
        Seed of the garbled bytes.

    Examples
    --------
    >>> orders = Misbehaviour()
    >>> faults = orders.endpoint("input_drive")
    >>> orders.start("input_drive", "drop", replies=1)
    >>> faults.outgoing(b"answer"), faults.outgoing(b"answer")
    (None, b'answer')
    """

    def __init__(self, seed: int = 0) -> None:
        self._random = random.Random(seed)
        self._endpoints: dict[str, WireFaults] = {}

    def endpoint(self, name: str) -> WireFaults:
        """Return the faults of an endpoint; the first call registers it."""
        return self._endpoints.setdefault(name, WireFaults(name, self._random))

    def alias(self, name: str, endpoint: str) -> None:
        """Let an endpoint be named by another role of the same instrument."""
        self._endpoints[name] = self._endpoints[endpoint]

    @property
    def endpoints(self) -> tuple[str, ...]:
        """Names of endpoints and aliases."""
        return tuple(self._endpoints)

    def start(
        self,
        endpoint: str,
        kind: MisbehaviourKind,
        *,
        amount: float | None = None,
        replies: int | None = None,
        duration_s: float | None = None,
    ) -> None:
        """Begin a fault of an endpoint.

        Parameters
        ----------
        kind : str
            See the module.
        amount : float, optional
            Amount, for kinds that have one.
        replies : int, optional
            Number of affected answers.
        duration_s : float, optional
            Duration, s of wall time.

        Raises
        ------
        InputError
            There is no such endpoint or kind, or a value is out of range.
        """
        if endpoint not in self._endpoints:
            raise InputError(
                Message("endpoint {endpoint!r}", endpoint),
                Message("one of {list}", ", ".join(self._endpoints)),
            )
        if kind not in KINDS:
            raise InputError(
                Message("misbehaviour {kind!r}", kind), Message("one of {list}", ", ".join(KINDS))
            )
        default, lowest, highest = AMOUNTS.get(kind, (0.0, 0.0, 60.0))
        amount = default if amount is None else amount
        if not lowest <= amount <= highest:
            raise InputError(
                Message("amount {amount:g} of {kind}", amount, kind),
                Message("{low:g} to {high:g}", lowest, highest),
            )
        if replies is not None and replies < 1:
            raise InputError(Message("{replies} replies", replies), "at least 1")
        if duration_s is not None and not 0.0 <= duration_s < float("inf"):
            raise InputError(Message("duration {duration_s:g} s", duration_s), "0 s or longer")
        self._endpoints[endpoint].start(kind, amount, replies, duration_s)

    def heal(self, endpoint: str | None = None) -> None:
        """End all faults of one endpoint, or of all endpoints."""
        for name, faults in self._endpoints.items():
            if endpoint is None or name == endpoint:
                faults.heal()
