"""Messages of commands about a measuring chain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torquebench.cli.console import say

if TYPE_CHECKING:
    from torquebench.chain import MeasuringChain

__all__ = ["tell_missing"]


def tell_missing(chain: MeasuringChain) -> None:
    """List the influences that U doesn't contain, because nothing is recorded of them."""
    missing = chain.missing()
    if missing:
        say("not in U, because no record exists: " + ", ".join(missing))
