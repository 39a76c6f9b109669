from collections.abc import Generator, Iterator

import bluesky.plan_stubs as bps
import pytest
from bluesky.utils import Msg, Plan
from ophyd_async.core import soft_signal_rw

from torquebench.procedures.messages import (
    Stub,
    again_after_pause,
    checkpoint,
    leg_checkpoint,
    move,
    prepare,
    read,
    sleep,
)

SIGNAL = soft_signal_rw(float, name="signal")


def sent(messages: object) -> list[tuple[object, ...]]:
    assert not isinstance(messages, Plan)  # which formats a stack trace
    return [(each.command, each.obj, each.args) for each in messages]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("own", "stub", "arguments"),
    [
        (checkpoint, bps.checkpoint, ()),
        (sleep, bps.sleep, (1.5,)),
        (read, bps.rd, (SIGNAL,)),
        (prepare, bps.prepare, (SIGNAL, 3.0)),
        (move, bps.mv, (SIGNAL, 2.0)),
    ],
)
def test_the_messages_are_those_of_the_stubs(
    own: Stub, stub: Stub, arguments: tuple[object, ...]
) -> None:
    assert sent(own(*arguments)) == sent(iter(stub(*arguments)))


def test_several_devices_move_together() -> None:
    other = soft_signal_rw(float, name="other")
    messages: list[Msg] = list(move(SIGNAL, 1.0, other, 2.0))
    assert [(each.command, each.obj, each.args) for each in messages] == [
        ("set", SIGNAL, (1.0,)),
        ("set", other, (2.0,)),
        ("wait", None, ()),
    ]
    assert len({each.kwargs["group"] for each in messages}) == 1


def driven(plan: object, held: list[int]) -> list[object]:
    """Run a plan whose checkpoints of these numbers hold; return its messages and its result."""
    messages: list[object] = []
    checkpoints, answer = 0, None
    while True:
        try:
            message = plan.send(answer)  # type: ignore[attr-defined]
        except StopIteration as end:
            return [*messages, end.value]
        answer = None
        if message.command == "checkpoint":
            answer = checkpoints in held
            checkpoints += 1
        else:
            messages.append(message.command)


def restored() -> Iterator[Msg]:
    yield Msg("restore")


def half_loop() -> Generator[Msg, object, str]:
    yield Msg("up")
    yield from leg_checkpoint()
    yield Msg("down")
    return "loop"


@pytest.mark.parametrize(
    ("held", "messages"),
    [
        ([], ["up", "down"]),
        ([0], ["restore", "up", "down"]),
        ([1], ["up", "restore", "up", "down"]),
        ([0, 1, 2], ["restore", "up", "restore", "up", "restore", "up", "down"]),
    ],
)
def test_a_leg_begins_again_after_a_pause_from_where_it_began(
    held: list[int], messages: list[str]
) -> None:
    assert driven(again_after_pause(half_loop, restored), held) == [*messages, "loop"]
    without = [message for message in messages if message != "restore"]
    assert driven(again_after_pause(half_loop), held) == [*without, "loop"]
