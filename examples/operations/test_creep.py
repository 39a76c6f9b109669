"""The contract of operations for `creep.py`.

TORQUEBENCH_OPERATIONS=creep.py pytest test_creep.py
"""

from torquebench.testing.operations import OperationContract


class TestCreep(OperationContract):
    name = "creep"
    possible = {"side": "output", "duration_s": 20.0, "interval_s": 10.0}
    refused = {"side": "output", "torque_percent_fs": 101.0}
