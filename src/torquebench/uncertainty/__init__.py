"""Measurement uncertainty: budgets of sums, their check by Monte Carlo, decision rules.

Pure functions with frozen results. Sources: JCGM 100:2008 (GUM), JCGM 101:2008 (Monte Carlo), JCGM
106:2012 (conformity), ILAC-G8:09/2019 (guard bands).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
