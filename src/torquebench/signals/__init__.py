"""Pulses to torque to steady value.

Edge times of the transducers' frequency outputs become frequency per window with its standard
uncertainty, torque by measured zero and per-direction sensitivity, and the steady value of a
step. What isn't a valid signal is a typed fault, never a number.
"""

from torquebench.signals.allan import AllanDeviation, allan_deviation
from torquebench.signals.analogue import AnalogueInput, Threshold, edges_of_wave
from torquebench.signals.angle_windows import AngleCounter, AngleSamples
from torquebench.signals.channels import SynchronousSamples, synchronous
from torquebench.signals.counters import (
    FrequencyCounter,
    gated,
    reciprocal,
    regression,
    triangular,
)
from torquebench.signals.digital import DigitalInput, edges_of_bits, edges_of_bytes
from torquebench.signals.edges import EdgeBlock
from torquebench.signals.faults import PulseTrainFault, SignalFaultKind
from torquebench.signals.filters import LiveFilter, zero_phase
from torquebench.signals.glitches import GlitchFilter
from torquebench.signals.inertia import Motion, inertia_torque, motion_of_angle, without_inertia
from torquebench.signals.orders import (
    AngleRecord,
    OrderSpectrum,
    RippleFit,
    fit_ripple,
    order_spectrum,
    resample_in_angle,
)
from torquebench.signals.periods import FrequencyInput, edges_of_periods
from torquebench.signals.samples import FrequencySamples, TorqueSamples
from torquebench.signals.scale import FrequencyScale, TimebaseEffect
from torquebench.signals.sigrok import LogicRecording, parse_sigrok
from torquebench.signals.steady import SteadyValue, steady_value
from torquebench.signals.windows import (
    CounterMethod,
    WindowCounter,
    count_windows,
    windows_of_angle,
)

__all__ = [
    "AllanDeviation",
    "AnalogueInput",
    "AngleCounter",
    "AngleRecord",
    "AngleSamples",
    "CounterMethod",
    "DigitalInput",
    "EdgeBlock",
    "FrequencyCounter",
    "FrequencyInput",
    "FrequencySamples",
    "FrequencyScale",
    "GlitchFilter",
    "LiveFilter",
    "LogicRecording",
    "Motion",
    "OrderSpectrum",
    "PulseTrainFault",
    "RippleFit",
    "SignalFaultKind",
    "SteadyValue",
    "SynchronousSamples",
    "Threshold",
    "TimebaseEffect",
    "TorqueSamples",
    "WindowCounter",
    "allan_deviation",
    "count_windows",
    "edges_of_bits",
    "edges_of_bytes",
    "edges_of_periods",
    "edges_of_wave",
    "fit_ripple",
    "gated",
    "inertia_torque",
    "motion_of_angle",
    "order_spectrum",
    "parse_sigrok",
    "reciprocal",
    "regression",
    "resample_in_angle",
    "steady_value",
    "synchronous",
    "triangular",
    "windows_of_angle",
    "without_inertia",
    "zero_phase",
]
