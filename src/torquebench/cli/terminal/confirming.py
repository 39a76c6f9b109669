"""Ask for confirmation at a terminal before a real bench is loaded."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import typer

from torquebench.cli.terminal.console import stderr_console
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.calibration import Profile


def confirm_start(description: BenchDescription, side: str, profile: Profile, yes: bool) -> None:
    """Ask before a profile loads a module."""
    if yes or description.simulated:
        return
    if not sys.stdin.isatty():
        raise InputError(
            Message("{name} is a real bench and nobody is there to confirm", description.name),
            "a person at the terminal, or --yes",
            "check that nobody is at the bench, then give --yes",
        )
    largest = f"±{profile.largest_percent:g} % of range by {profile.name}"
    stderr_console().print(f"{description.name}: {side} will be loaded to {largest}.", markup=False)
    if not typer.confirm("Is the bench clear and may it be loaded?", err=True):
        raise typer.Exit(1)
