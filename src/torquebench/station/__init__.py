"""One open bench: devices, acquisition, run engine, active compensation, safety.

Both doors (commands and panel) talk to a `Station` and to nothing below it.
"""

from torquebench.exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__, __file__)
