"""From pulses to torque and steady values.

Edge times of the transducers' frequency outputs become frequency per window with its standard
uncertainty, torque by measured zero and per-direction sensitivity, and the steady value of a step.
An invalid signal is a typed fault, never a number.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
