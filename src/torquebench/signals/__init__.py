"""Pulses to torque to steady value.

Edge times of the transducers' frequency outputs become frequency per window with its standard
uncertainty, torque by measured zero and per-direction sensitivity, and the steady value of a
step. What isn't a valid signal is a typed fault, never a number.
"""

from torquebench.signals.counters import (
    FrequencyCounter,
    gated,
    reciprocal,
    regression,
    triangular,
)
from torquebench.signals.edges import EdgeBlock
from torquebench.signals.faults import PulseTrainFault, SignalFaultKind
from torquebench.signals.samples import FrequencySamples, TorqueSamples
from torquebench.signals.scale import FrequencyScale, TimebaseEffect
from torquebench.signals.steady import SteadyValue, steady_value
from torquebench.signals.windows import CounterMethod, count_windows, samples_of, windows_of_angle

__all__ = [
    "CounterMethod",
    "EdgeBlock",
    "FrequencyCounter",
    "FrequencySamples",
    "FrequencyScale",
    "PulseTrainFault",
    "SignalFaultKind",
    "SteadyValue",
    "TimebaseEffect",
    "TorqueSamples",
    "count_windows",
    "gated",
    "reciprocal",
    "regression",
    "samples_of",
    "steady_value",
    "triangular",
    "windows_of_angle",
]
