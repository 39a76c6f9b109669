from .curve import (
    CurveFit as CurveFit,
    fit_curve as fit_curve,
    torque_span as torque_span,
)
from .memory import (
    SIZES as SIZES,
    read_file as read_file,
    read_memory as read_memory,
    write_memory as write_memory,
)
from .sheet import (
    Section as Section,
    Sheet as Sheet,
    Unread as Unread,
    decode as decode,
    encode as encode,
    sheet_from_json as sheet_from_json,
    sheet_to_json as sheet_to_json,
)
from .templates import (
    BASIC as BASIC,
    BRIDGE as BRIDGE,
    CALIBRATION_CURVE as CALIBRATION_CURVE,
    TEMPLATES as TEMPLATES,
)
