"""From a reading to torque, uncertainty and budget, in one place for every interface.

A measuring chain is a sum of effects with what their errors share. Pure: arrays in, `Torque` out.
"""

from torquebench.exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__, __file__)
