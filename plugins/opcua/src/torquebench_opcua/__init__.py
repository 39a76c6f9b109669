"""The open bench as OPC UA server: identification, state, live values, results, alarms.

It maps the values of the panel's service without computations. Needs the extra `opcua`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
