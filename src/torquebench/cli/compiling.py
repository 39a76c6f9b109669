"""A word about the one wait that only follows an installation: kernels are compiled."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator

from rich.console import Console

from torquebench.cli.console import is_quiet

__all__ = ["telling_compilation"]

_TOLD = "compiling numerical kernels, once after an installation: some 20 s"
_told = False


@contextlib.contextmanager
def telling_compilation(console: Console) -> Iterator[None]:
    """Say once in a process that kernels are compiled, if somebody looks at the terminal."""
    if "numba" not in sys.modules or is_quiet() or not console.is_terminal:
        yield
        return
    from numba.core import event

    class Compiling(event.Listener):
        def on_start(self, _: object) -> None:
            global _told
            if not _told:
                _told = True
                console.print(_TOLD, style="dim")

        def on_end(self, _: object) -> None:
            pass

    listener = Compiling()
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
