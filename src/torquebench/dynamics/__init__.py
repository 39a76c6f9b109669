"""Response of a chain to a quickly changing torque: identified, inverted, with uncertainty.

Pure functions: a transfer function from ramps, steps and sines; an inverse filter; filters along a
stream with u of every sample.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
