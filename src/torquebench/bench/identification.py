"""Check before any movement that the instruments are those of the description."""

from __future__ import annotations

from collections.abc import Iterable

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import Identity
from torquebench.errors import BenchError
from torquebench.message import Message

__all__ = ["check_identities"]


def check_identities(description: BenchDescription, identities: Iterable[Identity]) -> None:
    """Compare the serial numbers that instruments report with those of the description.

    Parameters
    ----------
    description : BenchDescription
    identities : iterable of Identity
        Identities stated by the instruments. Roles without a serial number in the description (a
        read-out) aren't compared, nor instruments that state none.

    Raises
    ------
    BenchError
        An instrument is another one than described: limits and calibrations would be wrong.
    """
    for identity in identities:
        described = description.serials.get(identity.role)
        if described is not None and identity.serial not in ("", described):
            raise BenchError(
                Message(
                    "{role}: {manufacturer} {model} answers with serial {serial!r}",
                    identity.role,
                    identity.manufacturer,
                    identity.model,
                    identity.serial,
                ),
                Message("serial {described!r}, as described", described),
                "connect the described instrument or correct the bench description",
            )
