"""One open bench: devices, acquisition, run engine, active compensation, safety.

Both doors (commands and panel) talk to a `Station` and to nothing below it.
"""

from torquebench.station.bench_station import Station, data_directory
from torquebench.station.engine import Plan
from torquebench.station.runs import Progress, ProgressCallback, RunRecord
from torquebench.station.unfinished import RecoveredRun, recover_unfinished

__all__ = [
    "Plan",
    "Progress",
    "ProgressCallback",
    "RecoveredRun",
    "RunRecord",
    "Station",
    "data_directory",
    "recover_unfinished",
]
