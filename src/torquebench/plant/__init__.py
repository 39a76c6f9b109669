"""Many benches and one plant: a registry of what all of them have measured, and its questions.

A bench stays what it is: SQLite and a folder. `forward` sends what it has to a `Plant`, a registry
on a PostgreSQL server, which answers for all benches at once.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
