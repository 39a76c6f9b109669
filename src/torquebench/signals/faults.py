"""Faults of a pulse train: codes for arrays, and an error with the kind of the fault."""

from enum import IntEnum
from typing import Any

from torquebench.errors import SignalFault


class SignalFaultKind(IntEnum):
    """Reason why a window has no number; the values are the codes in the column `fault`.

    Examples
    --------
    >>> SignalFaultKind(1).name
    'NO_PULSES'
    >>> SignalFaultKind.STUCK.description
    'the counter delivers the same value again and again'
    """

    NONE = 0
    NO_PULSES = 1
    TOO_FEW_PULSES = 2
    MISSING_PULSES = 3
    DOUBLED_PULSES = 4
    STUCK = 5
    OUT_OF_MODULATION = 6
    LOST_DATA = 7

    @property
    def description(self) -> str:
        """Meaning of the code."""
        return _DESCRIPTIONS[self]

    @property
    def remedy(self) -> str:
        """Remedy for the operator."""
        return _REMEDIES[self]


_DESCRIPTIONS = {
    SignalFaultKind.NONE: "no fault",
    SignalFaultKind.NO_PULSES: "no pulses in the window",
    SignalFaultKind.TOO_FEW_PULSES: "too few pulses in the window for a frequency",
    SignalFaultKind.MISSING_PULSES: "pulses are missing from the train",
    SignalFaultKind.DOUBLED_PULSES: "pulses are doubled (chatter or reflections)",
    SignalFaultKind.STUCK: "the counter delivers the same value again and again",
    SignalFaultKind.OUT_OF_MODULATION: "the frequency is outside the transducer's modulation range",
    SignalFaultKind.LOST_DATA: "a part of the stream was lost before it was counted",
}

_REMEDIES = {
    SignalFaultKind.NONE: "",
    SignalFaultKind.NO_PULSES: "check the transducer's supply and cable",
    SignalFaultKind.TOO_FEW_PULSES: "use a longer window or check the frequency output",
    SignalFaultKind.MISSING_PULSES: "check the cable, its screen and the input threshold",
    SignalFaultKind.DOUBLED_PULSES: "check termination and hysteresis, or use the glitch filter",
    SignalFaultKind.STUCK: "restart the counter and check its timebase",
    SignalFaultKind.OUT_OF_MODULATION: "unload the transducer and check its wiring and option",
    SignalFaultKind.LOST_DATA: "check the counter's connection and the computer's load",
}


class PulseTrainFault(SignalFault):
    """A signal fault with its kind.

    Parameters
    ----------
    kind : SignalFaultKind
        Kind of the fault.
    found : str
        The finding with channel, time, value and unit.
    allowed : str, optional
        The allowed values.

    Examples
    --------
    >>> fault = PulseTrainFault(SignalFaultKind.NO_PULSES, "input_torque: 0 edges at 1.005 s")
    >>> fault.kind.name, str(fault)
    ('NO_PULSES', "input_torque: 0 edges at 1.005 s; check the transducer's supply and cable")
    """

    def __init__(self, kind: SignalFaultKind, found: str, allowed: str = "") -> None:
        super().__init__(found, allowed, kind.remedy)
        self.kind = kind

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (self.kind, self.found, self.allowed))
