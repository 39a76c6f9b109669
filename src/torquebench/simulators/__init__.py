"""The twin behind real wire protocols, for unmodified drivers.

`Simulators` serves the instruments of a bench description; `misbehaviour` causes faults on command.
"""

from torquebench.simulators.misbehaviour import KINDS, Misbehaviour, MisbehaviourKind
from torquebench.simulators.serving import Simulators

__all__ = ["KINDS", "Misbehaviour", "MisbehaviourKind", "Simulators"]
