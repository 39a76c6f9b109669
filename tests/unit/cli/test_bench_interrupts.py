"""Ctrl-C while a plan runs, and the question of a pause."""

import io
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console

from torquebench.cli.terminal.interrupts import BenchInterrupts
from torquebench.cli.terminal.progress import TerminalProgress
from torquebench.station import Station


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    with Station.open(None, tmp_path) as opened:
        yield opened


@pytest.fixture
def interrupts(station: Station) -> BenchInterrupts:
    return BenchInterrupts(station, TerminalProgress(Console(file=io.StringIO())))


def test_without_a_terminal_ctrl_c_aborts(interrupts: BenchInterrupts, station: Station) -> None:
    assert not interrupts.interactive
    assert station.interrupt_action == "abort"


def test_ctrl_c_reaches_the_station_as_a_keyboard_interrupt(interrupts: BenchInterrupts) -> None:
    before = signal.getsignal(signal.SIGTERM)
    with interrupts.watching(), pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
    assert interrupts.signal == signal.SIGINT
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize(
    ("typed", "answer"),
    [("r\n", "resume"), ("maybe\nresume\n", "resume"), ("a\n", "abort"), ("", "abort")],
)
def test_the_question_is_asked_until_it_is_answered(
    typed: str,
    answer: str,
    interrupts: BenchInterrupts,
    station: Station,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
    assert interrupts.ask(station) == answer
