"""The drives: torque and speed control, loading accuracy, cogging and ripple."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import inner
from torquebench.units import TURN

FloatArray = NDArray[np.float64]

CONTROL_OFF = 0
CONTROL_TORQUE = 1
CONTROL_SPEED = 2

# Indices of the drive's state array.
DEMAND = 0  # torque demand after the slew limit
CURRENT_TORQUE = 1  # torque after the current loop's lag
SPEED_REFERENCE = 2  # speed after the acceleration limit
INTEGRAL = 3  # integral part of the speed controller
COGGING_MEAN = 4  # the torque loop's correction of the cogging
WANDER = 5  # slow drift of the torque, in its standard deviations
DRIVE_STATES = 6


class DriveConstants(NamedTuple):
    """Constants of one drive and of the shaft between its motor and the flange.

    Attributes
    ----------
    range_nm, torque_limit_nm, speed_limit_rad_s : float
        Full scale and limits.
    slew_nm_s, lag_s, acceleration_rad_s2 : float
        Torque slew limit, lag of the current loop, acceleration limit of the speed control.
    gain_error, offset_nm, curvature_nm, command_spread_nm : float
        Loading accuracy: systematic parts, and the standard deviation of one command.
    wander_nm, wander_time_s : float
        Slow drift of the torque while a command is held: standard deviation and correlation time.
    cogging_nm, cogging_per_turn, cogging_phase_rad : float
        Cogging by the motor's angle.
    ripple_nm, ripple_hz, ripple_phase_rad : float
        Ripple of the power stage.
    drag_nm, drag_viscous_nm_s : float
        Bearing drag of the motor, which the torque control compensates.
    motor_inertia_kgm2, flange_inertia_kgm2 : float
        Inertia before and after the transducer.
    stiffness_nm_rad, damping_nm_s : float
        Transducer, shaft and spline in series.
    encoder_compliance_rad_nm : float
        Twist per torque between the encoder and the reducer's flange.
    bandwidth_rad_s : float
        Bandwidth of the speed control.
    """

    range_nm: float
    torque_limit_nm: float
    speed_limit_rad_s: float
    slew_nm_s: float
    lag_s: float
    acceleration_rad_s2: float
    gain_error: float
    offset_nm: float
    curvature_nm: float
    command_spread_nm: float
    wander_nm: float
    wander_time_s: float
    cogging_nm: float
    cogging_per_turn: float
    cogging_phase_rad: float
    ripple_nm: float
    ripple_hz: float
    ripple_phase_rad: float
    drag_nm: float
    drag_viscous_nm_s: float
    motor_inertia_kgm2: float
    flange_inertia_kgm2: float
    stiffness_nm_rad: float
    damping_nm_s: float
    encoder_compliance_rad_nm: float
    bandwidth_rad_s: float


class Loading:
    """Loading accuracy of a drive: deviation of the torque from the command.

    The random part depends on the commanded torque: a repeated command gives the same torque, and a
    command that differs by some per cent of the range gets a new random part. A ramp of many small
    commands therefore remains a ramp.

    Parameters
    ----------
    drive : DriveConstants
        The drive.
    generator : numpy.random.Generator
        Source of the draws.
    """

    def __init__(self, drive: DriveConstants, generator: np.random.Generator) -> None:
        self._drive = drive
        self._generator = generator
        self._commanded_nm = 0.0
        self._spread = 0.0

    def error(self, torque_nm: float) -> float:
        """Return the deviation of the torque from its command, N·m.

        It is within 0.1 % of the range on a healthy bench, and 0 at zero.
        """
        drive = self._drive
        change = abs(torque_nm - self._commanded_nm) / drive.range_nm
        decay = math.exp(-change / 0.005)
        fresh = self._generator.standard_normal()
        self._spread = decay * self._spread + math.sqrt(1.0 - decay * decay) * fresh
        self._commanded_nm = torque_nm
        if torque_nm == 0.0:
            return 0.0
        relative = torque_nm / drive.range_nm
        systematic = drive.gain_error * torque_nm + drive.offset_nm
        systematic += drive.curvature_nm * relative * abs(relative)
        return systematic + drive.command_spread_nm * min(2.0, max(-2.0, self._spread))


@inner
def drive_torque(
    drive: DriveConstants,
    state: FloatArray,
    control: int,
    target: float,
    inertia_kgm2: float,
    motor_angle_rad: float,
    motor_speed_rad_s: float,
    time_s: float,
    step_s: float,
    normal: float,
) -> float:
    """Return the torque on the motor's shaft over the next step, N·m.

    Parameters
    ----------
    drive : DriveConstants
        The drive.
    state : float64[DRIVE_STATES]
        State of the drive, changed in place.
    control : int
        CONTROL_OFF, CONTROL_TORQUE or CONTROL_SPEED.
    target : float
        Torque (N·m, error included) or speed (rad/s).
    inertia_kgm2 : float
        Inertia assumed by the speed controller.
    motor_angle_rad, motor_speed_rad_s, time_s, step_s : float
        Present state of the motor, and the step.
    normal : float
        Standard normal number for the slow drift.
    """
    drag = drive.drag_nm * math.tanh(motor_speed_rad_s / 0.05)
    drag += drive.drag_viscous_nm_s * motor_speed_rad_s
    if control == CONTROL_OFF:
        state[:WANDER] = 0.0
        state[SPEED_REFERENCE] = motor_speed_rad_s
        return -drag
    rate = step_s / drive.wander_time_s
    state[WANDER] += -rate * state[WANDER] + math.sqrt(2.0 * rate) * normal
    angle = drive.cogging_per_turn * motor_angle_rad + drive.cogging_phase_rad
    cogging = drive.cogging_nm * math.sin(angle)
    state[COGGING_MEAN] += (cogging - state[COGGING_MEAN]) * step_s / 0.1
    phase = TURN * drive.ripple_hz * time_s + drive.ripple_phase_rad
    ripple = drive.ripple_nm * (math.sin(phase) + 0.3 * math.sin(2.0 * phase))
    disturbance = cogging - state[COGGING_MEAN] + ripple
    if control == CONTROL_TORQUE:
        demand = min(drive.torque_limit_nm, max(-drive.torque_limit_nm, target))
        largest = drive.slew_nm_s * step_s
        state[DEMAND] += min(largest, max(-largest, demand - state[DEMAND]))
        demanded = state[DEMAND]
        if abs(motor_speed_rad_s) > drive.speed_limit_rad_s and demanded * motor_speed_rad_s > 0.0:
            demanded = 0.0
        state[SPEED_REFERENCE] = motor_speed_rad_s
        state[INTEGRAL] = demanded
        disturbance += drive.wander_nm * state[WANDER] * abs(demanded) / drive.range_nm
        drag = 0.0
    else:
        speed = min(drive.speed_limit_rad_s, max(-drive.speed_limit_rad_s, target))
        largest = drive.acceleration_rad_s2 * step_s
        state[SPEED_REFERENCE] += min(largest, max(-largest, speed - state[SPEED_REFERENCE]))
        deviation = state[SPEED_REFERENCE] - motor_speed_rad_s
        gain = inertia_kgm2 * drive.bandwidth_rad_s
        integral = state[INTEGRAL] + 0.25 * gain * drive.bandwidth_rad_s * deviation * step_s
        state[INTEGRAL] = min(drive.torque_limit_nm, max(-drive.torque_limit_nm, integral))
        demanded = gain * deviation + state[INTEGRAL]
        demanded = min(drive.torque_limit_nm, max(-drive.torque_limit_nm, demanded))
        state[DEMAND] = demanded
    decay = math.exp(-step_s / drive.lag_s)
    state[CURRENT_TORQUE] = demanded + (state[CURRENT_TORQUE] - demanded) * decay
    return float(state[CURRENT_TORQUE] + disturbance - drag)
