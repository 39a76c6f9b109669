from .design import (
    InverseFilter as InverseFilter,
    StepResponse as StepResponse,
    design_inverse as design_inverse,
    step_response as step_response,
)
from .filters import (
    Filtered as Filtered,
    FilterStream as FilterStream,
    UncertainFilter as UncertainFilter,
)
from .identification import (
    Inertia as Inertia,
    Known as Known,
    Shaft as Shaft,
    identify as identify,
    identify_inertia as identify_inertia,
    shaft_of as shaft_of,
)
from .vibration import (
    Delay as Delay,
    MotorInertia as MotorInertia,
    Sine as Sine,
    Steps as Steps,
    Vibration as Vibration,
    identify_delay as identify_delay,
    identify_vibration as identify_vibration,
    shaft_on_bench as shaft_on_bench,
)
from .transfer import (
    PARAMETERS as PARAMETERS,
    TransferFunction as TransferFunction,
)
