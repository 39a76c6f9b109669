from .calibration.data import (
    CalibrationData as CalibrationData,
)
from .compensation.selection import (
    Comparison as Comparison,
)
from .errors import (
    InputError as InputError,
)
from .notebook.frames import (
    read_calibration as read_calibration,
)
from .notebook.models import (
    Compensation as Compensation,
    FitWarning as FitWarning,
    compare as compare,
    fit as fit,
    load_model as load_model,
)
from .notebook.plots import (
    Drawing as Drawing,
    plot as plot,
)

__version__: str
