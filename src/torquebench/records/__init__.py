"""What stays: tables in and out, the folder of each run, and the registry of all records.

Outputs are written whole or not at all, and nothing is overwritten or filled in. A name is
imported when somebody asks for it, so that a list of records doesn't wait for numerics.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
