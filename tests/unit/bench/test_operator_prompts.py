import threading

import pytest

from torquebench.bench.drivers.base import OperatorPrompts, Seating
from torquebench.bench.prompts import DeskOperator, PromptDesk
from torquebench.errors import InterlockError


def asked(desk, question):
    """Ask on a thread of its own; return the thread and what came of it."""
    outcome = []

    def ask():
        try:
            outcome.append(question())
        except InterlockError as error:
            outcome.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    while desk.pending is None:
        thread.join(0.001)
    return thread, outcome


def test_the_first_answer_of_two_doors_counts():
    desk = PromptDesk()
    thread, outcome = asked(desk, lambda: desk.ask("Mount the calibrator."))
    number = desk.pending.number
    assert desk.answer(number, done=True, who="panel")
    assert not desk.answer(number, done=False, who="terminal")
    thread.join()
    assert outcome == ["panel"]
    assert desk.pending is None
    assert not desk.answer(number, done=True, who="too late")


def test_every_door_hears_every_question_also_one_that_waits_already():
    desk = PromptDesk()
    heard = {"terminal": threading.Event(), "panel": threading.Event()}
    with desk.watching(lambda _prompt: heard["terminal"].set()):
        thread, _ = asked(desk, lambda: desk.ask("Rotate to 120°."))
        with desk.watching(lambda _prompt: heard["panel"].set()):
            assert all(event.wait(10.0) for event in heard.values())
        desk.answer(desk.pending.number, done=True)
        thread.join()


def test_who_declines_is_named():
    desk = PromptDesk()
    thread, outcome = asked(desk, lambda: desk.ask("Mount the calibrator."))
    desk.answer(desk.pending.number, done=False, who="Ana")
    thread.join()
    assert "Ana declined: Mount the calibrator." in str(outcome[0])


def test_a_run_that_ends_gives_up_waiting():
    operator = DeskOperator(PromptDesk())
    thread, outcome = asked(operator.desk, lambda: operator.mount("calibrator"))
    operator.cancel()
    thread.join()
    assert isinstance(outcome[0], InterlockError)
    assert operator.mounted() == "nothing"
    operator.cancel()  # nothing waits any more


def test_a_second_question_is_refused_while_one_waits():
    desk = PromptDesk()
    thread, _ = asked(desk, lambda: desk.ask("first"))
    with pytest.raises(InterlockError, match="while another one waits"):
        desk.ask("second")
    desk.cancel()
    thread.join()


def test_the_operator_of_a_real_bench_is_asked_in_whole_sentences():
    desk = PromptDesk()
    said = []

    def confirm(prompt):
        said.append(prompt.text)
        desk.answer(prompt.number, done=True)

    operator = DeskOperator(desk)
    assert isinstance(operator, OperatorPrompts)
    with desk.watching(confirm):
        operator.mount("verification_standard")
        operator.seat(Seating("rotation", 120.0))
        operator.seat(Seating("re-seat", 0.0))
        operator.mount("nothing")
    assert said == [
        "Mount the verification standard between the flanges.",
        "Rotate the verification standard to 120° and seat it again.",
        "Take the verification standard out and seat it again at 0°.",
        "Take the verification standard out of the bench.",
    ]
    assert operator.mounted() == "nothing"
