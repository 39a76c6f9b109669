"""The bench's twin: it takes commands and delivers edges and counts, with known true torque."""

from collections.abc import Callable, Sequence

import numpy as np

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.twin import mechanism, readout, simulation
from torquebench.twin import reducer as red
from torquebench.twin import thermal as heat
from torquebench.twin.blocks import (
    CHANNELS,
    MODES,
    MOUNTINGS,
    SIDES,
    Certificate,
    Channel,
    FaultKind,
    FloatArray,
    Mode,
    Mounting,
    Nameplate,
    Side,
    StaticSweep,
    TickArray,
    Truth,
    TwinBlock,
)
from torquebench.twin.calibrator import ReferenceParameters
from torquebench.twin.chain import without_chain
from torquebench.twin.drive import CONTROL_OFF, Loading
from torquebench.twin.faults import Fault, broken_edges, broken_frequency, make_fault
from torquebench.twin.parameters import TwinParameters
from torquebench.twin.reducer import ReducerConstants
from torquebench.twin.reducer_truth import true_no_load_nm
from torquebench.twin.turning import LubricantName, fresh_lubrication
from torquebench.units import HOUR, MINUTE

_ENCODERS = 7  # separates the draws of the encoders' certificates from all others
_CONVERSION = {
    "free": mechanism.CONVERSION_FREE,
    "driven": mechanism.CONVERSION_DRIVEN,
    "locked": mechanism.CONVERSION_LOCKED,
}


class BenchTwin:
    """A simulated test bench.

    The twin starts with both sides free, clamp open, nothing mounted and drives disabled. It
    doesn't enforce interlocks (the bench does); a wrong command has its physical effect: without
    the clamp there is no reaction and no torque. Commands take effect at the next step of 1 ms, and
    the edges don't depend on how the time is divided into blocks.

    Signs: clockwise torque, speed and angle are positive on both sides; a side's torque is what
    the module applies to the mounted part. A reducer that drives a load has a positive input
    and a negative output torque at positive speed.

    With the calibrator or the verification standard mounted and clamped, the flanges are fixed:
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
        Channels whose edges are generated; an unused channel costs nothing.
    """

    def __init__(
        self,
        parameters: TwinParameters,
        seed: int = 0,
        *,
        timebase_hz: float = 100e6,
        active_channels: Sequence[Channel] = CHANNELS,
    ) -> None:
        step_ticks = timebase_hz * simulation.STEP_S
        if step_ticks != round(step_ticks) or step_ticks < 1.0:
            raise InputError(
                Message("timebase {timebase_hz} Hz", timebase_hz), "a whole multiple of 1000 Hz"
            )
        self._parameters = parameters
        self._sides = (parameters.input, parameters.output)
        self._timebase_hz = timebase_hz
        self._step_ticks = round(step_ticks)
        self._tick = 0
        self._steps = 0
        streams = np.random.default_rng(seed).spawn(4 + len(CHANNELS))
        self._process, self._mounting_draws = streams[:2]
        self._loading = [
            Loading(side.drive, stream)
            for side, stream in zip(self._sides, streams[2:4], strict=True)
        ]
        self._sources = readout.new_sources(parameters, streams[4:], timebase_hz, self._step_ticks)
        self._mounting: Mounting = "nothing"
        self._clamped = False
        self._enabled = [False, False]
        self._faults: list[Fault] = []
        self._run_into: simulation.Recording | None = None  # used while time passes
        self._run_from = 0  # first step of this recording
        self._told_at: list[tuple[int, int]] = []
        self._told: list[tuple[float, float]] = []
        self._constants = self._gather((0.0, 0.0))
        self._references = self._reference_set("calibrator")
        self._tables = np.array([reference.error_table() for reference in self._references])
        self._orders = simulation.Orders(
            conversion=np.zeros(2, dtype=np.int64),
            control=np.zeros(2, dtype=np.int64),
            target=np.zeros(2),
            held_speed_rad_s=np.zeros(2),
            inertia_kgm2=np.ones(2),
            plant=np.zeros(2, dtype=np.int64),
            climate=_climate(parameters.thermal.ambient_c),
        )
        self._state = simulation.fresh_state(parameters.thermal.ambient_c)
        for k, channel in enumerate(CHANNELS):
            self._state.raw_hz[k] = self._state.lagged_hz[k] = self._zero_hz(channel)
        self._active: tuple[Channel, ...] = ()
        self.set_active_channels(active_channels)
        for channel in ("input_torque", "output_torque"):
            self._sources[channel].begin(self._zero_hz(channel))
        self._settle_plant()
        self._compile()

    def _compile(self) -> None:
        """Compile the largest kernel, by a run without steps, before anything waits for a block."""
        self._run_into = simulation.record(0)
        self._catch_up()
        self._run_into = None

    # Data known to a bench --------------------------------------------------------------
    @property
    def time_s(self) -> float:
        """Bench time: seconds of the counters' clock since the start."""
        return self._tick / self._timebase_hz

    @property
    def tick(self) -> int:
        """Bench time in ticks: the start of the next block."""
        return self._tick

    def nameplate(self, channel: Channel) -> Nameplate:
        """Nominal data of a transducer, as its data sheet gives them."""
        return readout.nameplate(self._parameters, channel)

    def certificate(self, side: Side) -> Certificate:
        """Certificate of the calibrator's reference transducer of one side."""
        return self._sides[_index(side)].calibrator.certificate()

    def encoder_certificate(self, side: Side) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Certificate of one side's encoder: indicated angle, error, expanded uncertainty, rad."""
        index = _index(side)
        generator = np.random.default_rng([self._parameters.seed, index, _ENCODERS])
        return readout.encoder_certificate(self._sides[index].encoder, generator)

    # Commands ------------------------------------------------------------------------------
    def set_active_channels(self, channels: Sequence[Channel]) -> None:
        """Generate edges of these channels only, from now on."""
        unknown = set(channels) - set(CHANNELS)
        if unknown:
            raise InputError(
                Message("channels {unknown}", sorted(unknown)),
                Message("some of {channels}", ", ".join(CHANNELS)),
            )
        for channel in set(channels) - set(self._active):
            self._sources[channel].forget()
        self._active = tuple(channel for channel in CHANNELS if channel in channels)

    def set_mode(self, side: Side, mode: Mode) -> None:
        """Couple the drive ("driven"), let the flange turn freely ("free") or lock the shaft.

        A locked shaft is held beyond the transducer, so the transducer measures the reaction.
        """
        index = _index(side)
        if mode not in MODES:
            raise InputError(
                Message("mode {mode!r}", mode), Message("one of {list}", ", ".join(MODES))
            )
        conversion = _CONVERSION[mode]
        if self._orders.conversion[index] == conversion:
            return
        self._catch_up()
        self._orders.conversion[index] = conversion
        row = self._state.shafts[index]
        row[mechanism.RELAXED] = row[mechanism.MOTOR_ANGLE] - row[mechanism.FLANGE_ANGLE]
        row[mechanism.SHAFT_TORQUE] = 0.0
        self._settle_inertia()

    def set_clamped(self, clamped: bool) -> None:
        """Close or open the hydraulic clamp of the tested assembly."""
        if clamped != self._clamped:
            self._catch_up()
            self._clamped = clamped
            self._settle_plant()

    def mount(self, what: Mounting) -> None:
        """Mount the calibrator, the verification standard, the reducer or nothing."""
        if what not in MOUNTINGS:
            raise InputError(
                Message("mounting {what!r}", what), Message("one of {list}", ", ".join(MOUNTINGS))
            )
        if what == self._mounting:
            return
        self._catch_up()
        self._mounting = what
        if what in ("calibrator", "verification_standard"):
            self._references = self._reference_set(what)
            self._tables = np.array([reference.error_table() for reference in self._references])
        spread = self._parameters.reseating * self._mounting_draws.standard_normal(2)
        self._constants = self._gather((float(spread[0]), float(spread[1])))
        for side in SIDES:
            self._forget(side)
        self._settle_plant()

    def hold(self, reducer: ReducerConstants) -> None:
        """Select another reducer to be tested; it replaces a mounted one."""
        self._parameters = self._parameters.with_reducer(reducer)
        if self._mounting == "reducer":
            self.mount("nothing")
            self.mount("reducer")

    def enable(self, side: Side, enabled: bool) -> None:
        """Enable or disable a drive; a disabled drive gives no torque. Commands are cleared."""
        self._catch_up()
        self._enabled[_index(side)] = enabled
        self._forget(side)

    def disable(self) -> None:
        """Emergency stop: both drives lose their torque at the next step."""
        for side in SIDES:
            self.enable(side, enabled=False)

    def command_torque(self, side: Side, torque_nm: float) -> None:
        """Command a torque; the flange gets it with the drive's loading accuracy."""
        index = _index(side)
        torque = _finite(torque_nm, "torque", "N·m")
        if not self._enabled[index]:
            return
        self._tell(index, torque + self._loading[index].error(torque), np.nan)

    def command_speed(self, side: Side, speed_rad_s: float) -> None:
        """Command a speed of the drive."""
        index = _index(side)
        speed = _finite(speed_rad_s, "speed", "rad/s")
        if not self._enabled[index]:
            return
        self._tell(index, np.nan, speed)

    def set_climate(
        self,
        mean_c: float,
        *,
        swing_k: float = 0.0,
        period_h: float = 24.0,
        drop_k: float = 0.0,
        drop_every_h: float = 1.0,
        drop_min: float = 10.0,
    ) -> None:
        """Vary the hall's temperature: a daily swing, and drops as when a gate is opened.

        Before the first block, all parts get the mean temperature.

        Parameters
        ----------
        mean_c : float
            Middle of the swing.
        swing_k, period_h : float
            Amplitude of the swing, which begins upwards now, and its period.
        drop_k, drop_every_h, drop_min : float
            Depth of a drop, interval between drops, and duration of a drop.
        """
        _finite(mean_c, "temperature", "°C")
        if not (swing_k >= 0.0 and drop_k >= 0.0 and min(period_h, drop_every_h, drop_min) > 0.0):
            raise InputError(
                Message(
                    "a climate with a swing of {swing_k} K in {period_h} h and drops of "
                    "{drop_k} K for {drop_min} min every {drop_every_h} h",
                    swing_k,
                    period_h,
                    drop_k,
                    drop_min,
                    drop_every_h,
                ),
                "sizes of at least 0 K, times above 0",
            )
        self._catch_up()
        self._orders.climate[:] = _climate(
            mean_c, swing_k, period_h, self.time_s, drop_k, drop_every_h, drop_min
        )
        if self._tick == 0:
            self._state.temperature_c[:] = mean_c
            self._state.shaft_c[:] = mean_c

    def soak(self, temperature_c: float, *, shafts_behind_k: float = 0.0) -> None:
        """Set the hall and all parts to a temperature, as after many hours.

        Parameters
        ----------
        shafts_behind_k : float
            Temperature difference of transducers and shafts, as during warming.
        """
        self.set_climate(temperature_c)
        self._state.temperature_c[:] = temperature_c
        self._state.shaft_c[:] = temperature_c - _finite(shafts_behind_k, "temperature", "K")

    def lubricate(
        self,
        side: Side,
        lubricant: LubricantName = "grease",
        *,
        amount: float = 1.0,
        hours: float = 0.0,
    ) -> None:
        """Refill the bearings between transducer and flange of a side.

        Parameters
        ----------
        side : str
            "input" or "output".
        lubricant : {"grease", "thin-grease", "oil"}
        amount : float
            Amount as a share of the specified value.
        hours : float
            Hours of turning since it was filled; fresh lubricant runs in.
        """
        self._catch_up()
        self._state.lubrication[_index(side)] = fresh_lubrication(lubricant, amount, hours)

    def inject_fault(
        self,
        channel: Channel | Side,
        kind: FaultKind,
        *,
        start_s: float | None = None,
        duration_s: float = 0.05,
        amount: float | None = None,
    ) -> None:
        """Inject a fault into a channel for some time; for tests.

        Parameters
        ----------
        channel : str
            A channel with edges, or a side for "encoder_slip".
        kind : str
            "silent" no edges; "frozen" the frequency sticks at its last value; "missing_pulses"
            every ``amount``-th edge is lost (default 100); "doubled_pulses" every ``amount``-th
            edge gets a second one 200 ns later (default 100); "outlier" the frequency jumps by
            ``amount`` of the zero frequency (default 0.2); "wrong_span" its distance from the zero
            frequency is ``amount`` times as large (default 1.03); "out_of_modulation" the frequency
            falls to ``amount`` of the zero frequency (default 0.1); "encoder_slip" ``amount``
            counts are lost once (default 1000).
        start_s : float, optional
            Bench time of the start; None: now.
        duration_s : float
            Duration of the fault.
        amount : float, optional
            See ``kind``.
        """
        start = self._tick if start_s is None else round(start_s * self._timebase_hz)
        stop = start + round(duration_s * self._timebase_hz)
        self._faults.append(make_fault(channel, kind, start, stop, amount))

    # Time ----------------------------------------------------------------------------------
    def advance(
        self, duration_s: float, drive: Callable[[float], float] | None = None
    ) -> TwinBlock:
        """Run the bench, and return the data of its counters, encoders and probes.

        Parameters
        ----------
        duration_s : float
            Duration in bench time.
        drive : callable, optional
            Function that gives commands while the block runs: called with the remaining time, s, it
            returns the time until its next call. Several shorter blocks give the same result with
            more work.
        """
        if not duration_s > 0.0:
            raise InputError(Message("duration {duration_s} s", duration_s), "a duration above 0 s")
        start_tick = self._tick
        stop_tick = start_tick + max(1, round(duration_s * self._timebase_hz))
        first = self._steps
        steps = -(-stop_tick // self._step_ticks) - first
        recording = simulation.record(steps)
        self._run_into, self._run_from = recording, first
        try:
            while self._tick < stop_tick:
                left = stop_tick - self._tick
                if drive is not None:
                    wish_s = drive(left / self._timebase_hz)
                    left = min(left, max(1, round(wish_s * self._timebase_hz)))
                self._tick += left
            self._catch_up()
        finally:
            self._run_into = None
        edges = {channel: self._edges(channel, first, recording) for channel in self._active}
        ticks = np.arange(first, first + steps, dtype=np.int64) * self._step_ticks
        temperature = dict(zip(heat.PLACES, self._state.temperature_c.tolist(), strict=True))
        probe_error = dict(zip(heat.PLACES, self._parameters.thermal.probe_error_k, strict=True))
        return TwinBlock(
            start_tick=start_tick,
            stop_tick=self._tick,
            timebase_hz=self._timebase_hz,
            edges=edges,
            angles={
                side: readout.encoder_samples(
                    self._sides[k].encoder,
                    recording.encoder_rad[k],
                    ticks,
                    self._timebase_hz,
                    [fault for fault in self._faults if fault.channel == side],
                )
                for k, side in enumerate(SIDES)
            },
            temperatures={name: temperature[name] + probe_error[name] for name in heat.PLACES},
            truth=Truth(
                ticks / self._timebase_hz,
                {side: recording.torque_nm[k] for k, side in enumerate(SIDES)},
                {side: recording.speed_rad_s[k] for k, side in enumerate(SIDES)},
                {side: recording.angle_rad[k] for k, side in enumerate(SIDES)},
                temperature,
            ),
        )

    def no_load_nm(self, speed_rpm: FloatArray) -> FloatArray:
        """Return the reducer's no-load torque at input speeds, output free, at 23 °C, N·m."""
        return true_no_load_nm(self._parameters.reducer, speed_rpm, 23.0)

    def static_sweep(
        self,
        side: Side,
        true_torque_nm: FloatArray,
        *,
        temperature_c: float | None = None,
        speed_rad_s: float = 0.0,
        preload: bool = True,
        alone: bool = False,
    ) -> StaticSweep:
        """Return noise-free quasi-static readings along a path of true torques, with hysteresis.

        The twin's state doesn't change, and nothing needs to be mounted. The operators of the
        dynamic twin are used, without creep, drift, noise and repeatability.

        Parameters
        ----------
        side : str
            "input" or "output".
        true_torque_nm : float64[n]
            Path in order, which determines the branches.
        temperature_c : float, optional
            Temperature of the transducer; None: the reference temperature of the data sheet.
        speed_rad_s : float
            Speed of the shaft.
        preload : bool
            Whether to run the path once before, so that the hysteresis is that of a preloaded
            transducer.
        alone : bool
            Whether the transducer is by itself, as a laboratory calibrates it.

        Returns
        -------
        StaticSweep
            Readings of the module and of the reference, in the path's order.
        """
        index = _index(side)
        chain = self._constants.chains[index]
        return readout.static_sweep(
            without_chain(chain) if alone else chain,
            self._constants.transducers[index],
            self._constants.turning[index],
            self._references[index],
            self.nameplate("input_torque" if side == "input" else "output_torque"),
            true_torque_nm,
            temperature_c=temperature_c,
            speed_rad_s=speed_rad_s,
            angle_rad=float(self._state.shafts[index, mechanism.FLANGE_ANGLE]),
            preload=preload,
        )

    # Inside --------------------------------------------------------------------------------
    def _tell(self, index: int, torque_nm: float, speed_rad_s: float) -> None:
        """Give a command: at once, or at its step while a block is running."""
        if self._run_into is None:
            constants, state, orders = self._constants, self._state, self._orders
            simulation.obey(constants, state, orders, index, torque_nm, speed_rad_s)
        else:
            self._told_at.append((-(-self._tick // self._step_ticks), index))
            self._told.append((torque_nm, speed_rad_s))

    def _catch_up(self) -> None:
        """Simulate up to the present tick, with one kernel call for all commands until then."""
        if self._run_into is None:
            return
        steps = -(-self._tick // self._step_ticks) - self._steps
        simulation.simulate(
            self._steps,
            steps,
            np.array(self._told_at, dtype=np.int64).reshape(-1, 2),
            np.array(self._told, dtype=np.float64).reshape(-1, 2),
            self._constants,
            (self._references[0].constants, self._references[1].constants),
            self._tables,
            self._orders,
            self._state,
            self._process,
            self._run_into,
            self._steps - self._run_from,
        )
        self._told_at.clear()
        self._told.clear()
        self._steps += steps

    def _reference_set(self, what: Mounting) -> tuple[ReferenceParameters, ReferenceParameters]:
        first, second = self._sides
        if what == "verification_standard":
            return first.verification_standard, second.verification_standard
        return first.calibrator, second.calibrator

    def _zero_hz(self, channel: Channel) -> float:
        index = _index(readout.side_of(channel))
        if channel.endswith("torque"):
            return self._sides[index].transducer.zero_hz
        return self._references[index].constants.zero_hz

    def _gather(self, reseated: tuple[float, float]) -> simulation.Constants:
        """Return the constants for the kernels; a new mounting changes each chain's linear part."""
        chains = [
            side.chain._replace(
                linear=(side.chain.linear[0] + change, side.chain.linear[1] + change)
            )
            for side, change in zip(self._sides, reseated, strict=True)
        ]
        first, second = self._sides
        return simulation.Constants(
            (first.drive, second.drive),
            (chains[0], chains[1]),
            (first.transducer, second.transducer),
            self._parameters.reducer,
            self._parameters.thermal,
            (first.turning, second.turning),
        )

    def _forget(self, side: Side) -> None:
        """Clear a side's commands."""
        index = _index(side)
        self._orders.control[index] = CONTROL_OFF
        self._orders.target[index] = 0.0
        self._orders.held_speed_rad_s[index] = 0.0

    def _settle_plant(self) -> None:
        """Set the shafts to rest without torque, after a change of the mounting."""
        measured = self._mounting in ("calibrator", "verification_standard")
        if not self._clamped or self._mounting == "nothing":
            flange = mechanism.FLANGE_LOOSE
        else:
            flange = mechanism.FLANGE_HELD if measured else mechanism.FLANGE_COUPLED
        self._orders.plant[:] = flange, int(measured)
        shafts, reducer = self._state.shafts, self._parameters.reducer
        shafts[:, mechanism.MOTOR_SPEED] = 0.0
        shafts[:, mechanism.FLANGE_SPEED] = 0.0
        shafts[:, mechanism.SHAFT_TORQUE] = 0.0
        shafts[:, mechanism.INTERFACE_TORQUE] = 0.0
        angle = shafts[:, mechanism.FLANGE_ANGLE]
        shafts[:, mechanism.RELAXED] = shafts[:, mechanism.MOTOR_ANGLE] - angle
        self._state.reducer[:] = 0.0
        error, _ = red.transmission_error(reducer, float(angle[1]))
        self._state.reducer[red.GEAR_OFFSET] = angle[1] - angle[0] / reducer.ratio - error
        for k, channel in enumerate(CHANNELS[2:], start=2):
            if not measured:
                self._state.raw_hz[k] = self._state.lagged_hz[k] = self._zero_hz(channel)
        self._settle_inertia()

    def _settle_inertia(self) -> None:
        """Set the inertia that each speed controller moves, referred to its own flange, kg·m²."""
        drives, reducer = self._constants.drives, self._parameters.reducer
        own = [drive.motor_inertia_kgm2 + drive.flange_inertia_kgm2 for drive in drives]
        self._orders.inertia_kgm2[:] = own
        if self._orders.plant[0] != mechanism.FLANGE_COUPLED:
            return
        turned = [drive.flange_inertia_kgm2 for drive in drives]
        for k in range(2):
            if self._orders.conversion[k] == mechanism.CONVERSION_DRIVEN:
                turned[k] = own[k]
        input_total = turned[0] + reducer.input_inertia_kgm2
        output_total = turned[1] + reducer.output_inertia_kgm2
        square = reducer.ratio**2
        self._orders.inertia_kgm2[0] = input_total + output_total / square
        self._orders.inertia_kgm2[1] = output_total + input_total * square

    def _edges(self, channel: Channel, first: int, recording: simulation.Recording) -> TickArray:
        """Return the edges of one channel up to the present tick, with its faults."""
        source = self._sources[channel]
        faults = [fault for fault in self._faults if fault.channel == channel]
        steps = recording.torque_nm.shape[1]
        if steps and (channel.endswith("torque") or self._orders.plant[1]):
            frequency = recording.frequency_hz[CHANNELS.index(channel)]
            if faults:
                ticks = np.arange(first, first + steps + 1, dtype=np.int64) * self._step_ticks
                frequency = broken_frequency(faults, frequency, ticks, self._zero_hz(channel))
            source.run(first, frequency)
        taken, number = source.take(self._tick)
        if not faults:
            return taken
        edges = broken_edges(faults, taken, number, self._timebase_hz)
        return edges[edges < self._tick]  # a doubled last edge would be late


def _index(side: str) -> int:
    if side not in SIDES:
        raise InputError(Message("side {side!r}", side), Message("one of {list}", ", ".join(SIDES)))
    return SIDES.index(side)


def _climate(
    mean_c: float,
    swing_k: float = 0.0,
    period_h: float = 24.0,
    start_s: float = 0.0,
    drop_k: float = 0.0,
    drop_every_h: float = 1.0,
    drop_min: float = 10.0,
) -> FloatArray:
    """Return the parameters of the room's temperature as the kernels take them."""
    return np.array(
        [
            mean_c,
            swing_k,
            HOUR * period_h,
            start_s,
            drop_k,
            HOUR * drop_every_h,
            MINUTE * drop_min,
        ]
    )


def _finite(value: float, name: str, unit: str) -> float:
    if not np.isfinite(value):
        raise InputError(Message("{name} {value} {unit}", name, value, unit), "a finite number")
    return float(value)
