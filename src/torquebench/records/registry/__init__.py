"""The registry: entries of a data directory in a database, its hash chain and its migrations.

For packages beside the core: kinds of entries with their tables (`metadata`, `links`), reading
(`Registry.entries`, `Registry.links`), additions (`Registry.add`, `Registry.amend`), and entries
from columns of another database (`entry_of`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
