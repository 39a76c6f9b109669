"""What every driver does, over real sockets, whatever its protocol and role."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import pytest

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import Identified
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError, InputError

__all__ = ["SLOWEST_FAILURE_S", "DriverCase", "DriverContract", "Peer"]

SLOWEST_FAILURE_S = 60.0
"""Longest time until a driver states a failure, s."""


@dataclass(frozen=True)
class DriverCase:
    """One driver: where its section is, how it is read, and what a right answer looks like.

    Parameters
    ----------
    name : str
    key : str
        Section of the bench description, such as "temperature" for ``[driver.temperature]``.
    read : callable
        Reads from the instrument.
    right : callable
        Whether an answer is right.
    lossy : bool
        Whether an answer that is lost takes readings with it, as of a stream.
    quiet : bool
        Whether it states that it has nothing instead of raising.
    """

    name: str
    key: str
    read: Callable[[Any], Any]
    right: Callable[[Any], bool]
    lossy: bool = False
    quiet: bool = False


class Misbehaviour(Protocol):
    """Faults of a peer on command."""

    def start(self, key: str, kind: str, /, **options: Any) -> Any:
        """Begin to drop, cut, delay or garble replies, or to disconnect."""


class Peer(Protocol):
    """What answers in the place of the instrument, with the description of a bench that has it."""

    @property
    def description(self) -> BenchDescription:
        """Description of the bench."""

    @property
    def misbehaviour(self) -> Any:
        """Faults on command: see `Misbehaviour`."""


def failing(case: DriverCase, instrument: Any) -> BenchError | None:
    """Read and return the failure that this driver has to state; None where it states nothing."""
    started = time.monotonic()
    try:
        if case.quiet:
            assert case.read(instrument) == {}
            return None
        with pytest.raises(BenchError) as caught:
            case.read(instrument)
        return caught.value
    finally:
        assert time.monotonic() - started < SLOWEST_FAILURE_S


def right_or_failing(case: DriverCase, instrument: Any) -> None:
    """Read a stream that may have lost a part: it is whole, or says that it isn't."""
    try:
        assert case.right(case.read(instrument))
    except BenchError as failure:
        assert failure.remedy  # noqa: PT017 - not raising is right, too


class DriverContract:
    """Tests of a driver; a subclass has the fixtures `case` and `peer`.

    Examples
    --------
    ::

        class TestProbes(DriverContract):
            @pytest.fixture
            def case(self):
                return DriverCase(
                    "probes", "temperature", lambda i: i.temperatures(), lambda t: len(t) == 5,
                    quiet=True,
                )

            @pytest.fixture
            def peer(self, case):
                with SimulatedProbes() as peer:  # has `description` and `misbehaviour`
                    yield peer
    """

    @pytest.fixture
    def instrument(self, case: DriverCase, peer: Peer) -> Iterator[Any]:
        """Open the instrument."""
        opened = open_role(peer.description, case.key)
        yield opened
        opened.close()

    @pytest.fixture
    def hasty_instrument(self, case: DriverCase, peer: Peer) -> Iterator[Any]:
        """Open the instrument with short time limits."""
        opened = open_role(self.hasty(peer.description), case.key)
        yield opened
        opened.close()

    def hasty(self, description: BenchDescription) -> BenchDescription:
        """Return a description whose time limits are short, so that faults take no time."""
        return description

    def elsewhere(self, description: BenchDescription, key: str) -> BenchDescription:
        """Return the description with an address where nobody listens: the discard port."""
        section = dict(description.driver[key])
        if "bus" in section:
            section["bus"] = section["bus"] | {"port": 9}
        elif "host" in section:  # of a router whose port is fixed
            section["host"] = "127.0.0.1:9"
        elif "adapter" in section:
            section["adapter"] = "127.0.0.1:9"
        elif "address" in section:
            scheme = "opc.tcp://" if section["protocol"] == "opcua" else ""
            section["address"] = f"{scheme}127.0.0.1:9"
        else:
            section["channels"] = dict.fromkeys(section["channels"], "127.0.0.1:9")
        driver = dict(description.driver) | {key: section}
        return description.model_copy(update={"driver": driver})

    def test_it_says_who_it_is(self, case: DriverCase, peer: Peer, instrument: Any) -> None:
        if not isinstance(instrument, Identified):
            pytest.fail("no identity") if case.key != "angles" else None
            return
        identity = instrument.identity()
        assert identity.manufacturer
        assert identity.model
        described_serial = peer.description.serials.get(identity.role)
        assert described_serial in (None, identity.serial)

    def test_it_reads(self, case: DriverCase, instrument: Any) -> None:
        assert case.right(case.read(instrument))
        assert case.right(case.read(instrument))

    def test_nobody_at_its_address_is_an_error_that_names_it(
        self, case: DriverCase, peer: Peer
    ) -> None:
        broken = self.elsewhere(peer.description, case.key)
        try:
            opened = open_role(broken, case.key)
        except BenchError as error:
            assert f"driver.{case.key}" in error.found  # noqa: PT017 - may also fail when it reads
            return
        try:
            failure = failing(case, opened)
            assert failure is None or "127.0.0.1:9" in failure.found
        finally:
            opened.close()

    def test_silence_is_a_time_out(
        self, case: DriverCase, peer: Peer, hasty_instrument: Any
    ) -> None:
        case.read(hasty_instrument)
        peer.misbehaviour.start(case.key, "drop")
        failure = failing(case, hasty_instrument)
        assert failure is None or failure.remedy

    def test_it_recovers_from_silence(
        self, case: DriverCase, peer: Peer, hasty_instrument: Any
    ) -> None:
        case.read(hasty_instrument)
        peer.misbehaviour.start(case.key, "drop", replies=1)
        if case.lossy:
            right_or_failing(case, hasty_instrument)
            return
        assert case.right(case.read(hasty_instrument))

    @pytest.mark.parametrize("kind", ["cut", "delay"])
    def test_an_answer_that_comes_in_part_or_late_is_asked_for_again(
        self, case: DriverCase, peer: Peer, hasty_instrument: Any, kind: Any
    ) -> None:
        case.read(hasty_instrument)
        peer.misbehaviour.start(case.key, kind, replies=1, amount=0.45)
        if case.lossy:
            right_or_failing(case, hasty_instrument)
            return
        assert case.right(case.read(hasty_instrument))
        # nor is the late one taken for another's answer
        assert case.right(case.read(hasty_instrument))

    def test_it_connects_again(self, case: DriverCase, peer: Peer, hasty_instrument: Any) -> None:
        case.read(hasty_instrument)
        peer.misbehaviour.start(case.key, "disconnect")
        if case.lossy:
            right_or_failing(case, hasty_instrument)
            return
        assert case.right(case.read(hasty_instrument))

    def test_no_connection_at_all_is_an_error(
        self, case: DriverCase, peer: Peer, hasty_instrument: Any
    ) -> None:
        case.read(hasty_instrument)
        peer.misbehaviour.start(case.key, "disconnect", duration_s=60.0)
        failing(case, hasty_instrument)

    def test_nonsense_is_an_error_or_asked_for_again_and_never_another_exception(
        self, case: DriverCase, peer: Peer, hasty_instrument: Any
    ) -> None:
        case.read(hasty_instrument)
        for _ in range(2):
            peer.misbehaviour.start(case.key, "garble", replies=1)
            try:
                case.read(hasty_instrument)
            except BenchError:  # Modbus has no checksum: a wrong number may also pass
                if case.lossy:
                    return

    def test_many_callers_get_their_own_answers(self, case: DriverCase, instrument: Any) -> None:
        wrong: list[Any] = []

        def ask() -> None:
            try:
                for _ in range(10):
                    answer = case.read(instrument)
                    if not case.right(answer):
                        wrong.append(answer)
            except Exception as error:
                wrong.append(error)

        if case.lossy:  # a stream has one reader
            return
        callers = [threading.Thread(target=ask) for _ in range(6)]
        for caller in callers:
            caller.start()
        for caller in callers:
            caller.join()
        assert wrong == []

    def test_it_closes_twice_and_answers_nobody_afterwards(
        self, case: DriverCase, peer: Peer
    ) -> None:
        opened = open_role(peer.description, case.key)
        opened.close()
        opened.close()
        failing(case, opened)

    def test_a_misspelt_key_is_named(self, case: DriverCase, peer: Peer) -> None:
        section = dict(peer.description.driver[case.key]) | {"adress": "127.0.0.1:1"}
        driver = dict(peer.description.driver) | {case.key: section}
        with pytest.raises(InputError, match=f"driver.{case.key}: adress"):
            open_role(peer.description.model_copy(update={"driver": driver}), case.key)
