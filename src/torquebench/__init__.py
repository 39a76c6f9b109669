"""Torque measurement for test benches of industrial-robot reducers.

The pure rooms (`signals`, `mechanics`, `uncertainty`, `compensation`, `calibration`,
`reducers`) take NumPy arrays and return values; `bench`, `procedures`, `records`,
`station`, `reports` and `cli` are the edge that moves devices and writes files.
"""

from importlib.metadata import version

__version__ = version("torquebench")

__all__ = ["__version__"]
