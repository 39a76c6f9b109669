"""Warnings of commands about implausible times: this computer's clock, expired standards."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from torquebench.cli.terminal.console import warn

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.records import Registry
    from torquebench.station import Station

__all__ = ["CALIBRATOR", "VERIFICATION_STANDARD", "expired_standards", "tell_doubts"]

CALIBRATOR = "calibrator"
VERIFICATION_STANDARD = "verification standard"


def tell_doubts(station: Station, *standards: str) -> None:
    """Warn of a clock earlier than the newest record, and of expired standards, before use.

    Parameters
    ----------
    station : Station
        Just opened.
    *standards : str
        Those that the command measures against.
    """
    if station.clock_behind:
        warn(f"{station.clock_behind}; set the clock, or every date of what follows is wrong")
    for doubt in expired_standards(station.registry, station.description, *standards):
        warn(doubt)


def expired_standards(
    registry: Registry, description: BenchDescription, *standards: str
) -> Iterator[str]:
    """Yield warnings about standards of a bench without a valid certificate."""
    from torquebench.records.runs.time_check import expired_standard

    for what in standards:
        standard = (
            description.calibrator if what == CALIBRATOR else description.verification_standard
        )
        said = expired_standard(registry, what, standard.serial, standard.certificate_due)
        if said:
            yield said
