"""From pulses to torque and steady values.

Edge times of the transducers' frequency outputs become a frequency per window with its standard
uncertainty, a torque by the measured zero and the sensitivity of each direction, and the steady
value of a step. An invalid signal becomes a fault with a kind, never a number.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
