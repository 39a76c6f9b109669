from .counters import (
    CounterMethod as CounterMethod,
    FrequencyCounter as FrequencyCounter,
)
from .edges import (
    EdgeBlock as EdgeBlock,
)
from .faults import (
    PulseTrainFault as PulseTrainFault,
    SignalFaultKind as SignalFaultKind,
)
from .inertia import (
    Motion as Motion,
    inertia_torque as inertia_torque,
    motion_of_angle as motion_of_angle,
    without_inertia as without_inertia,
)
from .record import (
    History as History,
    Record as Record,
)
from .scale import (
    SignalScale as SignalScale,
)
from .steady import (
    SteadyValue as SteadyValue,
    steady_value as steady_value,
)
