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
    from torquebench.bench.roles import Side
    from torquebench.calibration import Profile
    from torquebench.procedures.turning.profile import TurningProfile

__all__ = ["confirm_start", "confirm_turn"]


def confirm_start(description: BenchDescription, side: str, profile: Profile, yes: bool) -> None:
    """Ask before a profile loads a module."""
    what = f"{side} will be loaded to ±{profile.largest_percent:g} % of range by {profile.name}"
    _confirm(description, what, yes)


def confirm_turn(
    description: BenchDescription, side: Side, profile: TurningProfile, yes: bool
) -> None:
    """Ask before a shaft turns, or is loaded at rest."""
    if profile.kind == "dynamics":
        largest = profile.largest_share * description.module(side).range_nm
        said = f"will be loaded with up to {largest:g} N·m in steps, at rest"
    else:
        said = f"will turn at up to {profile.top_rpm(side):g} rpm"
    _confirm(description, f"{side} {said} by {profile.name}", yes, "start")


def _confirm(description: BenchDescription, what: str, yes: bool, then: str = "be loaded") -> None:
    if yes or description.simulated:
        return
    if not sys.stdin.isatty():
        raise InputError(
            Message("{name} is a real bench and nobody is there to confirm", description.name),
            "a person at the terminal, or --yes",
            "check that nobody is at the bench, then give --yes",
        )
    stderr_console().print(f"{description.name}: {what}.", markup=False)
    if not typer.confirm(f"Is the bench clear and may it {then}?", err=True):
        raise typer.Exit(1)
