"""The bench as ophyd-async devices: what plans read, set and trigger.

`BenchDevices` holds one `Module` a side, the mounted `Reference`, the `ClampDevice`, the
`MountingDevice`, the `TemperatureProbes` and the `PointLabel` that stamps each point.
"""

from torquebench.bench.devices.assembly import BenchDevices, Module
from torquebench.bench.devices.drive import DriveAxis, DriveDevice, DriveSwitch
from torquebench.bench.devices.fixture import ClampDevice, ModeDevice, MountingDevice
from torquebench.bench.devices.labels import Point, PointLabel
from torquebench.bench.devices.ramp import DriveRamp, RampTo
from torquebench.bench.devices.recorder import Recorder, SynchronousRecording
from torquebench.bench.devices.sensors import Encoder, Reference, TemperatureProbes, Transducer
from torquebench.bench.devices.steady import SteadySettings, SteadyTorque

__all__ = [
    "BenchDevices",
    "ClampDevice",
    "DriveAxis",
    "DriveDevice",
    "DriveRamp",
    "DriveSwitch",
    "Encoder",
    "ModeDevice",
    "Module",
    "MountingDevice",
    "Point",
    "PointLabel",
    "RampTo",
    "Recorder",
    "Reference",
    "SteadySettings",
    "SteadyTorque",
    "SynchronousRecording",
    "TemperatureProbes",
    "Transducer",
]
