"""Shafts, additional torque of the measuring chain, and the torsion of supports' sections.

Pure functions of arrays: what a design adds to the torque, and how much each parameter matters.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
