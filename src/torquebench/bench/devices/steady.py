"""The torque of a settled step: the one detector that calibration and tests read."""

from __future__ import annotations

import time
from dataclasses import dataclass

from bluesky.protocols import HasHints, Hints, Reading
from event_model import DataKey
from ophyd_async.core import AsyncConfigurable, AsyncReadable, AsyncStatus, Device

from torquebench.bench.drivers.base import Side

__all__ = ["SteadySettings", "SteadyTorque"]


@dataclass(frozen=True)
class SteadySettings:
    """How a steady value is taken.

    Parameters
    ----------
    settle_s : float
        Time that the step is left to settle, counted from the last torque or speed command to
        this side, s. A step of a rapid staircase lasts `settle_s + window_s`.
    window_s : float
        Length of the averaging window, s.
    limit_s : float
        How much longer to wait for a window whose drift is within its own standard error.
        After that the point is taken as it is and marked `settled = False`.
    period_s : float or None
        Period of a known ripple (one revolution); the mean is taken over whole periods.
    reference : bool
        Also take the mounted standard's torque over the same window.
    """

    settle_s: float = 0.2
    window_s: float = 0.3
    limit_s: float = 0.0
    period_s: float | None = None
    reference: bool = False


class SteadyTorque(Device, AsyncReadable, AsyncConfigurable, HasHints):
    """Mean torque of one side over a settled window, with its standard error and drift.

    `prepare(SteadySettings(...))` says how, `trigger()` waits in bench time and evaluates,
    `read()` returns the fields (data key by `key(field)`):

    ===========================  ======  =====================================================
    `reading_nm`                 N·m     DC component of the transducer's reading, raw
    `reading_standard_error_nm`  N·m     standard error of that mean
    `reading_drift_nm_per_s`     N·m/s   slope over the window
    `frequency_hz`               Hz      mean frequency of the transducer
    `settled`                    bool    drift within its own standard error
    `samples`                            number of windows of the counter that were averaged
    `commanded_nm`               N·m     set point of this side's drive
    `speed_rpm`                  rpm     mean speed of this side
    `temperature_c`              °C      of this side's transducer
    `time_s`                     s       bench time of the middle of the window
    `torque_nm`                  N·m     compensated torque      } only with an active model
    `torque_uncertainty_nm`      N·m     model's standard uncert.} of this side
    `standard_nm`                N·m     torque that the standard states     } only where the
    `standard_uncertainty_nm`    N·m     standard error of that mean         } settings have
    `standard_drift_nm_per_s`    N·m/s   its slope                           } `reference =
    `standard_frequency_hz`      Hz      mean frequency of its transducer    } True`
    `true_torque_nm`             N·m     true mean torque, simulated bench only
    ===========================  ======  =====================================================

    A fault of the signal raises `SignalFault`: there is never a number without pulses.
    """

    side: Side

    def key(self, field: str) -> str:
        """Event data key of a field."""
        return f"{self.name}-{field}"
