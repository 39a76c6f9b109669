import time

import pytest

from torquebench.errors import InputError
from torquebench.simulators import KINDS, Misbehaviour

ANSWER = bytes(range(40))


@pytest.fixture
def orders() -> Misbehaviour:
    found = Misbehaviour(seed=7)
    found.endpoint("drive")
    return found


def test_without_orders_every_answer_passes(orders: Misbehaviour) -> None:
    assert orders.endpoint("drive").outgoing(ANSWER) == ANSWER


def test_answers_are_dropped_cut_and_garbled_as_often_as_ordered(orders: Misbehaviour) -> None:
    faults = orders.endpoint("drive")
    orders.start("drive", "drop", replies=2)
    assert [faults.outgoing(ANSWER) for _ in range(3)] == [None, None, ANSWER]
    orders.start("drive", "cut", replies=1)
    assert [faults.outgoing(ANSWER) for _ in range(2)] == [ANSWER[:20], ANSWER]
    orders.start("drive", "garble", replies=1)
    spoilt = faults.outgoing(ANSWER)
    assert spoilt is not None
    assert len(spoilt) == len(ANSWER)
    assert spoilt != ANSWER
    assert faults.outgoing(ANSWER) == ANSWER


def test_the_same_seed_garbles_the_same_bytes() -> None:
    def garbled() -> bytes | None:
        orders = Misbehaviour(seed=3)
        faults = orders.endpoint("drive")
        orders.start("drive", "garble", replies=1)
        return faults.outgoing(ANSWER)

    assert garbled() == garbled()


def test_a_delay_is_as_long_as_ordered(orders: Misbehaviour) -> None:
    orders.start("drive", "delay", amount=0.05, replies=1)
    started = time.monotonic()
    assert orders.endpoint("drive").outgoing(ANSWER) == ANSWER
    assert time.monotonic() - started >= 0.05


def test_states_last_until_they_are_healed_or_over(orders: Misbehaviour) -> None:
    faults = orders.endpoint("drive")
    for kind in ("freeze", "lie"):
        orders.start("drive", kind)
    assert faults.frozen
    assert faults.lying
    orders.heal("drive")
    assert not faults.frozen
    orders.start("drive", "freeze", duration_s=0.01)
    time.sleep(0.02)
    assert not faults.frozen


def test_a_disconnection_closes_what_is_open_once(orders: Misbehaviour) -> None:
    closed: list[bool] = []
    faults = orders.endpoint("drive")
    faults.disconnect = lambda: closed.append(True)
    orders.start("drive", "disconnect")
    assert closed == [True]
    assert not faults.refusing
    orders.start("drive", "disconnect", replies=1)
    assert [faults.refusing, faults.refusing] == [True, False]


def test_commands_are_ignored_and_requests_refused_as_often_as_ordered(
    orders: Misbehaviour,
) -> None:
    faults = orders.endpoint("drive")
    orders.start("drive", "ignore", replies=1)
    orders.start("drive", "busy", replies=1)
    assert [faults.ignoring, faults.ignoring, faults.busy, faults.busy] == [True, False] * 2
    assert faults.slowness_s == 0.0
    orders.start("drive", "slow", amount=0.2)
    assert faults.slowness_s == 0.2
    orders.heal()
    assert faults.slowness_s == 0.0


def test_scale_and_age_have_the_amount_that_was_ordered(orders: Misbehaviour) -> None:
    faults = orders.endpoint("drive")
    assert (faults.scale, faults.age_s()) == (1.0, 0.0)
    orders.start("drive", "scale")
    assert faults.scale == 1.03
    orders.start("drive", "jitter", amount=0.2)
    ages = [faults.age_s() for _ in range(20)]
    assert 0.0 <= min(ages) < max(ages) <= 0.2


def test_two_roles_of_one_instrument_misbehave_together(orders: Misbehaviour) -> None:
    orders.alias("clamp", "drive")
    orders.start("clamp", "drop")
    assert orders.endpoint("drive").outgoing(ANSWER) is None
    orders.heal()
    assert not any(orders.endpoint("drive").active(kind) for kind in KINDS)


@pytest.mark.parametrize(
    ("endpoint", "kind", "keys"),
    [
        ("nobody", "drop", {}),
        ("drive", "explode", {}),
        ("drive", "drop", {"replies": 0}),
        ("drive", "delay", {"amount": -1.0}),
        ("drive", "delay", {"amount": float("nan")}),
        ("drive", "scale", {"amount": 100.0}),
        ("drive", "drop", {"duration_s": float("nan")}),
    ],
)
def test_orders_that_nobody_can_follow_are_refused(
    orders: Misbehaviour, endpoint: str, kind: str, keys: dict[str, float]
) -> None:
    with pytest.raises(InputError):
        orders.start(endpoint, kind, **keys)  # type: ignore[arg-type]
