"""Progress: bars at a terminal, plain lines elsewhere."""

import io

from numba import njit
from rich.console import Console

from torquebench.cli.terminal.progress import TerminalProgress


def test_plain_where_nobody_looks() -> None:
    console = Console(file=io.StringIO(), width=80)
    with TerminalProgress(console) as progress:
        progress.start("Calibrating the input module", 200)
        progress.reach(200)
        progress.start("Fitting")
        progress.finish("4 models")
    text = console.file.getvalue()
    assert text.startswith("Calibrating the input module (200)\n")
    assert "Fitting: 4 models" in text
    assert "\x1b" not in text


def test_bars_stay_within_80_columns() -> None:
    console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system=None)
    with TerminalProgress(console) as progress:
        progress.start("No-load friction of the reducer", 162)
        progress.reach(80, "repeat 2")
        progress.finish()
    visible = console.file.getvalue().replace("\r", "\n").split("\n")
    assert any("162/162" in line for line in visible)


def test_an_error_gives_the_terminal_back() -> None:
    console = Console(file=io.StringIO(), width=80, force_terminal=True)
    try:
        with TerminalProgress(console) as progress:
            progress.start("Working", 10)
            raise RuntimeError
    except RuntimeError:
        pass
    assert console.file.getvalue().endswith(("\x1b[?25h", "\n"))


def test_a_wait_for_compilation_is_explained_once() -> None:
    console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system=None)
    with TerminalProgress(console) as progress:
        progress.start("Fitting", 2)
        for function in (lambda x: x + 1, lambda x: x - 1):
            njit(function)(1.0)
    assert console.file.getvalue().count("compiling numerical kernels") == 1
    plain = Console(file=io.StringIO(), width=80)
    with TerminalProgress(plain):
        njit(lambda x: 2 * x)(1.0)
    assert "compiling" not in plain.file.getvalue()
