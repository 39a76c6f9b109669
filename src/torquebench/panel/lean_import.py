"""Import NiceGUI without clients and servers that it doesn't use."""

from __future__ import annotations

import sys

UNUSED = ("aiohttp", "requests", "tornado", "websocket")
"""What NiceGUI's protocol, Engine.IO, imports only where it is installed: clients, and servers
other than the panel's. Other packages install it, and it takes 14 MB and half a second."""


def import_nicegui() -> None:
    """Import NiceGUI as if the unused packages weren't installed; others import them as usual."""
    before = {name: sys.modules[name] for name in UNUSED if name in sys.modules}
    sys.modules.update(dict.fromkeys(UNUSED))  # type: ignore[arg-type]  # None: not to be found
    try:
        import nicegui  # noqa: F401
    finally:
        for name in UNUSED:
            del sys.modules[name]
        sys.modules.update(before)
