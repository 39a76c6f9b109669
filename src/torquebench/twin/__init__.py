"""The physical model of the whole bench with known true torque.

Only the simulated driver, the simulators and tests may import it: the compensation must not use its
constants.
"""

from torquebench.twin.bench import BenchTwin
from torquebench.twin.blocks import (
    CHANNELS,
    FAULT_KINDS,
    MODES,
    MOUNTINGS,
    SIDES,
    AngleSamples,
    Certificate,
    Channel,
    FaultKind,
    Mode,
    Mounting,
    Nameplate,
    Side,
    StaticSweep,
    Truth,
    TwinBlock,
)
from torquebench.twin.parameters import TwinParameters
from torquebench.twin.presets import Preset
from torquebench.twin.reducer import ReducerConstants
from torquebench.twin.reducers import REDUCERS, ReducerName, draw_reducer
from torquebench.twin.turning import LUBRICANTS, LubricantName, TurningConstants

__all__ = [
    "CHANNELS",
    "FAULT_KINDS",
    "LUBRICANTS",
    "MODES",
    "MOUNTINGS",
    "REDUCERS",
    "SIDES",
    "AngleSamples",
    "BenchTwin",
    "Certificate",
    "Channel",
    "FaultKind",
    "LubricantName",
    "Mode",
    "Mounting",
    "Nameplate",
    "Preset",
    "ReducerConstants",
    "ReducerName",
    "Side",
    "StaticSweep",
    "Truth",
    "TurningConstants",
    "TwinBlock",
    "TwinParameters",
    "draw_reducer",
]
