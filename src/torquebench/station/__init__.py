"""An open bench: devices, acquisition, run engine, active compensation, safety.

All interfaces (command line, panel, API) use a bench only through a `Station`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
