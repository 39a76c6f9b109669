"""The words of the bench: sides, modes, mountings and channels."""

from __future__ import annotations

from typing import Literal

__all__ = [
    "CHANNELS",
    "MODES",
    "MOUNTINGS",
    "SIDES",
    "Mode",
    "Mounting",
    "Side",
    "reference_channel",
    "torque_channel",
]

Side = Literal["input", "output"]
Mode = Literal["free", "driven", "locked"]
Mounting = Literal["calibrator", "verification_standard", "reducer", "nothing"]

SIDES: tuple[Side, Side] = ("input", "output")
MODES: tuple[Mode, ...] = ("free", "driven", "locked")
MOUNTINGS: tuple[Mounting, ...] = ("calibrator", "verification_standard", "reducer", "nothing")
CHANNELS = ("input_torque", "output_torque", "input_reference", "output_reference")


def torque_channel(side: Side) -> str:
    """Name of the edge channel of a module's torque transducer.

    Examples
    --------
    >>> torque_channel("output")
    'output_torque'
    """
    return f"{side}_torque"


def reference_channel(side: Side) -> str:
    """Name of the edge channel of the mounted standard's transducer on one side.

    Examples
    --------
    >>> reference_channel("input")
    'input_reference'
    """
    return f"{side}_reference"
