from .calibrating import (
    StaircaseResult as StaircaseResult,
    calibrate as calibrate,
    verify as verify,
)
from .reducers.friction import (
    FrictionPoint as FrictionPoint,
    FrictionSettings as FrictionSettings,
    FrictionSweep as FrictionSweep,
    friction_sweep as friction_sweep,
)
from .rehearsal import (
    Move as Move,
    Rehearsal as Rehearsal,
    rehearse as rehearse,
)
from .setup import (
    Plan as Plan,
)
from .zeroing import (
    ZeroResult as ZeroResult,
    zero as zero,
    zero_modules as zero_modules,
)
