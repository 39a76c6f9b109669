from .allan import (
    AllanDeviation as AllanDeviation,
    allan_deviation as allan_deviation,
)
from .analogue import (
    AnalogueInput as AnalogueInput,
    Threshold as Threshold,
    edges_of_wave as edges_of_wave,
)
from .angle_windows import (
    AngleCounter as AngleCounter,
    AngleSamples as AngleSamples,
)
from .counters import (
    FrequencyCounter as FrequencyCounter,
    gated as gated,
    reciprocal as reciprocal,
    regression as regression,
    triangular as triangular,
)
from .digital import (
    DigitalInput as DigitalInput,
    edges_of_bits as edges_of_bits,
    edges_of_bytes as edges_of_bytes,
)
from .edges import (
    EdgeBlock as EdgeBlock,
)
from .faults import (
    PulseTrainFault as PulseTrainFault,
    SignalFaultKind as SignalFaultKind,
)
from .filters import (
    LiveFilter as LiveFilter,
    zero_phase as zero_phase,
)
from .glitches import (
    GlitchFilter as GlitchFilter,
)
from .inertia import (
    Motion as Motion,
    inertia_torque as inertia_torque,
    motion_of_angle as motion_of_angle,
    without_inertia as without_inertia,
)
from .orders import (
    AngleRecord as AngleRecord,
    OrderSpectrum as OrderSpectrum,
    RippleFit as RippleFit,
    fit_ripple as fit_ripple,
    order_spectrum as order_spectrum,
    resample_in_angle as resample_in_angle,
)
from .periods import (
    FrequencyInput as FrequencyInput,
    edges_of_periods as edges_of_periods,
)
from .samples import (
    FrequencySamples as FrequencySamples,
    TorqueSamples as TorqueSamples,
)
from .scale import (
    FrequencyScale as FrequencyScale,
)
from .sigrok import (
    LogicRecording as LogicRecording,
    parse_sigrok as parse_sigrok,
)
from .steady import (
    SteadyValue as SteadyValue,
    steady_value as steady_value,
)
from .windows import (
    CounterMethod as CounterMethod,
    WindowCounter as WindowCounter,
    count_windows as count_windows,
)
