import os
import pty
import sys
import threading
import time

import pytest

from torquebench.bench.prompts import PromptQueue
from torquebench.cli.terminal.progress import TerminalProgress
from torquebench.cli.terminal.prompts import answering
from torquebench.errors import InterlockError

NOBODY_ANSWERS_S = 30.0


@pytest.fixture
def prompts():
    """Questions; one that nobody answers is declined, so that a test fails and doesn't hang."""
    queue = PromptQueue()
    patience = threading.Timer(NOBODY_ANSWERS_S, queue.cancel)
    patience.start()
    yield queue
    patience.cancel()
    patience.join()


@pytest.fixture
def terminal(monkeypatch):
    """A terminal in place of the standard input; the other end of it types."""
    keyboard, screen = pty.openpty()
    with os.fdopen(screen, "r", encoding="utf-8") as file:
        monkeypatch.setattr(sys, "stdin", file)
        yield keyboard
    os.close(keyboard)


def test_yes_confirms_without_asking(prompts):
    with answering(prompts, TerminalProgress(), yes=True):
        assert prompts.ask("Mount the calibrator.") == "--yes"


def test_without_a_terminal_nobody_confirms(prompts):
    with (
        answering(prompts, TerminalProgress(), yes=False),
        pytest.raises(InterlockError, match="nobody is at the terminal"),
    ):
        prompts.ask("Mount the calibrator.")


def test_a_person_at_the_terminal_is_asked_until_the_answer_is_clear(
    terminal, prompts, monkeypatch, capsys
):
    monkeypatch.setenv("TORQUEBENCH_OPERATOR", "Ana")
    with answering(prompts, TerminalProgress(), yes=False):
        os.write(terminal, b"what?\ndone\n")
        assert prompts.ask("Rotate the calibrator to 120°.") == "Ana"
        os.write(terminal, b"a\n")
        with pytest.raises(InterlockError, match="Ana declined"):
            prompts.ask("Mount the calibrator.")
    assert "Rotate the calibrator to 120°. [d]one or [a]bort?" in capsys.readouterr().err


def test_an_answer_from_another_door_ends_the_question_here(terminal, prompts, capsys):
    def panel(prompt):
        time.sleep(0.3)
        prompts.answer(prompt.number, done=True, who="panel")

    with answering(prompts, TerminalProgress(), yes=False), prompts.watching(panel):
        assert prompts.ask("Mount the calibrator.") == "panel"
    shown, deadline = "", time.monotonic() + NOBODY_ANSWERS_S
    while "answered elsewhere" not in shown and time.monotonic() < deadline:
        time.sleep(0.05)
        shown += capsys.readouterr().err
    assert "Mount the calibrator. [d]one or [a]bort? answered elsewhere" in shown
