"""From a reading to torque, uncertainty and budget, in one place for every interface.

A measuring chain is a sum of effects with what their errors share. Pure: arrays in, `Torque` out.
"""

from torquebench.chain.effect import EFFECTS, Effect, effect_from, register
from torquebench.chain.effects import (
    Counter,
    Drift,
    Mounting,
    Reference,
    Rotation,
    Scatter,
    StaticCurve,
    Temperature,
    Timebase,
    Zero,
)
from torquebench.chain.measuring_chain import ChainStream, MeasuringChain
from torquebench.chain.readings import Readings
from torquebench.chain.torque import COVERAGE_FACTOR, Component, Shared, Torque, joined

__all__ = [
    "COVERAGE_FACTOR",
    "EFFECTS",
    "ChainStream",
    "Component",
    "Counter",
    "Drift",
    "Effect",
    "MeasuringChain",
    "Mounting",
    "Readings",
    "Reference",
    "Rotation",
    "Scatter",
    "Shared",
    "StaticCurve",
    "Temperature",
    "Timebase",
    "Torque",
    "Zero",
    "effect_from",
    "joined",
    "register",
]
