from .assembly import (
    BenchDevices as BenchDevices,
    Module as Module,
)
from .drive import (
    DriveAxis as DriveAxis,
    DriveDevice as DriveDevice,
    DriveSwitch as DriveSwitch,
    RampTo as RampTo,
)
from .fixture import (
    ClampDevice as ClampDevice,
    ModeDevice as ModeDevice,
    MountingDevice as MountingDevice,
)
from .labels import (
    Point as Point,
    PointLabel as PointLabel,
)
from .recorder import (
    Recorder as Recorder,
    SynchronousRecording as SynchronousRecording,
)
from .sensors import (
    Encoder as Encoder,
    MeasuredZero as MeasuredZero,
    Reference as Reference,
    TemperatureProbes as TemperatureProbes,
    Transducer as Transducer,
)
from .steady import (
    SteadySettings as SteadySettings,
    SteadyTorque as SteadyTorque,
    signal_of as signal_of,
)
