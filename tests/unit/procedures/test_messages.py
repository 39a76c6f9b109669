import bluesky.plan_stubs as bps
import pytest
from bluesky.utils import Msg, Plan
from ophyd_async.core import soft_signal_rw

from torquebench.procedures.messages import Stub, checkpoint, move, prepare, read, sleep

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
