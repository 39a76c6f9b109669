"""Reasons to doubt a measurement before it begins: a wrong computer clock, expired standards."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from torquebench.message import Message
from torquebench.records.runs.time_check import expired_standard

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.records import Registry
    from torquebench.station import Station

CALIBRATOR = "calibrator"
VERIFICATION_STANDARD = "verification standard"


def doubts_before(station: Station, registry: Registry, *standards: str) -> Iterator[str]:
    """Yield warnings if the clock is behind the newest record, and if standards have expired.

    Parameters
    ----------
    *standards : str
        Standards that will be used.
    """
    if station.clock_behind:
        yield Message(
            "{behind}; set the clock, otherwise the dates of all new records are wrong",
            station.clock_behind,
        )
    yield from expired_standards(registry, station.description, *standards)


def expired_standards(
    registry: Registry, description: BenchDescription, *standards: str
) -> Iterator[str]:
    """Yield warnings about standards of a bench without a valid certificate."""
    for what in standards:
        standard = (
            description.calibrator if what == CALIBRATOR else description.verification_standard
        )
        doubt = expired_standard(registry, what, standard.serial, standard.certificate_due)
        if doubt:
            yield doubt
