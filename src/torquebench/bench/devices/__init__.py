"""The bench as ophyd-async devices: what plans read, set and trigger.

`BenchDevices` holds one `Module` a side, the mounted `Reference`, the `ClampDevice`, the
`MountingDevice`, the `TemperatureProbes` and the `PointLabel` that stamps each point.
"""

from torquebench.exports import lazy_exports

__getattr__, __dir__, __all__ = lazy_exports(__name__, __file__)
