"""Motion: motor, shaft, flange on both sides, and the reducer between them."""

import math

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import inner
from torquebench.twin import reducer as red
from torquebench.twin.drive import DriveConstants
from torquebench.twin.reducer import ReducerConstants

FloatArray = NDArray[np.float64]

CONVERSION_FREE = 0
CONVERSION_DRIVEN = 1
CONVERSION_LOCKED = 2

FLANGE_LOOSE = 0
FLANGE_HELD = 1
FLANGE_COUPLED = 2

# Indices of a side's row in the shaft state array.
MOTOR_ANGLE = 0
MOTOR_SPEED = 1
FLANGE_ANGLE = 2
FLANGE_SPEED = 3
RELAXED = 4  # motor angle minus flange angle without torque
SHAFT_TORQUE = 5  # torque at the transducer
INTERFACE_TORQUE = 6  # true torque that the module applies to the mounted part
SHAFT_STATES = 7


@inner
def _shaft_torque(drive: DriveConstants, row: FloatArray, conversion: int) -> float:
    """Return the torque that a twisted shaft passes on; 0 if the side turns freely."""
    if conversion == CONVERSION_FREE:
        return 0.0
    twist = row[MOTOR_ANGLE] - row[FLANGE_ANGLE] - row[RELAXED]
    speed = row[MOTOR_SPEED] - row[FLANGE_SPEED]
    return float(drive.stiffness_nm_rad * twist + drive.damping_nm_s * speed)


@inner
def _turn_motor(
    drive: DriveConstants, row: FloatArray, conversion: int, net_nm: float, step_s: float
) -> None:
    """Advance a motor's speed and angle in `row` by one step; a locked one stands still."""
    if conversion == CONVERSION_LOCKED:
        row[MOTOR_SPEED] = 0.0
        return
    row[MOTOR_SPEED] += step_s * net_nm / drive.motor_inertia_kgm2
    row[MOTOR_ANGLE] += step_s * row[MOTOR_SPEED]


@inner
def _turn_uncoupled_flange(
    drive: DriveConstants,
    row: FloatArray,
    flange: int,
    driven: bool,
    torque_nm: float,
    held_speed_rad_s: float,
    step_s: float,
) -> float:
    """Advance a fixed, turned or loose flange by one step in `row`; return its dω/dt.

    A loose flange that its motor drives has only bearing drag, as with a mounted part; this drag is
    in `torque_nm`. Without the drive it coasts against the motor's friction.
    """
    if flange == FLANGE_HELD:
        wanted = drive.bandwidth_rad_s * (held_speed_rad_s - row[FLANGE_SPEED])
        largest = drive.acceleration_rad_s2
        acceleration = min(largest, max(-largest, wanted))
    else:
        drag = 0.0
        if not driven:
            drag = drive.drag_nm * math.tanh(row[FLANGE_SPEED] / 0.05)
            drag += drive.drag_viscous_nm_s * row[FLANGE_SPEED]
        acceleration = (torque_nm - drag) / drive.flange_inertia_kgm2
    row[FLANGE_SPEED] += step_s * acceleration
    row[FLANGE_ANGLE] += step_s * row[FLANGE_SPEED]
    return float(acceleration)


@inner
def move(
    drives: tuple[DriveConstants, DriveConstants],
    reducer: ReducerConstants,
    shafts: FloatArray,
    reducer_state: FloatArray,
    conversion: NDArray[np.int64],
    flange: int,
    motor_nm: FloatArray,
    added_nm: FloatArray,
    held_speed_rad_s: FloatArray,
    temperature_c: float,
    step_s: float,
    substeps: int,
) -> None:
    """Advance the motion by one step, in substeps of symplectic Euler.

    Parameters
    ----------
    drives, reducer : DriveConstants, ReducerConstants
        Constants.
    shafts : float64[2, SHAFT_STATES], reducer_state : float64[REDUCER_STATES]
        State, changed in place. Its torques belong to the end of the step.
    conversion : int64[2]
        CONVERSION_FREE, _DRIVEN or _LOCKED of both sides.
    flange : int
        FLANGE_LOOSE, _HELD or _COUPLED.
    motor_nm, added_nm, held_speed_rad_s : float64[2]
        Motor torque, additional torque of the chain, and speed that a fixed flange is given.
    temperature_c : float
        Of the reducer.
    step_s, substeps : float, int
        Duration of the step, and number of substeps.
    """
    short = step_s / substeps
    torque = np.zeros(2)
    acceleration = np.zeros(2)
    error, slope = red.transmission_error(reducer, shafts[1, FLANGE_ANGLE])
    error_angle = shafts[1, FLANGE_ANGLE]
    coulomb, viscous = red.temperature_factors(reducer, temperature_c)
    for _ in range(substeps):
        for side in range(2):
            row = shafts[side]
            shaft = _shaft_torque(drives[side], row, conversion[side])
            _turn_motor(drives[side], row, conversion[side], motor_nm[side] - shaft, short)
            torque[side] = shaft + added_nm[side]
            if flange != FLANGE_COUPLED:
                acceleration[side] = _turn_uncoupled_flange(
                    drives[side],
                    row,
                    flange,
                    conversion[side] == CONVERSION_DRIVEN,
                    torque[side],
                    held_speed_rad_s[side],
                    short,
                )
        if flange == FLANGE_COUPLED:
            ahead, behind = shafts[0], shafts[1]
            # twist of the reducer; its transmission error is linear in the angle within a step
            drift = slope * (behind[FLANGE_ANGLE] - error_angle)
            twist = ahead[FLANGE_ANGLE] / reducer.ratio + error + drift
            twist += reducer_state[red.GEAR_OFFSET] - behind[FLANGE_ANGLE]
            twist_speed = ahead[FLANGE_SPEED] / reducer.ratio
            twist_speed += (slope - 1.0) * behind[FLANGE_SPEED]
            gear = red.reducer_torque(reducer, reducer_state, twist, twist_speed)
            # losses of both sides
            friction = red.reducer_friction(
                reducer, reducer_state, ahead[FLANGE_SPEED], gear, coulomb, viscous, short
            )
            drag = reducer.output_drag_nm * math.tanh(behind[FLANGE_SPEED] / 0.005)
            drag += reducer.output_viscous_nm_s * viscous * behind[FLANGE_SPEED]
            # each flange turns with its side of the reducer
            inertia = drives[0].flange_inertia_kgm2 + reducer.input_inertia_kgm2
            acceleration[0] = (torque[0] - friction - gear / reducer.ratio) / inertia
            inertia = drives[1].flange_inertia_kgm2 + reducer.output_inertia_kgm2
            acceleration[1] = (torque[1] + gear - drag) / inertia
            loss = friction * ahead[FLANGE_SPEED] + drag * behind[FLANGE_SPEED]
            reducer_state[red.LOSS_J] += loss * short
            for side in range(2):
                shafts[side, FLANGE_SPEED] += short * acceleration[side]
                shafts[side, FLANGE_ANGLE] += short * shafts[side, FLANGE_SPEED]
    for side in range(2):
        row = shafts[side]
        row[SHAFT_TORQUE] = torque[side] - added_nm[side]
        taken = drives[side].flange_inertia_kgm2 * acceleration[side]
        row[INTERFACE_TORQUE] = 0.0 if flange == FLANGE_LOOSE else torque[side] - taken
