"""Draws of every constant of the bench around its design."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from torquebench.mechanics import Chain, coefficients
from torquebench.twin.blocks import Side
from torquebench.twin.calibrator import ReferenceConstants, ReferenceParameters, draw_reference
from torquebench.twin.chain import ChainConstants
from torquebench.twin.counter import CounterConstants
from torquebench.twin.drive import DriveConstants
from torquebench.twin.thermal import ThermalConstants
from torquebench.twin.transducer import TransducerConstants
from torquebench.units import RAD_S_PER_RPM, TURN

Preset = Literal["nominal", "worn"]


@dataclass(frozen=True)
class SideDesign:
    """Fixed values of a side's design; SI units.

    Attributes
    ----------
    range_nm, largest_speed_rad_s : float
        Full scale and largest speed.
    temperature_effect_per_k : float
        Limit of zero and span drift per kelvin.
    chain : Chain
        Mean geometry, misalignments and coefficients.
    coupling_stiffness_nm_rad, damping_ratio : float
        Torsional dynamics.
    bandwidth_rad_s, acceleration_rad_s2, drag : float
        Speed control, acceleration limit and the drag of the motor's bearings (share of range).
    """

    range_nm: float
    largest_speed_rad_s: float
    temperature_effect_per_k: float
    chain: Chain
    motor_inertia_kgm2: float
    flange_inertia_kgm2: float
    transducer_stiffness_nm_rad: float
    coupling_stiffness_nm_rad: float
    damping_ratio: float
    bandwidth_rad_s: float
    acceleration_rad_s2: float


DESIGNS: dict[Side, SideDesign] = {
    "input": SideDesign(
        range_nm=50.0,
        largest_speed_rad_s=1200.0 * RAD_S_PER_RPM,
        temperature_effect_per_k=1e-4,
        chain=Chain(0.030, 0.010, 0.20, 79e9, 0.015, 16e-6, 9e-5, 5.5e7, 3.6e5, 1.2e4),
        motor_inertia_kgm2=0.012,
        flange_inertia_kgm2=0.0025,
        transducer_stiffness_nm_rad=1.8e5,
        coupling_stiffness_nm_rad=3.0e4,
        damping_ratio=0.06,
        bandwidth_rad_s=60.0,
        acceleration_rad_s2=300.0,
    ),
    "output": SideDesign(
        range_nm=2000.0,
        largest_speed_rad_s=15.0 * RAD_S_PER_RPM,
        temperature_effect_per_k=0.5e-4,
        chain=Chain(0.090, 0.030, 0.30, 79e9, 0.045, 16e-6, 1.8e-4, 5.5e8, 1.5e7, 2.4e5),
        motor_inertia_kgm2=2.5,
        flange_inertia_kgm2=0.25,
        transducer_stiffness_nm_rad=2.2e6,
        coupling_stiffness_nm_rad=9.0e5,
        damping_ratio=0.10,
        bandwidth_rad_s=20.0,
        acceleration_rad_s2=5.0,
    ),
}

# Time constants of the bandwidth's lag (3 and 6 kHz) and the rest of the group delay (220 and 150
# µs), by carrier.
BANDWIDTH: dict[float, tuple[float, float]] = {
    60e3: (1.0 / (TURN * 3e3), 220e-6 - 1.0 / (TURN * 3e3)),
    240e3: (1.0 / (TURN * 6e3), 150e-6 - 1.0 / (TURN * 6e3)),
}

# Factors of a worn bench's quantities relative to those of a nominal one.
WEAR: dict[Preset, float] = {"nominal": 1.0, "worn": 1.7}


def _around(generator: np.random.Generator, mean: float, spread: float) -> float:
    """Draw a value within a relative spread of a mean."""
    return mean * generator.uniform(1.0 - spread, 1.0 + spread)


def _signed(generator: np.random.Generator, low: float, high: float) -> float:
    """Draw a size between two limits with a random sign."""
    return float(generator.uniform(low, high) * generator.choice([-1.0, 1.0]))


def draw_geometry(
    generator: np.random.Generator, design: SideDesign, wear: float
) -> tuple[Chain, Chain]:
    """Draw the chain's geometry and coefficients, clockwise and counterclockwise."""
    mean = design.chain
    offset = wear * _around(generator, mean.coaxiality_error_m, 0.45)
    angle = wear * _around(generator, mean.angular_misalignment_rad, 0.6)
    strain = _around(generator, mean.strain_coefficient_n_per_m, 0.2)
    friction = wear * _around(generator, mean.elastic_coefficient_n_per_rad, 0.3)
    stiffness = _around(generator, mean.radial_stiffness_n_per_m, 0.25)
    chains = [
        Chain(
            outer_diameter_m=mean.outer_diameter_m,
            inner_diameter_m=mean.inner_diameter_m,
            length_m=mean.length_m,
            shear_modulus_pa=mean.shear_modulus_pa,
            shaft_radius_m=mean.shaft_radius_m,
            coaxiality_error_m=_around(generator, offset, 0.15),
            angular_misalignment_rad=_around(generator, angle, 0.15),
            strain_coefficient_n_per_m=strain,
            elastic_coefficient_n_per_rad=_around(generator, friction, 0.15),
            radial_stiffness_n_per_m=_around(generator, stiffness, 0.1),
        )
        for _ in range(2)
    ]
    return chains[0], chains[1]


def draw_chain(
    generator: np.random.Generator,
    design: SideDesign,
    geometry: tuple[Chain, Chain],
    wear: float,
) -> ChainConstants:
    """Draw a chain that deviates from the papers' equations, with the geometry's coefficients."""
    scale = design.range_nm
    clockwise, counterclockwise = (coefficients(chain) for chain in geometry)
    bumps = [_signed(generator, 1.8e-4, 3.8e-4) * wear * scale for _ in range(4)]
    centres = [
        generator.uniform(0.12, 0.50),
        generator.uniform(0.50, 0.92),
        -generator.uniform(0.12, 0.50),
        -generator.uniform(0.50, 0.92),
    ]
    widths = [generator.uniform(0.04, 0.08) for _ in range(4)]
    misalignment = geometry[0].angular_misalignment_rad / design.chain.angular_misalignment_rad
    at_full_speed = 1.0e-3 * misalignment * scale / design.largest_speed_rad_s**2
    # speeds up to 15 rpm cause no vibration
    slowly = 1.0 if design.largest_speed_rad_s > 10.0 else 0.02
    first, second, third = (
        at_full_speed * slowly * generator.uniform(0.7, 1.3) * share for share in (1.0, 0.6, 0.2)
    )
    phase = generator.uniform(0.0, TURN, 6)
    return ChainConstants(
        range_nm=scale,
        constant_nm=(clockwise.constant_nm, counterclockwise.constant_nm),
        linear=(clockwise.linear, counterclockwise.linear),
        quadratic_per_nm=(clockwise.quadratic_per_nm, counterclockwise.quadratic_per_nm),
        reversal_width=_around(generator, 0.005, 0.2),
        ripple_nm=(
            generator.uniform(0.8e-4, 1.6e-4) * wear * scale,
            generator.uniform(0.8e-4, 1.6e-4) * wear * scale,
        ),
        ripple_period=(generator.uniform(0.12, 0.25), generator.uniform(0.12, 0.25)),
        ripple_phase_rad=(float(phase[0]), float(phase[1])),
        bump_nm=(bumps[0], bumps[1], bumps[2], bumps[3]),
        bump_centre=(centres[0], centres[1], centres[2], centres[3]),
        bump_width=(widths[0], widths[1], widths[2], widths[3]),
        engagement_by_angle=generator.uniform(0.3e-4, 0.8e-4) * wear,
        engagement_phase_rad=float(phase[2]),
        misalignment_nm_s2=(first, second, third),
        misalignment_phase_rad=(float(phase[3]), float(phase[4]), float(phase[5])),
        drag_nm=generator.uniform(2e-5, 6e-5) * wear * scale,
        drag_viscous_nm_s=generator.uniform(2e-5, 6e-5) * wear * scale / design.largest_speed_rad_s,
    )


def draw_transducer(
    generator: np.random.Generator, design: SideDesign, wear: float, carrier_hz: float
) -> TransducerConstants:
    """Draw a transducer of the T40B's class."""
    nominal_hz_per_nm = 0.5 * carrier_hz / design.range_nm
    lag_s, delay_s = BANDWIDTH[carrier_hz]
    gain = 1.0 + _signed(generator, 1e-4, 5e-4)
    uneven = _signed(generator, 0.2e-4, 1.0e-4)
    effect = design.temperature_effect_per_k
    return TransducerConstants(
        nominal_torque_nm=design.range_nm,
        zero_hz=carrier_hz * (1.0 + _signed(generator, 1e-4, 1e-3)),
        sensitivity_hz_per_nm=(
            nominal_hz_per_nm * gain * (1.0 + uneven),
            nominal_hz_per_nm * gain * (1.0 - uneven),
        ),
        linearity=(
            _signed(generator, 0.3e-4, 0.9e-4) * wear,
            _signed(generator, 0.3e-4, 0.9e-4) * wear,
        ),
        linearity_cubic=_signed(generator, 0.1e-4, 0.4e-4) * wear,
        stop_width=(0.02, 0.08, 0.25),
        stop_weight=(
            generator.uniform(0.8e-3, 1.5e-3) * wear,
            generator.uniform(2.2e-4, 5.0e-4) * wear,
            generator.uniform(0.9e-4, 2.0e-4) * wear,
        ),
        creep=(
            _signed(generator, 0.2e-4, 0.5e-4) * wear,
            _signed(generator, 0.2e-4, 0.5e-4) * wear,
        ),
        creep_time_s=(_around(generator, 8.0, 0.3), _around(generator, 90.0, 0.3)),
        zero_drift_per_k=_signed(generator, 0.3, 0.9) * effect * wear,
        span_drift_per_k=_signed(generator, 0.3, 0.9) * effect * wear,
        zero_by_speed_s=_signed(generator, 0.6e-4, 1.3e-4) * wear / (1000.0 * RAD_S_PER_RPM),
        repeatability=generator.uniform(1.0e-4, 2.0e-4) * wear,
        wander=generator.uniform(0.1e-4, 0.3e-4) * wear,
        wander_time_s=_around(generator, 30.0, 0.3),
        white=generator.uniform(1e-4, 3e-4) * wear,
        lag_s=lag_s,
        delay_s=delay_s,
    )


def draw_drive(generator: np.random.Generator, design: SideDesign, wear: float) -> DriveConstants:
    """Draw a drive that loads within 0.1 % of its range."""
    scale = design.range_nm
    compliance = 1.0 / design.transducer_stiffness_nm_rad + 1.0 / design.coupling_stiffness_nm_rad
    stiffness = _around(generator, 1.0 / compliance, 0.05)
    inertia = 1.0 / (1.0 / design.motor_inertia_kgm2 + 1.0 / (10.0 * design.flange_inertia_kgm2))
    return DriveConstants(
        range_nm=scale,
        torque_limit_nm=1.2 * scale,
        speed_limit_rad_s=1.1 * design.largest_speed_rad_s,
        slew_nm_s=5.0 * scale,
        lag_s=_around(generator, 6e-3, 0.2),
        acceleration_rad_s2=design.acceleration_rad_s2,
        gain_error=_signed(generator, 1e-4, 4e-4) * wear,
        offset_nm=_signed(generator, 0.3e-4, 1e-4) * wear * scale,
        curvature_nm=_signed(generator, 0.3e-4, 1e-4) * wear * scale,
        command_spread_nm=generator.uniform(0.8e-4, 1.8e-4) * wear * scale,
        wander_nm=generator.uniform(0.3e-4, 0.8e-4) * wear * scale,
        wander_time_s=_around(generator, 5.0, 0.3),
        cogging_nm=generator.uniform(0.8e-3, 2.0e-3) * wear * scale,
        cogging_per_turn=24.0 if scale < 100.0 else 72.0,
        cogging_phase_rad=generator.uniform(0.0, TURN),
        ripple_nm=generator.uniform(2e-4, 6e-4) * wear * scale,
        ripple_hz=generator.uniform(23.0, 43.0),
        ripple_phase_rad=generator.uniform(0.0, TURN),
        drag_nm=2e-3 * scale,
        drag_viscous_nm_s=2e-3 * scale / design.largest_speed_rad_s,
        motor_inertia_kgm2=_around(generator, design.motor_inertia_kgm2, 0.05),
        flange_inertia_kgm2=_around(generator, design.flange_inertia_kgm2, 0.05),
        stiffness_nm_rad=stiffness,
        damping_nm_s=2.0 * design.damping_ratio * float(np.sqrt(stiffness * inertia)),
        encoder_compliance_rad_nm=1.0 / design.coupling_stiffness_nm_rad,
        bandwidth_rad_s=design.bandwidth_rad_s,
    )


def draw_references(
    generator: np.random.Generator, design: SideDesign, wear: float, carrier_hz: float
) -> tuple[ReferenceParameters, ReferenceParameters]:
    """Draw the calibrator's transducer (0.02 %) and the verification standard (0.002 %)."""
    results = []
    for limit in (2e-4, 2e-5):
        constants = ReferenceConstants(
            nominal_torque_nm=design.range_nm,
            zero_hz=carrier_hz * (1.0 + _signed(generator, 0.3e-4, 3e-4)),
            sensitivity_hz_per_nm=0.5 * carrier_hz / design.range_nm,
            zero_drift_per_k=_signed(generator, 0.05, 0.2) * limit,
            span_drift_per_k=_signed(generator, 0.05, 0.2) * limit,
            white=5e-5 if limit > 1e-4 else 2e-5,
            lag_s=BANDWIDTH[carrier_hz][0],
            delay_s=BANDWIDTH[carrier_hz][1],
        )
        results.append(
            draw_reference(
                generator,
                constants,
                largest_error=limit * (1.0 if limit < 1e-4 else min(wear, 1.2)),
                certificate_noise=0.1 * limit,
                interpolation_error=0.06 * limit,
            )
        )
    return results[0], results[1]


def draw_thermal(generator: np.random.Generator) -> ThermalConstants:
    """Draw the temperatures' constants."""
    errors = generator.uniform(-0.15, 0.15, 5).tolist()
    return ThermalConstants(
        ambient_c=_around(generator, 23.0, 0.03),
        ambient_spread_k=_around(generator, 0.4, 0.3),
        ambient_time_s=1800.0,
        transducer_time_s=(_around(generator, 600.0, 0.2), _around(generator, 1500.0, 0.2)),
        transducer_heating_k_s=(4.0 / (1200.0 * RAD_S_PER_RPM), 1.0 / (15.0 * RAD_S_PER_RPM)),
        calibrator_time_s=1200.0,
        heat_capacity_j_k=8000.0,
        cooling_w_k=8.0,
        probe_error_k=(errors[0], errors[1], errors[2], errors[3], errors[4]),
    )


def draw_counter(generator: np.random.Generator) -> CounterConstants:
    """Draw the clock's error (a few ppm) and the edges' jitter."""
    return CounterConstants(_signed(generator, 0.5e-6, 5e-6), generator.uniform(2e-9, 5e-9))
