import os
import pty
import sys
import termios
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from torquebench.cli.terminal.presence import attending
from torquebench.cli.terminal.progress import TerminalProgress
from torquebench.errors import InputError, InterlockError


class Bench:
    """As much of a station as the keys touch."""

    def __init__(self, presence_s: float) -> None:
        self.description = SimpleNamespace(
            name="Bench 1", safety=SimpleNamespace(presence_s=presence_s)
        )
        self.supervisor = self.heartbeats = self
        self.confirmed: list[str] = []

    def confirm_presence(self, who: str) -> None:
        self.confirmed.append(who)


@pytest.fixture
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("TORQUEBENCH_OPERATOR", "Ana")
    keyboard, screen = pty.openpty()
    with os.fdopen(screen, "r", encoding="utf-8") as file:
        monkeypatch.setattr(sys, "stdin", file)
        yield keyboard
    if keyboard is not None:
        os.close(keyboard)


def wait_for(condition: Any) -> None:
    deadline = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def echoes() -> bool:
    return bool(termios.tcgetattr(sys.stdin.fileno())[3] & termios.ECHO)


def test_keys_and_answers_confirm_and_questions_have_the_keyboard(keyboard: int) -> None:
    bench, progress = Bench(presence_s=60.0), TerminalProgress()
    os.write(keyboard, b"x")
    with attending(bench, progress):  # type: ignore[arg-type]
        assert bench.confirmed == ["Ana"]
        assert not echoes()
        os.write(keyboard, b" ")
        wait_for(lambda: len(bench.confirmed) == 2)
        progress.pause()
        assert echoes()
        os.write(keyboard, b"done\n")
        assert sys.stdin.readline() == "done\n"
        assert len(bench.confirmed) == 2
        progress.resume(answered=True)
        assert len(bench.confirmed) == 3
        progress.pause()
        progress.resume(answered=False)  # somebody has answered elsewhere
        assert len(bench.confirmed) == 3
        assert not echoes()
    assert echoes()


def test_who_is_silent_is_reminded_once(keyboard: int, capsys: Any) -> None:
    bench = Bench(presence_s=0.3)
    os.write(keyboard, b"x")
    with attending(bench, TerminalProgress()):  # type: ignore[arg-type]
        said: list[str] = []
        wait_for(lambda: said.append(capsys.readouterr().err) or "there?" in "".join(said))
        time.sleep(0.3)
    said.append(capsys.readouterr().err)
    assert "".join(said).count("Are you there?") == 1
    assert bench.confirmed == ["Ana"]


def test_a_bench_that_asks_for_nobody_leaves_the_keyboard_alone(keyboard: int) -> None:
    with attending(Bench(presence_s=0.0), TerminalProgress()):  # type: ignore[arg-type]
        assert echoes()


def test_without_a_terminal_it_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with Path(os.devnull).open(encoding="utf-8") as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        with (
            pytest.raises(InputError, match="there is no terminal"),
            attending(Bench(presence_s=5.0), TerminalProgress()),  # type: ignore[arg-type]
        ):
            raise AssertionError


@pytest.mark.parametrize("at_once", [True, False])
def test_a_terminal_that_goes_before_anybody_came_ends_it(
    monkeypatch: pytest.MonkeyPatch, at_once: bool
) -> None:
    keyboard, screen = pty.openpty()
    with os.fdopen(screen, "r", encoding="utf-8") as file:
        monkeypatch.setattr(sys, "stdin", file)
        leaving = threading.Timer(0.2, lambda: os.close(keyboard))

        def asked() -> bool:  # it goes after it was seen to be a terminal
            leaving.run() if at_once else leaving.start()
            return True

        monkeypatch.setattr(file, "isatty", asked)
        with (
            pytest.raises(InterlockError, match="terminal was closed"),
            attending(Bench(presence_s=5.0), TerminalProgress()),  # type: ignore[arg-type]
        ):
            raise AssertionError
        if not at_once:
            leaving.join()
