"""Shafts, additional torque of the measuring chain, and the torsion of supports' sections.

Pure functions of arrays: what a design adds to the torque, and how much each parameter matters.
"""

from torquebench.exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__, __file__)
