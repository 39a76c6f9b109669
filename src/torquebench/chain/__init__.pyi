from .effect import (
    EFFECTS as EFFECTS,
    Effect as Effect,
    effect_from as effect_from,
    register as register,
)
from .effects import (
    Counter as Counter,
    Drift as Drift,
    Dynamics as Dynamics,
    Mounting as Mounting,
    Reference as Reference,
    Rotation as Rotation,
    Scatter as Scatter,
    StaticCurve as StaticCurve,
    Temperature as Temperature,
    Timebase as Timebase,
    Zero as Zero,
)
from .measuring_chain import (
    ChainStream as ChainStream,
    MeasuringChain as MeasuringChain,
    load_chain as load_chain,
)
from .readings import (
    Readings as Readings,
)
from .torque import (
    COVERAGE_FACTOR as COVERAGE_FACTOR,
    Component as Component,
    Shared as Shared,
    Torque as Torque,
    joined as joined,
)
