"""The bench's twin: commands in, blocks of edges and counts out, with known true torque."""

from collections.abc import Sequence
from typing import NoReturn

from torquebench.twin.blocks import (
    CHANNELS,
    Certificate,
    Channel,
    FaultKind,
    FloatArray,
    Mode,
    Mounting,
    Nameplate,
    Side,
    StaticSweep,
    TwinBlock,
)
from torquebench.twin.parameters import TwinParameters

__all__ = ["BenchTwin"]


class BenchTwin:
    """A simulated test bench.

    The twin starts with both sides free, clamp open, nothing mounted, drives disabled. It doesn't
    enforce interlocks (that is the bench's job); physics answers a wrong order: without the clamp
    there's no reaction, so no torque. Commands take effect at the next step of 1 ms, and the
    edges don't depend on how the time is cut into blocks.

    Signs: clockwise torque, speed and angle are positive on both sides; a side's torque is what
    the module applies to the mounted part. A reducer that drives a load has a positive input
    and a negative output torque at positive speed.

    With the calibrator or the verification standard mounted and clamped the flanges are held:
    ``command_torque`` loads them, ``command_speed`` turns the calibrator's shaft. With a reducer
    the last of the two commands decides whether the drive controls torque or speed.

    Parameters
    ----------
    parameters : TwinParameters
        All constants, see `TwinParameters.draw`.
    seed : int
        Seed of the noise while running; the constants have their own seed.
    timebase_hz : float
        Ticks per second of the counters' clock.
    active_channels : sequence of str
        Channels whose edges are made; an idle channel costs nothing.
    """

    def __init__(
        self,
        parameters: TwinParameters,
        seed: int = 0,
        *,
        timebase_hz: float = 100e6,
        active_channels: Sequence[Channel] = CHANNELS,
    ) -> None:
        _unfinished()

    # What a bench may know -----------------------------------------------------------------
    @property
    def time_s(self) -> float:
        """Bench time: seconds of the counters' clock since the start."""
        _unfinished()

    @property
    def tick(self) -> int:
        """Bench time in ticks: where the next block starts."""
        _unfinished()

    def nameplate(self, channel: Channel) -> Nameplate:
        """Nominal data of a transducer, as its data sheet gives them."""
        _unfinished()

    def certificate(self, side: Side) -> Certificate:
        """Certificate of the calibrator's reference transducer of one side."""
        _unfinished()

    # Commands ------------------------------------------------------------------------------
    def set_active_channels(self, channels: Sequence[Channel]) -> None:
        """Make edges only of these channels from now on."""
        _unfinished()

    def set_mode(self, side: Side, mode: Mode) -> None:
        """Couple the drive ("driven"), let the flange turn freely ("free") or lock the shaft.

        A locked shaft is held behind the transducer, so the transducer reads the reaction.
        """
        _unfinished()

    def set_clamped(self, clamped: bool) -> None:
        """Close or open the hydraulic clamp of the tested assembly."""
        _unfinished()

    def mount(self, what: Mounting) -> None:
        """Mount the calibrator, the verification standard, the reducer or nothing."""
        _unfinished()

    def enable(self, side: Side, enabled: bool) -> None:
        """Enable or disable a drive; a disabled drive gives no torque. Commands are forgotten."""
        _unfinished()

    def disable(self) -> None:
        """Emergency stop: both drives lose their torque at the next step."""
        _unfinished()

    def command_torque(self, side: Side, torque_nm: float) -> None:
        """Ask the drive for a torque; the loading accuracy decides what the flange gets."""
        _unfinished()

    def command_speed(self, side: Side, speed_rad_s: float) -> None:
        """Ask the drive for a speed."""
        _unfinished()

    def set_ambient(self, temperature_c: float) -> None:
        """Set the hall's temperature; the parts follow with their own time constants."""
        _unfinished()

    def inject_fault(
        self,
        channel: Channel | Side,
        kind: FaultKind,
        *,
        start_s: float | None = None,
        duration_s: float = 0.05,
        amount: float | None = None,
    ) -> None:
        """Break a channel for a while; for tests.

        Parameters
        ----------
        channel : str
            A channel with edges, or a side for "encoder_slip".
        kind : str
            "silent" no edges; "frozen" the frequency sticks at its last value; "missing_pulses"
            every ``amount``-th edge is lost (default 100); "doubled_pulses" every ``amount``-th
            edge gets a second one 200 ns later (default 100); "wild_value" the frequency jumps by
            ``amount`` of the zero frequency (default 0.2); "out_of_modulation" the frequency
            falls to ``amount`` of the zero frequency (default 0.1); "encoder_slip" ``amount``
            counts are lost once (default 1000).
        start_s : float, optional
            Bench time of the start; None: now.
        duration_s : float
            How long it lasts.
        amount : float, optional
            See ``kind``.
        """
        _unfinished()

    # Time ----------------------------------------------------------------------------------
    def advance(self, duration_s: float) -> TwinBlock:
        """Run the bench and deliver everything that its counters, encoders and probes saw."""
        _unfinished()

    def static_sweep(
        self,
        side: Side,
        true_torque_nm: FloatArray,
        *,
        temperature_c: float | None = None,
        speed_rad_s: float = 0.0,
        preload: bool = True,
    ) -> StaticSweep:
        """Noise-free quasi-static readings along a path of true torques, hysteresis included.

        Doesn't change the twin's state and needs nothing mounted. Uses the operators of the
        dynamic twin; creep, drift, noise and repeatability are left out.

        Parameters
        ----------
        side : str
            "input" or "output".
        true_torque_nm : float64[n]
            Path in order; branches follow from it.
        temperature_c : float, optional
            Temperature of the transducer; None: the reference temperature of the data sheet.
        speed_rad_s : float
            Speed of the shaft.
        preload : bool
            Run the path once before, so that the memory belongs to a preloaded transducer.

        Returns
        -------
        StaticSweep
            Readings of the module and of the reference, in the path's order.
        """
        _unfinished()


def _unfinished() -> NoReturn:
    raise NotImplementedError
