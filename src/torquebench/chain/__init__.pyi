from .acceleration import (
    AccelerationBySpeed as AccelerationBySpeed,
)
from .effect import (
    EFFECTS as EFFECTS,
    Effect as Effect,
    MeasuredPart as MeasuredPart,
    register as register,
)
from .effects import (
    SWITCHES as SWITCHES,
    Counter as Counter,
    Creep as Creep,
    Drift as Drift,
    Dynamics as Dynamics,
    Inertia as Inertia,
    MeasuredRotation as MeasuredRotation,
    MeasuredTemperature as MeasuredTemperature,
    Mounting as Mounting,
    Reference as Reference,
    Ripple as Ripple,
    Rotation as Rotation,
    Scatter as Scatter,
    StaticCurve as StaticCurve,
    SwitchedOff as SwitchedOff,
    Temperature as Temperature,
    Timebase as Timebase,
    Zero as Zero,
)
from .identification import (
    LEAST_KELVIN as LEAST_KELVIN,
    EmptyRun as EmptyRun,
    Identified as Identified,
    TurningCalibration as TurningCalibration,
    identify as identify,
    identify_lubrication as identify_lubrication,
    stretches as stretches,
)
from .measuring_chain import (
    ChainStream as ChainStream,
    MeasuringChain as MeasuringChain,
    RecordedStream as RecordedStream,
    effect_from as effect_from,
    load_chain as load_chain,
)
from .parts import (
    TorqueParts as TorqueParts,
)
from .readings import (
    Readings as Readings,
    rows_of as rows_of,
)
from .states import (
    EffectState as EffectState,
    effect_states as effect_states,
    not_in_u as not_in_u,
)
from .table_rows import (
    readings_of_rows as readings_of_rows,
)
from .torque import (
    COVERAGE_FACTOR as COVERAGE_FACTOR,
    Component as Component,
    Shared as Shared,
    Torque as Torque,
    joined as joined,
)
