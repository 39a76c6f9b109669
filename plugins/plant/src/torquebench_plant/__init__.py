"""Many benches of one plant: a registry of all their results, and queries.

Each bench keeps its own SQLite registry and folders. `forward` sends them to a `Plant`, a registry
on a PostgreSQL server for all benches.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
