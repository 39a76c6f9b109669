"""The effects of measuring chains, one file each. Importing a module here registers its effect.

The static curve and the scatter belong to the fitted model; the others are stored beside it.
"""

from torquebench.chain.effects.counter import Counter, Timebase
from torquebench.chain.effects.creep import Creep
from torquebench.chain.effects.drift import Drift
from torquebench.chain.effects.dynamics import Dynamics, RecordedDynamics
from torquebench.chain.effects.inertia import Inertia
from torquebench.chain.effects.measured_rotation import MeasuredRotation
from torquebench.chain.effects.measured_temperature import MeasuredTemperature
from torquebench.chain.effects.mounting import Mounting
from torquebench.chain.effects.reference import Reference
from torquebench.chain.effects.ripple import Ripple
from torquebench.chain.effects.rotation import Rotation
from torquebench.chain.effects.scatter import Scatter
from torquebench.chain.effects.static_curve import StaticCurve
from torquebench.chain.effects.switched_off import SWITCHES, SwitchedOff
from torquebench.chain.effects.temperature import Temperature
from torquebench.chain.effects.zero import Zero

__all__ = [
    "SWITCHES",
    "Counter",
    "Creep",
    "Drift",
    "Dynamics",
    "Inertia",
    "MeasuredRotation",
    "MeasuredTemperature",
    "Mounting",
    "RecordedDynamics",
    "Reference",
    "Ripple",
    "Rotation",
    "Scatter",
    "StaticCurve",
    "SwitchedOff",
    "Temperature",
    "Timebase",
    "Zero",
]
