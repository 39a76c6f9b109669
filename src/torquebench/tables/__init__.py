"""Tables in and out: one reader for every format, with units, and errors by row and column.

A name is imported at its first use, so that a refusal doesn't wait for numerical libraries.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
