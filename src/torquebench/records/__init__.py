"""Records: the folder of each run, and the registry.

Files are written completely or not at all, and nothing is overwritten. Public names are imported on
first use, so that a list of records doesn't wait for numerical libraries.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
