from .endpoint import Endpoint as Endpoint
from .mapping import (
    LiveValue as LiveValue,
    live_values as live_values,
    machine_state as machine_state,
)
from .results import ResultRecord as ResultRecord, result_records as result_records
from .server import OpcUaServer as OpcUaServer
