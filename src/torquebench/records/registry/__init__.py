"""The registry: entries of a data directory in a database, its hash chain and its migrations.

Plugins use the classes of entries with their tables (`metadata`, `links`), read by
`Registry.entries` and `Registry.links`, append by `Registry.add` and `Registry.amend`, and make
entries from the columns of another database by `entry_of`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
