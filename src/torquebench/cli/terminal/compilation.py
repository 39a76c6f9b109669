"""A message while numerical kernels are compiled."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator

from rich.console import Console

from torquebench.cli.terminal.console import is_quiet

_TOLD = "compiling numerical kernels, once after an installation: some 15 s"
_told = False


@contextlib.contextmanager
def telling_compilation(console: Console) -> Iterator[None]:
    """Print once per process that kernels are being compiled, if the output is a terminal."""
    if "numba" not in sys.modules or is_quiet() or not console.is_terminal:
        yield
        return
    from numba.core import event

    class Compiling(event.Listener):
        def on_start(self, event: event.Event) -> None:  # noqa: ARG002 # Numba passes it by name
            global _told
            if not _told:
                _told = True
                console.print(_TOLD, style="dim")

        def on_end(self, event: event.Event) -> None:
            pass

    listener = Compiling()
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
