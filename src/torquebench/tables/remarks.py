"""The standard and its uncertainty in a calibration table's comments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.chain import Reference

UNCERTAINTY = "reference_uncertainty"
"""Comment with U (k = 2) of the standard, in the form of `CertifiedUncertainty.of_text`."""
_NAME = "reference"
_LIMITS = {
    "reference_temperature_percent": "temperature_of_torque",
    "reference_drift_percent": "drift_of_torque",
}
"""Comments with limits in % of the torque, and the fields of a `Reference`."""


def reference_remarks(reference: Reference | None) -> dict[str, str]:
    """Return comments that state a standard.

    Examples
    --------
    >>> from torquebench.chain import Reference
    >>> from torquebench.uncertainty import CertifiedUncertainty
    >>> standard = Reference("certificate 7 of R-9", CertifiedUncertainty.of_torque(2e-4), 1e-4)
    >>> for name, value in reference_remarks(standard).items():
    ...     print(name, "=", value)
    reference = certificate 7 of R-9
    reference_uncertainty = 1.0: 0.0002
    reference_temperature_percent = 0.01
    """
    if reference is None:
        return {}
    limits = {name: getattr(reference, field) for name, field in _LIMITS.items()}
    return {
        _NAME: str(reference.record),
        UNCERTAINTY: reference.certified.text,
        **{name: repr(1e2 * limit) for name, limit in limits.items() if limit is not None},
    }


def reference_in(remarks: Mapping[str, str], range_nm: float, origin: str) -> Reference | None:
    """Return the standard in a table's comments; None if they state no uncertainty.

    Parameters
    ----------
    remarks : mapping of str to str
    range_nm : float
        Full scale of the table, N·m.
    origin : str
        Name of the table in messages.

    Raises
    ------
    InputError
        A comment can't be parsed as an uncertainty.
    """
    stated = remarks.get(UNCERTAINTY)
    if stated is None:
        return None
    from torquebench.chain import Reference  # imported late: it is heavy
    from torquebench.uncertainty import CertifiedUncertainty

    try:
        certified = CertifiedUncertainty.of_text(stated, range_nm)
    except InputError as error:
        raise InputError(
            Message("{origin}: the comment says {name} = {stated!r}", origin, UNCERTAINTY, stated),
            error.allowed,
            "correct the comment",
        ) from error
    limits = {field: _limit(remarks, name, origin) for name, field in _LIMITS.items()}
    return Reference(remarks.get(_NAME) or f"stated in {origin}", certified, **limits)


def _limit(remarks: Mapping[str, str], name: str, origin: str) -> float | None:
    stated = remarks.get(name)
    if stated is None:
        return None
    try:
        percent = float(stated)
    except ValueError:
        percent = -1.0
    if not 0.0 <= percent <= 100.0:
        raise InputError(
            Message("{origin}: the comment says {name} = {stated!r}", origin, name, stated),
            "0 to 100 % of the torque",
            "correct the comment",
        )
    return 1e-2 * percent
