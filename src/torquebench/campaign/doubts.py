"""What makes a measurement doubtful before it begins: this computer's clock, expired standards."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from torquebench.message import Message
from torquebench.records.runs.time_check import expired_standard

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.records import Registry
    from torquebench.station import Station

__all__ = ["CALIBRATOR", "VERIFICATION_STANDARD", "doubts_before", "expired_standards"]

CALIBRATOR = "calibrator"
VERIFICATION_STANDARD = "verification standard"


def doubts_before(station: Station, registry: Registry, *standards: str) -> Iterator[str]:
    """Yield that the clock is earlier than the newest record, and that standards have expired.

    Parameters
    ----------
    station : Station
    registry : Registry
    *standards : str
        Those that are measured against.
    """
    if station.clock_behind:
        yield Message(
            "{behind}; set the clock, or every date of what follows is wrong", station.clock_behind
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
        said = expired_standard(registry, what, standard.serial, standard.certificate_due)
        if said:
            yield said
