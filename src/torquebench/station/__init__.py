"""One open bench: devices, acquisition, run engine, active compensation, safety.

Both doors (commands and panel) talk to a `Station` and to nothing below it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
