"""Monitoring of the bench, independent of procedures, which brings it to a safe state.

`SafetySupervisor` compares signals, drives and heartbeats with limits, and raises alarms.
"""

from torquebench.bench.safety.alarms import Alarm, AlarmKind, AlarmLevel, RaisedAlarm
from torquebench.bench.safety.limits import StepLimits
from torquebench.bench.safety.supervisor import SafetySupervisor

__all__ = [
    "Alarm",
    "AlarmKind",
    "AlarmLevel",
    "RaisedAlarm",
    "SafetySupervisor",
    "StepLimits",
]
