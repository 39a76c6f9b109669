"""Errors of torquebench; each message says what was found, what is allowed and what to do."""

from torquebench.message import Message

__all__ = [
    "BenchError",
    "InputError",
    "InterlockError",
    "LimitError",
    "ModelMismatchError",
    "RecordError",
    "SignalFault",
    "TorquebenchError",
]


class TorquebenchError(Exception):
    """Base of all errors that torquebench raises deliberately.

    Parameters
    ----------
    found : str
        What was found, with its value and unit; a `Message` if it contains values.
    allowed : str, optional
        What would have been allowed, with its limit and unit.
    remedy : str, optional
        What the user can do about it.

    Examples
    --------
    >>> str(TorquebenchError("range 0 N·m", "a range above 0 N·m", "give --range 2000"))
    'range 0 N·m; allowed: a range above 0 N·m; give --range 2000'
    """

    def __init__(self, found: str, allowed: str = "", remedy: str = "") -> None:
        self.found = found
        self.allowed = allowed
        self.remedy = remedy
        parts = (found, Message("allowed: {allowed}", allowed) if allowed else "", remedy)
        super().__init__(Message.joined((part for part in parts if part), "; "))

    def __reduce__(self) -> tuple[type, tuple[str, str, str]]:
        return (type(self), (self.found, self.allowed, self.remedy))


class InputError(TorquebenchError, ValueError):
    """An input (file, table, option, array) can't be used. Exit code 2."""


class SignalFault(TorquebenchError):  # noqa: N818 - a fault is the field's word for it
    """A signal is missing, frozen or outside its valid range: it has no number, not even 0 N·m."""


class LimitError(TorquebenchError):
    """A torque, speed, temperature or angle limit is or would be exceeded."""


class InterlockError(TorquebenchError):
    """The bench's state forbids the operation (clamp open, mode under load, wrong mounting)."""


class ModelMismatchError(TorquebenchError):
    """A compensation model belongs to another transducer, counter, range or version."""


class RecordError(TorquebenchError):
    """A stored record is missing, incomplete or was changed after the fact."""


class BenchError(TorquebenchError):
    """A device of the bench failed, answers wrongly or doesn't answer."""
