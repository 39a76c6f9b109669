"""Messages of commands about a measuring chain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torquebench.cli.terminal.console import say

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["tell_missing"]


def tell_missing(missing: Sequence[str]) -> None:
    """List the influences that U doesn't contain, because nothing is recorded of them."""
    from torquebench.chain import not_in_u

    sentence = not_in_u(missing)
    if sentence is not None:
        say(sentence)
