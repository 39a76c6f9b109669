"""Calibration as pure values: the table of a calibration, its profile, evaluation and check.

Arrays in, frozen values out; no device and no file except the packaged profiles.
"""

from torquebench.exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__, __file__)
