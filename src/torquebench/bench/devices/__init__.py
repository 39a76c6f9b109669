"""The bench as ophyd-async devices, which plans read, set and trigger.

`BenchDevices` holds one `Module` for each side, the mounted `Reference`, the `ClampDevice`, the
`MountingDevice`, the `TemperatureProbes` and the `PointLabel` that stamps each point.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
