"""Calibration in pure functions: tables, profiles, evaluation and verification.

Arrays in, frozen values out; no device, and no files except the packaged profiles.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
