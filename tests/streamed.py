"""Push readings through an active chain as the bench does."""

from typing import Any

import numpy as np

from torquebench.bench.active_chain import ActiveChain
from torquebench.chain import Torque
from torquebench.signals import Record


def streamed(
    active: ActiveChain,
    time_s: Any,
    reading_nm: Any,
    counter_nm: Any = None,
    *,
    fine: bool = False,
    **conditions: Any,
) -> Torque:
    """Compensate windows; conditions that aren't given are unknown."""
    columns = {"time_s": np.asarray(time_s, float), "reading_nm": np.asarray(reading_nm, float)}
    if counter_nm is not None:
        columns["counter_nm"] = np.asarray(counter_nm, float)
    record = Record(columns)
    until_s = float(record.time_s[-1]) if len(record) else np.nan
    return active.push(record, conditions, until_s, fine=fine)
