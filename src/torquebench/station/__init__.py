"""One open bench: devices, acquisition, run engine, active compensation, safety.

Both doors (commands and panel) talk to a `Station` and to nothing below it.
"""

from torquebench.station.bench_station import Station, data_directory
from torquebench.station.engine import Plan
from torquebench.station.runs import Progress, ProgressCallback, RunRecord

__all__ = ["Plan", "Progress", "ProgressCallback", "RunRecord", "Station", "data_directory"]
