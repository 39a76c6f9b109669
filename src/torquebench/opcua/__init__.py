"""The open bench as OPC UA server: identification, state, live values, results, alarms.

It maps what the panel's service offers and computes nothing itself. Needs the extra `opcua`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
