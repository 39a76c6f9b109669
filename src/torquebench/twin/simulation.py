"""The twin's simulations with the same operators: 1 ms steps in time, and static sweeps.

Numba's cache of a kernel checks only the kernel's own file: after a change in a file that these
kernels call, delete ``__pycache__/*.nb*`` in this folder, otherwise old code runs.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import inner, kernel
from torquebench.twin import calibrator, chain, counter, mechanism, thermal, transducer, turning
from torquebench.twin import drive as drv
from torquebench.twin import reducer as red
from torquebench.units import HOUR

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STEP_S = 1e-3
SUBSTEPS = 20  # 50 µs: a tenth of a radian of the stiffest mode, about 600 Hz
_DRAWS = 16


class Constants(NamedTuple):
    """All constants that the kernels read, pairs for input and output."""

    drives: tuple[drv.DriveConstants, drv.DriveConstants]
    chains: tuple[chain.ChainConstants, chain.ChainConstants]
    transducers: tuple[transducer.TransducerConstants, transducer.TransducerConstants]
    reducer: red.ReducerConstants
    thermal: thermal.ThermalConstants
    turning: tuple[turning.TurningConstants, turning.TurningConstants]


class State(NamedTuple):
    """All values that the kernels change; rows for input and output."""

    shafts: FloatArray  # [2, SHAFT_STATES]
    drives: FloatArray  # [2, DRIVE_STATES]
    transducers: FloatArray  # [2, TRANSDUCER_STATES]
    reducer: FloatArray  # [REDUCER_STATES]
    temperature_c: FloatArray  # [5]
    shaft_c: FloatArray  # [2] shaft temperatures that cause the transducers' gradient
    lubrication: FloatArray  # [2, LUBRICATION_STATES]
    raw_hz: FloatArray  # [4] frequency before the lag of the bandwidth
    lagged_hz: FloatArray  # [4] frequency after this lag


class Orders(NamedTuple):
    """The commanded state; rows for input and output."""

    conversion: IntArray  # [2]
    control: IntArray  # [2]
    target: FloatArray  # [2] torque in N·m or speed in rad/s
    held_speed_rad_s: FloatArray  # [2]
    inertia_kgm2: FloatArray  # [2] inertia assumed by the speed controller
    plant: IntArray  # [2] flange state, and whether a reference is mounted
    climate: FloatArray  # [CLIMATE]


class Recording(NamedTuple):
    """Output of a run of the kernel, on the 1 ms grid."""

    frequency_hz: FloatArray  # [4, steps + 1]
    torque_nm: FloatArray  # [2, steps]
    speed_rad_s: FloatArray  # [2, steps]
    angle_rad: FloatArray  # [2, steps]
    encoder_rad: FloatArray  # [2, steps]


def fresh_state(temperature_c: float) -> State:
    """Return the state of a bench that was never loaded."""
    return State(
        np.zeros((2, mechanism.SHAFT_STATES)),
        np.zeros((2, drv.DRIVE_STATES)),
        np.zeros((2, transducer.TRANSDUCER_STATES)),
        np.zeros(red.REDUCER_STATES),
        np.full(len(thermal.PLACES), temperature_c),
        np.full(2, temperature_c),
        np.array([turning.fresh_lubrication() for _ in range(2)]),
        np.zeros(4),
        np.zeros(4),
    )


def record(steps: int) -> Recording:
    """Return empty arrays for the recording of a run."""
    return Recording(
        np.empty((4, steps + 1)),
        np.empty((2, steps)),
        np.empty((2, steps)),
        np.empty((2, steps)),
        np.empty((2, steps)),
    )


@inner
def _added_torque(constants: Constants, state: State, orders: Orders, side: int) -> float:
    """Return the additional torque of a side's chain at its present torque, angle and speed."""
    if orders.conversion[side] == mechanism.CONVERSION_FREE:
        return 0.0
    row = state.shafts[side]
    angle, speed = row[mechanism.FLANGE_ANGLE], row[mechanism.FLANGE_SPEED]
    shaft = row[mechanism.SHAFT_TORQUE]
    warmth = state.temperature_c[thermal.INPUT_TRANSDUCER + side]
    thickness = turning.thickness(state.lubrication[side], warmth)
    added = chain.additional_torque(constants.chains[side], shaft, angle)
    added += chain.rotation_torque(constants.chains[side], speed, angle, thickness)
    return float(added - turning.drag(constants.turning[side], speed, shaft, thickness))


@inner
def _motor_torque(
    constants: Constants, state: State, orders: Orders, side: int, time_s: float, normal: float
) -> float:
    """Return the torque of a side's motor; a drive that isn't coupled to its shaft is off."""
    control = orders.control[side]
    if orders.conversion[side] != mechanism.CONVERSION_DRIVEN:
        control = drv.CONTROL_OFF
    return float(
        drv.drive_torque(
            constants.drives[side],
            state.drives[side],
            control,
            orders.target[side],
            orders.inertia_kgm2[side],
            state.shafts[side, mechanism.MOTOR_ANGLE],
            state.shafts[side, mechanism.MOTOR_SPEED],
            time_s,
            STEP_S,
            normal,
        )
    )


@inner
def _record_frequencies(state: State, recording: Recording, step: int) -> None:
    for channel in range(state.lagged_hz.size):
        recording.frequency_hz[channel, step] = state.lagged_hz[channel]


@inner
def _record_state(constants: Constants, state: State, recording: Recording, step: int) -> None:
    """Record the present state: truth, encoders, and the frequencies of all channels."""
    _record_frequencies(state, recording, step)
    for side in range(2):
        row = state.shafts[side]
        compliance = constants.drives[side].encoder_compliance_rad_nm
        recording.torque_nm[side, step] = row[mechanism.INTERFACE_TORQUE]
        recording.speed_rad_s[side, step] = row[mechanism.FLANGE_SPEED]
        recording.angle_rad[side, step] = row[mechanism.FLANGE_ANGLE]
        twist = compliance * row[mechanism.SHAFT_TORQUE]
        recording.encoder_rad[side, step] = row[mechanism.FLANGE_ANGLE] + twist


@inner
def _signals(
    constants: Constants,
    references: tuple[calibrator.ReferenceConstants, calibrator.ReferenceConstants],
    tables: FloatArray,
    state: State,
    mounted: bool,
    normal: FloatArray,
) -> None:
    """Return the frequencies of all four channels in the present state."""
    for side in range(2):
        row = state.shafts[side]
        constant = constants.transducers[side]
        signal = transducer.transducer_signal(
            constant,
            state.transducers[side],
            row[mechanism.SHAFT_TORQUE],
            state.temperature_c[thermal.INPUT_TRANSDUCER + side],
            row[mechanism.MOTOR_SPEED],
            STEP_S,
            normal[5 * side : 5 * side + 5],
        )
        signal += constant.nominal_torque_nm * turning.signal_shift(
            constants.turning[side],
            row[mechanism.SHAFT_TORQUE] / constant.nominal_torque_nm,
            state.temperature_c[thermal.INPUT_TRANSDUCER + side],
            state.shaft_c[side],
            row[mechanism.MOTOR_SPEED],
        )
        before = state.raw_hz[side]
        state.raw_hz[side] = transducer.transducer_frequency(constant, signal)
        state.lagged_hz[side] = counter.lagged(
            state.lagged_hz[side], before, state.raw_hz[side], constant.lag_s, STEP_S
        )
        if mounted:
            reference = references[side]
            indication = calibrator.reference_indication(
                reference,
                tables[side],
                row[mechanism.INTERFACE_TORQUE],
                state.temperature_c[thermal.CALIBRATOR],
                normal[10 + side],
            )
            before = state.raw_hz[2 + side]
            sensitivity = reference.sensitivity_hz_per_nm
            state.raw_hz[2 + side] = reference.zero_hz + sensitivity * indication
            state.lagged_hz[2 + side] = counter.lagged(
                state.lagged_hz[2 + side],
                before,
                state.raw_hz[2 + side],
                reference.lag_s,
                STEP_S,
            )


@kernel
def obey(
    constants: Constants, state: State, orders: Orders, side: int, torque_nm: float, speed: float
) -> None:
    """Execute a command: a torque at the flange, or a speed in rad/s; the other value is NaN."""
    if not math.isnan(torque_nm):
        angle = state.shafts[side, mechanism.FLANGE_ANGLE]
        orders.control[side] = drv.CONTROL_TORQUE
        orders.target[side] = chain.transducer_torque(constants.chains[side], torque_nm, angle)
    elif orders.plant[0] != mechanism.FLANGE_HELD:
        orders.control[side] = drv.CONTROL_SPEED
        orders.target[side] = speed
    else:
        orders.held_speed_rad_s[side] = speed
        if orders.control[side] == drv.CONTROL_OFF:
            orders.control[side] = drv.CONTROL_TORQUE
            orders.target[side] = 0.0


@kernel
def simulate(
    first_step: int,
    steps: int,
    told_at: IntArray,
    told: FloatArray,
    constants: Constants,
    references: tuple[calibrator.ReferenceConstants, calibrator.ReferenceConstants],
    tables: FloatArray,
    orders: Orders,
    state: State,
    generator: np.random.Generator,
    recording: Recording,
    offset: int,
) -> None:
    """Run the bench for some steps; changes the state, and fills the recording from `offset` on.

    Parameters
    ----------
    told_at : int64[n, 2], told : float64[n, 2]
        Commands in order, see `obey`: step before which a command is given, and its side; torque
        and speed.
    """
    commands = 0
    motor, added, speed = np.zeros(2), np.zeros(2), np.zeros(2)
    normal = np.zeros(_DRAWS)
    for step in range(steps):
        while commands < len(told_at) and told_at[commands, 0] <= first_step + step:
            side, torque_nm, wanted = told_at[commands, 1], told[commands, 0], told[commands, 1]
            obey(constants, state, orders, side, torque_nm, wanted)
            commands += 1
        for k in range(_DRAWS):
            normal[k] = generator.standard_normal()
        _record_state(constants, state, recording, offset + step)
        time_s = (first_step + step) * STEP_S
        for side in range(2):
            speed[side] = state.shafts[side, mechanism.MOTOR_SPEED]
            added[side] = _added_torque(constants, state, orders, side)
            motor[side] = _motor_torque(constants, state, orders, side, time_s, normal[12 + side])
        mechanism.move(
            constants.drives,
            constants.reducer,
            state.shafts,
            state.reducer,
            orders.conversion,
            orders.plant[0],
            motor,
            added,
            orders.held_speed_rad_s,
            state.temperature_c[thermal.REDUCER],
            STEP_S,
            SUBSTEPS,
        )
        for side in range(2):  # the chain's additional torque at the end of the step
            change = _added_torque(constants, state, orders, side) - added[side]
            if orders.plant[0] != mechanism.FLANGE_LOOSE:
                state.shafts[side, mechanism.INTERFACE_TORQUE] += change
        thermal.warm(
            constants.thermal,
            state.temperature_c,
            thermal.hall_c(orders.climate, time_s),
            speed,
            state.reducer[red.LOSS_J],
            STEP_S,
            normal[14],
        )
        state.reducer[red.LOSS_J] = 0.0
        for side in range(2):
            warmth = state.temperature_c[thermal.INPUT_TRANSDUCER + side] - state.shaft_c[side]
            state.shaft_c[side] += STEP_S / constants.turning[side].gradient_time_s * warmth
            if abs(state.shafts[side, mechanism.FLANGE_SPEED]) > 1e-3:
                state.lubrication[side, turning.HOURS] += STEP_S / HOUR
        _signals(constants, references, tables, state, orders.plant[1] == 1, normal)
    _record_frequencies(state, recording, offset + steps)
    for k in range(commands, len(told_at)):
        obey(constants, state, orders, told_at[k, 1], told[k, 0], told[k, 1])


@kernel
def sweep(
    chain_constants: chain.ChainConstants,
    transducer_constants: transducer.TransducerConstants,
    turning_constants: turning.TurningConstants,
    reference: calibrator.ReferenceConstants,
    table: FloatArray,
    path_nm: FloatArray,
    temperature_c: float,
    speed_rad_s: float,
    angle_rad: float,
    state: FloatArray,
    frequency_hz: FloatArray,
    reference_hz: FloatArray,
) -> None:
    """Write noise-free frequencies along a path of true torques; changes the transducer's state."""
    silent = np.zeros(transducer.NOISES)
    for k in range(path_nm.size):
        torque = chain.transducer_torque(chain_constants, path_nm[k], angle_rad)
        signal = transducer.transducer_signal(
            transducer_constants, state, torque, temperature_c, speed_rad_s, 0.0, silent
        )
        signal += transducer_constants.nominal_torque_nm * turning.signal_shift(
            turning_constants,
            torque / transducer_constants.nominal_torque_nm,
            temperature_c,
            temperature_c,
            speed_rad_s,
        )
        frequency_hz[k] = transducer.transducer_frequency(transducer_constants, signal)
        indication = calibrator.reference_indication(reference, table, path_nm[k], 23.0, 0.0)
        reference_hz[k] = reference.zero_hz + reference.sensitivity_hz_per_nm * indication
