"""Output of the twin: blocks of edges, encoder counts, probe temperatures and the truth."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
TickArray = NDArray[np.int64]

Side = Literal["input", "output"]
Mode = Literal["free", "driven", "locked"]
Mounting = Literal["calibrator", "verification_standard", "reducer", "nothing"]
Channel = Literal["input_torque", "output_torque", "input_reference", "output_reference"]
FaultKind = Literal[
    "silent",
    "frozen",
    "missing_pulses",
    "doubled_pulses",
    "outlier",
    "wrong_span",
    "out_of_modulation",
    "encoder_slip",
]

SIDES: tuple[Side, ...] = ("input", "output")
MODES: tuple[Mode, ...] = ("free", "driven", "locked")
MOUNTINGS: tuple[Mounting, ...] = ("calibrator", "verification_standard", "reducer", "nothing")
CHANNELS: tuple[Channel, ...] = (
    "input_torque",
    "output_torque",
    "input_reference",
    "output_reference",
)
FAULT_KINDS: tuple[FaultKind, ...] = (
    "silent",
    "frozen",
    "missing_pulses",
    "doubled_pulses",
    "outlier",
    "wrong_span",
    "out_of_modulation",
    "encoder_slip",
)


class AngleSamples(NamedTuple):
    """Counts of one encoder, sampled at 1 kHz by the counters' clock.

    Attributes
    ----------
    time_s : float64[k]
        Sample times, seconds of the counters' clock since the twin's start.
    counts : int64[k]
        Absolute counts; they aren't wrapped at a revolution.
    counts_per_revolution : int
        Counts of one revolution (lines times interpolation).
    """

    time_s: FloatArray
    counts: TickArray
    counts_per_revolution: int


@dataclass(frozen=True)
class Truth:
    """True values, unknown on a real bench; for tests and for figures marked "simulated".

    Attributes
    ----------
    time_s : float64[k]
        Times on the twin's 1 ms grid, seconds of the counters' clock.
    torque_nm : dict of side to float64[k]
        True torque that the module applies to the mounted part's flange, clockwise positive.
    speed_rad_s, angle_rad : dict of side to float64[k]
        Speed and angle of that flange.
    temperature_c : dict of name to float
        True temperatures at the block's end (the probes have an error).
    """

    time_s: FloatArray
    torque_nm: Mapping[Side, FloatArray]
    speed_rad_s: Mapping[Side, FloatArray]
    angle_rad: Mapping[Side, FloatArray]
    temperature_c: Mapping[str, float]


@dataclass(frozen=True)
class TwinBlock:
    """All data of the bench over one half-open interval of its counters' clock.

    Attributes
    ----------
    start_tick, stop_tick : int
        Interval covered, ticks since the twin's start: start_tick <= tick < stop_tick.
    timebase_hz : float
        Nominal ticks per second. The ticks contain the clock's error.
    edges : dict of channel to int64[n]
        Rising edges of every active channel, absolute ticks, strictly increasing. The reference
        channels are silent (empty) unless the calibrator or the verification standard is mounted.
    angles : dict of side to AngleSamples
        Encoder counts of both sides.
    temperatures : dict of name to float
        Probe readings in °C at the block's end: "ambient", "input_transducer",
        "output_transducer", "reducer", "calibrator".
    truth : Truth
        The true state over the same interval.
    """

    start_tick: int
    stop_tick: int
    timebase_hz: float
    edges: Mapping[Channel, TickArray]
    angles: Mapping[Side, AngleSamples]
    temperatures: Mapping[str, float]
    truth: Truth


@dataclass(frozen=True)
class Nameplate:
    """Values of a transducer's data sheet; the twin's device deviates from them.

    Attributes
    ----------
    nominal_torque_nm : float
        Rated torque.
    nominal_zero_hz : float
        Frequency at zero torque.
    sensitivity_hz_per_nm : float
        Slope, the same for both directions.
    modulation_hz : tuple of float
        Lowest and highest valid frequency.
    """

    nominal_torque_nm: float
    nominal_zero_hz: float
    sensitivity_hz_per_nm: float
    modulation_hz: tuple[float, float]


@dataclass(frozen=True)
class Certificate:
    """Certificate of one reference transducer: its error at evenly spaced points.

    Attributes
    ----------
    torque_nm : float64[n]
        Torque of the certified points, increasing, both directions and zero. 50 points for each
        direction.
    error_nm : float64[n]
        Indication minus torque at these points. Corrected indication = indication - error.
    expanded_uncertainty_nm : float64[n]
        Expanded uncertainty (k = 2) of ``error_nm``.
    """

    torque_nm: FloatArray
    error_nm: FloatArray
    expanded_uncertainty_nm: FloatArray

    def correct(self, indication_nm: FloatArray) -> FloatArray:
        """Return the torque for an indication, by linear interpolation between the points.

        Parameters
        ----------
        indication_nm : float64[...]
            Indication of the reference transducer.

        Returns
        -------
        float64[...]
            Indication minus the interpolated error.
        """
        indicated = self.torque_nm + self.error_nm
        return np.asarray(indication_nm - np.interp(indication_nm, indicated, self.error_nm))


@dataclass(frozen=True)
class StaticSweep:
    """Noise-free readings along a path of true torques, in the path's order.

    Attributes
    ----------
    true_torque_nm : float64[n]
        The path.
    reading_nm : float64[n]
        The module's reading by nominal sensitivity and the zero measured unloaded.
    frequency_hz : float64[n]
        The transducer's frequency as the counters see it.
    reference_nm : float64[n]
        The calibrator's (or verification standard's) reading, uncorrected.
    branch : int8[n]
        +1 where |torque| grew to reach the point, -1 where it fell, 0 where it didn't change.
    """

    true_torque_nm: FloatArray
    reading_nm: FloatArray
    frequency_hz: FloatArray
    reference_nm: FloatArray
    branch: NDArray[np.int8]
