"""From readings to torque, uncertainty and budget, in one place for every interface.

A measuring chain is a sum of effects whose errors may be correlated. Pure: arrays in, `Torque` out.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
