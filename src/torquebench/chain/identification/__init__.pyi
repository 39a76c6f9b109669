from .lubrication import identify_lubrication as identify_lubrication
from .records import (
    EmptyRun as EmptyRun,
    TurningCalibration as TurningCalibration,
    stretches as stretches,
)
from .tables import (
    LEAST_KELVIN as LEAST_KELVIN,
    Identified as Identified,
    identify as identify,
)
