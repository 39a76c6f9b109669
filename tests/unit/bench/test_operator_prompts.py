import threading

import pytest

from torquebench.bench.drivers.base import OperatorPrompts
from torquebench.bench.prompts import PromptQueue, QueuedOperator
from torquebench.bench.roles import Seating
from torquebench.errors import InterlockError


def asked(prompts, question):
    """Ask on a thread of its own; return the thread and what came of it."""
    outcome = []

    def ask():
        try:
            outcome.append(question())
        except InterlockError as error:
            outcome.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    while prompts.pending is None:
        thread.join(0.001)
    return thread, outcome


def test_the_first_answer_of_two_doors_counts():
    prompts = PromptQueue()
    thread, outcome = asked(prompts, lambda: prompts.ask("Mount the calibrator."))
    number = prompts.pending.number
    assert prompts.answer(number, done=True, who="panel")
    assert not prompts.answer(number, done=False, who="terminal")
    thread.join()
    assert outcome == ["panel"]
    assert prompts.pending is None
    assert not prompts.answer(number, done=True, who="too late")


def test_every_door_hears_every_question_also_one_that_waits_already():
    prompts = PromptQueue()
    heard = {"terminal": threading.Event(), "panel": threading.Event()}
    with prompts.watching(lambda _prompt: heard["terminal"].set()):
        thread, _ = asked(prompts, lambda: prompts.ask("Rotate to 120°."))
        with prompts.watching(lambda _prompt: heard["panel"].set()):
            assert all(event.wait(120.0) for event in heard.values())
        prompts.answer(prompts.pending.number, done=True)
        thread.join()


def test_who_declines_is_named():
    prompts = PromptQueue()
    thread, outcome = asked(prompts, lambda: prompts.ask("Mount the calibrator."))
    prompts.answer(prompts.pending.number, done=False, who="Ana")
    thread.join()
    assert "Ana declined: Mount the calibrator." in str(outcome[0])


def test_a_run_that_ends_gives_up_waiting():
    operator = QueuedOperator(PromptQueue())
    thread, outcome = asked(operator.prompts, lambda: operator.mount("calibrator"))
    operator.cancel()
    thread.join()
    assert isinstance(outcome[0], InterlockError)
    assert operator.mounted() == "nothing"
    operator.cancel()  # nothing waits any more


def test_a_second_question_is_refused_while_one_waits():
    prompts = PromptQueue()
    thread, _ = asked(prompts, lambda: prompts.ask("first"))
    with pytest.raises(InterlockError, match="while another one is open"):
        prompts.ask("second")
    prompts.cancel()
    thread.join()


def test_the_operator_of_a_real_bench_is_asked_in_whole_sentences():
    prompts = PromptQueue()
    said = []

    def confirm(prompt):
        said.append(prompt.text)
        prompts.answer(prompt.number, done=True)

    operator = QueuedOperator(prompts)
    assert isinstance(operator, OperatorPrompts)
    with prompts.watching(confirm):
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
