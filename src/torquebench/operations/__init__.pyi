from .catalogue import (
    OPERATIONS as OPERATIONS,
    find_operation as find_operation,
)
from .operation import (
    WHOLE as WHOLE,
    Calibration as Calibration,
    CalibrationNumber as CalibrationNumber,
    Day as Day,
    Flag as Flag,
    Identifier as Identifier,
    ModelName as ModelName,
    ModelNumber as ModelNumber,
    Moment as Moment,
    MountedRequest as MountedRequest,
    Name as Name,
    Number as Number,
    Operation as Operation,
    Parameter as Parameter,
    Request as Request,
    RunId as RunId,
    Tolerance as Tolerance,
    field as field,
    on_files as on_files,
    parameters as parameters,
    plain_text as plain_text,
)
from .place import (
    ROLES as ROLES,
    EndedError as EndedError,
    Library as Library,
    PackagedLibrary as PackagedLibrary,
    Place as Place,
    Role as Role,
    allows as allows,
)
from .preview import (
    Preview as Preview,
    duration_words as duration_words,
    plan_preview as plan_preview,
)
from .result import (
    HIDDEN as HIDDEN,
    ExplainedError as ExplainedError,
    Integers as Integers,
    Numbers as Numbers,
    Result as Result,
)
from .schemas import (
    json_schemas as json_schemas,
)
