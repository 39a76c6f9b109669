"""Procedures: Bluesky plans that can be rehearsed before anything moves.

Every plan takes the bench's devices and settings, checks limits first, has a checkpoint before each
point, and leaves the bench without torque however it ends.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
