"""Campaigns: complete tasks of a user, as sequences of steps on an open station.

A campaign runs plans, fits and verifies models and registers the results for command line, panel,
API and reports. It prints nothing; a listener receives its progress.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
