"""The twin behind real wire protocols, so that unmodified drivers can be run and tested.

`Simulators` serves what a bench description names; `misbehaviour` breaks it on command.
"""

from torquebench.simulators.misbehaviour import KINDS, Misbehaviour, MisbehaviourKind
from torquebench.simulators.serving import Simulators

__all__ = ["KINDS", "Misbehaviour", "MisbehaviourKind", "Simulators"]
