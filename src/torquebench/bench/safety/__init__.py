"""What watches the bench below every procedure and brings it to a safe state.

`SafetySupervisor` holds signals, drives and heartbeats against limits; alarms say what was found.
"""

from torquebench.bench.safety.alarms import Alarm, AlarmKind, AlarmLevel, StandingAlarm
from torquebench.bench.safety.limits import StepLimits
from torquebench.bench.safety.supervisor import SafetySupervisor

__all__ = [
    "Alarm",
    "AlarmKind",
    "AlarmLevel",
    "SafetySupervisor",
    "StandingAlarm",
    "StepLimits",
]
