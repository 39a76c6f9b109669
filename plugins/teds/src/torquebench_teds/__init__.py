"""Electronic data sheets of transducers (IEEE 1451.4): memory to values and back.

A sheet is read from and written to the memory in a transducer's connector, with a compensation
as its calibration curve.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
