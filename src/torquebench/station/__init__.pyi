from .bench_station import (
    Station as Station,
    data_directory as data_directory,
)
from .engine import (
    Plan as Plan,
)
from .entering import (
    SPECIMEN as SPECIMEN,
    enter_run as enter_run,
)
from .recording import (
    LONGEST_BEFORE_S as LONGEST_BEFORE_S,
    RunRecord as RunRecord,
)
from .unfinished import (
    RecoveredRun as RecoveredRun,
    recover_unfinished as recover_unfinished,
)
