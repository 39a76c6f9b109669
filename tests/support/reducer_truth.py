"""True properties of a reducer of the twin, without noise: the expected test results."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.twin import reducer as red
from torquebench.twin.reducer import ReducerConstants
from torquebench.twin.reducer_truth import input_torque_nm
from torquebench.units import ARCMIN

FloatArray = NDArray[np.float64]


def true_loop(
    reducer: ReducerConstants, torque_nm: float, points: int = 2001
) -> tuple[FloatArray, FloatArray]:
    """Return the quasi-static torque-angle loop −T → +T → −T of a preloaded reducer, input locked.

    With a ripple of the torque, as from the twin's drives, the same operators give a narrower loop
    on average, because every period of the ripple moves the stops back a little.

    Parameters
    ----------
    reducer : ReducerConstants
    torque_nm : float
        Largest torque T at the output, N·m.
    points : int
        Points of each branch.

    Returns
    -------
    torque_nm, angle_rad : float64[2·points]
        Torque that the module applies to the output, and the output's angle; the rising branch
        first.
    """
    state = np.zeros(red.REDUCER_STATES)
    reach = torque_nm / min(reducer.stiffness_nm_rad) + reducer.backlash_rad
    step = 2.0 * reach / (10 * points)
    _branch(reducer, state, torque_nm, step)  # the preload, from rest
    _branch(reducer, state, -torque_nm, -step)
    rising = _branch(reducer, state, torque_nm, step)
    falling = _branch(reducer, state, -torque_nm, -step)
    up = np.linspace(-torque_nm, torque_nm, points)
    angle_up = np.interp(up, rising[0], rising[1])
    angle_down = np.interp(up, falling[0][::-1], falling[1][::-1])
    return np.concatenate((up, up[::-1])), np.concatenate((angle_up, angle_down[::-1]))


def true_loop_values(
    reducer: ReducerConstants,
    torque_nm: float,
    *,
    lost_motion_share: float,
    stiffness_interval: tuple[float, float],
) -> dict[str, float]:
    """Return the values of the quasi-static loop to ±T by their definitions, without a fit.

    Parameters
    ----------
    reducer : ReducerConstants
    torque_nm : float
        T, N·m.
    lost_motion_share : float
        Share of the rated torque at which lost motion is evaluated.
    stiffness_interval : pair of float
        Interval, as shares of T, over which the stiffness ΔT/Δθ of the loading branch is fitted by
        least squares.

    Returns
    -------
    dict of str to float
        backlash and lost_motion in arcmin, stiffness in N·m/arcmin, hysteresis_loss in J.
    """
    torque, angle = true_loop(reducer, torque_nm)
    half = torque.size // 2
    rising, falling = angle[:half] / ARCMIN, angle[half:][::-1] / ARCMIN
    grid = torque[:half]
    share = lost_motion_share * torque_nm
    places = np.array([0.0, share, -share])
    up, down = np.interp(places, grid, rising), np.interp(places, grid, falling)
    middle = 0.5 * (up + down)
    low, high = (each * torque_nm for each in stiffness_interval)
    loading = (grid >= low) & (grid <= high)
    return {
        "backlash": float(down[0] - up[0]),
        "lost_motion": float(middle[1] - middle[2]),
        "stiffness": 1.0 / float(np.polyfit(grid[loading], rising[loading], 1)[0]),
        "hysteresis_loss": float(np.trapezoid((falling - rising) * ARCMIN, grid)),
    }


def _branch(
    reducer: ReducerConstants, state: FloatArray, target_nm: float, step_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Twist in small steps until a torque is reached; return torque and twist along the way.

    Within the backlash the torque also grows with the twist, because of the hysteresis.
    """
    twist = float(state[red.TWIST])
    torque = [float(red.reducer_torque(reducer, state, twist, 0.0))]
    path = [twist]
    while (torque[-1] - target_nm) * np.sign(step_rad) < 0.0:
        twist += step_rad
        path.append(twist)
        torque.append(float(red.reducer_torque(reducer, state, twist, 0.0)))
    return np.array(torque), np.array(path)


def true_efficiency(
    reducer: ReducerConstants, speed_rpm: ArrayLike, output_nm: ArrayLike, temperature_c: float
) -> FloatArray:
    """Return the efficiency in driving direction at input speeds and output torques, as a share."""
    load = np.abs(np.asarray(output_nm, dtype=np.float64))
    return np.asarray(
        load / (reducer.ratio * input_torque_nm(reducer, speed_rpm, load, temperature_c))
    )


def true_starting_nm(reducer: ReducerConstants, temperature_c: float) -> float:
    """Return the input torque at which the input begins to turn, output free, N·m.

    The drag at the output is proportional to its speed, and so zero at standstill.
    """
    coulomb, _ = red.temperature_factors(reducer, temperature_c)
    return float(red.friction_level(reducer, 0.0, 0.0, coulomb))


def true_back_driving_nm(reducer: ReducerConstants, temperature_c: float) -> float:
    """Return the output torque at which the output begins to turn, input free, N·m.

    The friction at the input grows with the torque there: T/R = f₀ + s·T/R.
    """
    coulomb, _ = red.temperature_factors(reducer, temperature_c)
    at_input = coulomb * reducer.static_nm
    return float(at_input * reducer.ratio / (1.0 - reducer.load_share))


def true_transmission_error(reducer: ReducerConstants, output_angle_rad: ArrayLike) -> FloatArray:
    """Return the transmission error θ_o − θ_i/R at output angles, rad, with its mean."""
    angle = np.asarray(output_angle_rad, dtype=np.float64)
    return np.asarray(
        sum(
            amplitude * np.sin(order * angle + phase)
            for order, amplitude, phase in zip(
                reducer.error_order, reducer.error_rad, reducer.error_phase_rad, strict=True
            )
        )
    )
