"""Torque measurement for test benches of industrial-robot reducers.

``import torquebench as tb`` is the interface for notebooks and scripts: `read_calibration`, `fit`,
`compare`, `plot` and `load_model`, with data frames in and out.

The pure packages (`signals`, `mechanics`, `uncertainty`, `compensation`, `calibration`,
`reducers`) take NumPy arrays and return values; `bench`, `procedures`, `records`,
`station`, `reports` and `cli` are the edge that moves devices and writes files.
"""

from typing import Any

import lazy_loader

_named, __dir__, _public = lazy_loader.attach_stub(__name__, __file__)
__all__ = ["__version__", *_public]


def __getattr__(name: str) -> Any:
    """Import a public name, or look the version up, when somebody asks: both take their time."""
    if name != "__version__":
        return _named(name)
    from importlib.metadata import version

    globals()[name] = version("torquebench")
    return globals()[name]
