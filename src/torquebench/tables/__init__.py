"""Tables: one reader for every format, with units, and errors that name row and column.

Names are imported at their first use, so that a refusal doesn't wait for numerical libraries.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
