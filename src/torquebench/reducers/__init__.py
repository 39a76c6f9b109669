"""Evaluation of reducer tests: measured columns in, values with uncertainty out.

Pure: torque-angle loops, no-load and break-away torque, transmission error and efficiency, each
value a `Budget` with its contributions; descriptions of reducers, verdicts and comparisons.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
