"""Torque measurement for test benches of industrial-robot reducers.

The pure packages (`signals`, `mechanics`, `uncertainty`, `compensation`, `calibration`,
`reducers`) take NumPy arrays and return values; `bench`, `procedures`, `records`,
`station`, `reports` and `cli` are the edge that moves devices and writes files.
"""

from typing import TYPE_CHECKING

__all__ = ["__version__"]

if TYPE_CHECKING:
    __version__: str


def __getattr__(name: str) -> str:
    """Look up the version when somebody asks: reading the metadata costs as much as a command."""
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib.metadata import version

    globals()[name] = version("torquebench")
    found: str = globals()[name]
    return found
