"""Torque measurement for test benches of industrial-robot reducers.

``import torquebench as tb`` is the interface for notebooks and scripts: `read_calibration`, `fit`,
`compare`, `plot` and `load_model`, with data frames in and out.

The pure packages (`signals`, `mechanics`, `uncertainty`, `compensation`, `calibration`, `reducers`)
take NumPy arrays and return values; `bench`, `procedures`, `records`, `station`, `reports` and
`cli` move devices and write files.
"""

import lazy_loader

__getattr__, __dir__, _public = lazy_loader.attach_stub(__name__, __file__)
__all__ = ["__version__", *_public]

__version__ = "0.3.0"
