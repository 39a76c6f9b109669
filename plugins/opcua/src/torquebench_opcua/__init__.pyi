from .endpoint import Endpoint as Endpoint
from .mapping import (
    LiveValue as LiveValue,
    live_values as live_values,
    machine_state as machine_state,
)
from .results import (
    ResultReader as ResultReader,
    ResultRecord as ResultRecord,
)
from .server import OpcUaServer as OpcUaServer
from .service import SERVICE as SERVICE
