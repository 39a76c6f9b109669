"""Messages of commands about a measuring chain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torquebench.cli.console import say

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["tell_missing"]


def tell_missing(missing: Sequence[str]) -> None:
    """List the influences that U doesn't contain, because nothing is recorded of them."""
    if missing:
        say("not in U, because no record exists: " + ", ".join(missing))
