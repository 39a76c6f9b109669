from .records import (
    EmptyRun as EmptyRun,
    TurningCalibration as TurningCalibration,
    stretches as stretches,
)
from .tables import (
    Identified as Identified,
    identify as identify,
)
