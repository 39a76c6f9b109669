"""Temperature, rotation and inertia of one chain, identified from empty runs and calibrations.

Physical forms and smooth functions over speed and temperature are fitted together, with scales from
the evidence (`evidence`, `basis`). The results are tables that effects interpolate.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
