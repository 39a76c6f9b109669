from .database import (
    database_failures as database_failures,
    engine_of as engine_of,
    url_with_driver as url_with_driver,
)
from .entries import (
    Activation as Activation,
    CalibrationEntry as CalibrationEntry,
    Document as Document,
    ModelEntry as ModelEntry,
    Registered as Registered,
    RunEnd as RunEnd,
    UtcDateTime as UtcDateTime,
    entry_of as entry_of,
    facts as facts,
    links as links,
    metadata as metadata,
)
from .registry import (
    Registry as Registry,
    Subject as Subject,
)
from .runs import (
    DISCARDED as DISCARDED,
)
