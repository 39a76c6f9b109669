"""Names of the bench's sides, modes, mountings and channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Side = Literal["input", "output"]
Mode = Literal["free", "driven", "locked"]
Mounting = Literal["calibrator", "verification_standard", "reducer", "nothing"]
Signal = Literal["frequency", "Nm", "V", "mV/V"]
"""What a transducer or its amplifier delivers."""
RailPosition = Literal["end", "away", "between"]
"""Position of the guide rail: at its end, away for mounting, or on its way."""

SIDES: tuple[Side, Side] = ("input", "output")
SIDE_TITLES: Mapping[str, str] = {"input": "Input module", "output": "Output module"}
MODES: tuple[Mode, ...] = ("free", "driven", "locked")
MOUNTINGS: tuple[Mounting, ...] = ("calibrator", "verification_standard", "reducer", "nothing")
RAIL_TARGETS: tuple[RailPosition, ...] = ("end", "away")
CHANNELS = ("input_torque", "output_torque", "input_reference", "output_reference")


@dataclass(frozen=True)
class Seating:
    """Requested change of the mounted part's seating.

    Parameters
    ----------
    change : {"rotation", "re-seat"}
        Turned to another position, or taken out and put back in the same one.
    position_deg : float
        Position about the bench's axis, degrees.
    """

    change: Literal["rotation", "re-seat"]
    position_deg: float


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


def angle_channel(side: Side) -> str:
    """Name of a side's encoder."""
    return f"{side}_angle"
