import pytest

from torquebench.panel.service import Actor, LeaseError
from torquebench.panel.service.access.lease import IDLE_S, PROGRAM_IDLE_S, CommandLease

ANA = Actor("Ana", "operator", "a1")
ANA_AGAIN = Actor("Ana", "operator", "a2")
BEN = Actor("Ben", "metrologist", "b1")
CYD = Actor("Cyd", "operator", "c1")
ADA = Actor("Ada", "administrator", "d1")
PLANT = Actor("Ana", "operator", "client-1", "client")


class Bench:
    def __init__(self) -> None:
        self.now = 0.0
        self.working = False
        self.gone: set[str] = set()
        self.said: list[str] = []
        self.lease = CommandLease(
            lambda actor, what: self.said.append(f"{actor.label} {what}"),
            lambda actor: actor.session_id not in self.gone,
            lambda: self.working,
            lambda: self.now,
        )


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_one_commands_and_the_others_watch(bench: Bench) -> None:
    with pytest.raises(LeaseError, match="nobody is in command"):
        bench.lease.require(ANA)
    bench.lease.take(ANA)
    bench.lease.require(ANA)
    with pytest.raises(LeaseError, match="Ana is in command"):
        bench.lease.require(BEN)
    with pytest.raises(LeaseError):
        bench.lease.take(CYD)
    bench.lease.give_back(CYD)
    assert bench.lease.holds(ANA)
    bench.lease.give_back(ANA)
    bench.lease.take(CYD)
    assert bench.said == [
        "Ana took the command",
        "Ana gave up command",
        "Cyd took the command",
    ]


def test_who_idles_loses_it_to_whoever_wants_it_unless_something_runs(bench: Bench) -> None:
    bench.lease.take(ANA)
    bench.now += IDLE_S + 1
    bench.working = True
    assert not bench.lease.may_take(CYD)[0]
    bench.working = False
    bench.lease.take(CYD)
    assert bench.lease.holds(CYD)


def test_a_program_that_died_gives_it_back_but_not_during_its_work(bench: Bench) -> None:
    bench.lease.take(PLANT)
    bench.now += PROGRAM_IDLE_S - 1
    bench.lease.require(PLANT)
    bench.now += PROGRAM_IDLE_S - 1
    assert bench.lease.holds(PLANT)
    bench.working = True
    bench.now += 10 * IDLE_S
    assert bench.lease.holds(PLANT)
    bench.working = False
    bench.now += PROGRAM_IDLE_S - 1
    assert not bench.lease.may_take(CYD)[0]
    bench.now += 2
    assert bench.lease.state().holder is None
    bench.lease.take(CYD)
    assert bench.said == [
        f"{PLANT.label} took the command",
        f"{PLANT.label} gave up command",
        "Cyd took the command",
    ]


def test_commanding_keeps_it(bench: Bench) -> None:
    bench.lease.take(ANA)
    bench.now += IDLE_S - 1
    bench.lease.require(ANA)
    bench.now += IDLE_S - 1
    assert not bench.lease.may_take(CYD)[0]


def test_a_session_that_has_ended_commands_nothing(bench: Bench) -> None:
    bench.lease.take(ANA)
    bench.gone.add(ANA.session_id)
    assert bench.lease.state().holder is None
    bench.lease.take(CYD)


def test_the_same_person_takes_it_along_but_a_program_of_that_name_does_not(bench: Bench) -> None:
    bench.lease.take(ANA)
    with pytest.raises(LeaseError):
        bench.lease.take(PLANT)
    bench.lease.take(ANA_AGAIN)
    assert not bench.lease.holds(ANA)


@pytest.mark.parametrize(
    ("holder", "taker", "works"),
    [(ANA, BEN, True), (ANA, CYD, False), (ADA, BEN, False), (BEN, ADA, True)],
)
def test_force_needs_a_role_that_is_not_below_the_holders(
    bench: Bench, holder: Actor, taker: Actor, works: bool
) -> None:
    bench.lease.take(holder)
    if works:
        bench.lease.take(taker, force=True)
    else:
        with pytest.raises(LeaseError):
            bench.lease.take(taker, force=True)
    assert bench.lease.holds(taker) is works


def test_no_program_takes_a_running_bench_out_of_a_persons_hands(bench: Bench) -> None:
    program = Actor("line", "administrator", "line-1", "client")
    bench.lease.take(ANA)
    bench.working = True
    with pytest.raises(LeaseError, match="Ana is in command"):
        bench.lease.take(program, force=True)
    bench.lease.take(ADA, force=True)  # a person may
    bench.working = False
    bench.lease.take(program, force=True)
    assert bench.lease.holds(program)
