"""Shafts, additional torque of the measuring chain, and torsion of the supports' sections.

Pure functions of arrays, for the influence of a design and its parameters on the torque.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
