"""Calibration as pure values: the table of a calibration, its profile, evaluation and check.

Arrays in, frozen values out; no device and no file except the packaged profiles.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
