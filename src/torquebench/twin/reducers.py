"""Presets of reducers under test: a standard reducer, an RV-40E class and a harmonic size 20."""

from typing import Literal, NamedTuple

import numpy as np

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.twin.reducer import ReducerConstants
from torquebench.units import ARCMIN, ARCSEC, TURN

ReducerName = Literal["standard", "rv-40e", "harmonic-20"]


class _Design(NamedTuple):
    """Mean values of a reducer; friction is that at the input, all others are at the output."""

    ratio: float
    rated_torque_nm: float
    coulomb_nm: float
    stribeck_rise: float
    viscous_nm_s: float
    load_share: float
    stiffness_nm_arcmin: tuple[float, float, float]
    corners: tuple[float, float]  # shares of the rated torque
    backlash_arcmin: float
    hysteresis: tuple[float, float]  # half widths of the loop, shares of the rated torque
    error_arcsec: tuple[float, float, float, float, float, float]
    error_order: tuple[float, float, float, float, float, float]
    input_inertia_kgm2: float
    output_inertia_kgm2: float


REDUCERS: dict[ReducerName, _Design] = {
    # 2000 N·m at the output and 80 : 1, the sources' test; friction of a large RV reducer.
    "standard": _Design(
        80.0, 2000.0, 0.30, 0.25, 3.0e-3, 0.10, (330.0, 390.0, 410.0), (0.10, 0.40), 0.35,
        (0.010, 0.008), (18.0, 8.0, 5.0, 12.0, 6.0, 3.0), (1.0, 2.0, 40.0, 80.0, 160.0, 240.0),
        0.0020, 0.40,
    ),
    # RV-40E: 412 N·m, 108-113 N·m/arcmin, lost motion and backlash below 1 arcmin.
    "rv-40e": _Design(
        121.0, 412.0, 0.15, 0.25, 1.0e-3, 0.12, (95.0, 108.0, 113.0), (0.10, 0.40), 0.30,
        (0.010, 0.008), (15.0, 6.0, 4.0, 10.0, 5.0, 3.0), (1.0, 2.0, 39.0, 121.0, 242.0, 363.0),
        0.0006, 0.10,
    ),
    # Harmonic size 20, i = 100: no-load 105 mN·m at 2000 rpm, starting 37 mN·m, efficiency 77 %,
    # no backlash; stiffness rises with the torque.
    "harmonic-20": _Design(
        100.0, 40.0, 0.030, 0.23, 3.5e-4, 0.20, (4.7, 7.3, 8.4), (0.35, 1.20), 0.0,
        (0.020, 0.015), (12.0, 8.0, 4.0, 15.0, 20.0, 6.0), (1.0, 2.0, 50.0, 100.0, 200.0, 400.0),
        0.00002, 0.01,
    ),
}  # fmt: skip


def draw_reducer(
    generator: np.random.Generator, name: ReducerName, wear: float
) -> ReducerConstants:
    """Draw a reducer around one of the presets.

    Parameters
    ----------
    generator : numpy.random.Generator
        Generator of the draws.
    name : {"standard", "rv-40e", "harmonic-20"}
        The preset.
    wear : float
        Factor on friction, backlash, hysteresis and transmission error.

    Raises
    ------
    InputError
        If the name is unknown.
    """
    if name not in REDUCERS:
        raise InputError(
            Message("reducer {name!r}", name), Message("one of {list}", ", ".join(REDUCERS))
        )
    design = REDUCERS[name]

    def vary(value: float, spread: float = 0.1) -> float:
        return value * generator.uniform(1.0 - spread, 1.0 + spread)

    coulomb = vary(design.coulomb_nm) * wear
    first, second, third = (vary(k, 0.04) / ARCMIN for k in design.stiffness_nm_arcmin)
    rated = design.rated_torque_nm
    narrow, wide = 0.004 * rated / second, 0.04 * rated / second
    loops = [vary(share, 0.2) * wear * rated for share in design.hysteresis]
    errors = [vary(value, 0.3) * wear * ARCSEC for value in design.error_arcsec]
    phases = generator.uniform(0.0, TURN, 6)
    inertia = design.output_inertia_kgm2
    return ReducerConstants(
        ratio=design.ratio,
        rated_torque_nm=rated,
        coulomb_nm=coulomb,
        static_nm=coulomb * (1.0 + vary(design.stribeck_rise, 0.2)),
        stribeck_rad_s=vary(3.0, 0.2),
        viscous_nm_s=vary(design.viscous_nm_s) * wear,
        load_share=vary(design.load_share) * wear,
        coulomb_per_k=vary(0.004),
        viscous_per_k=vary(0.025),
        bristle_rad=vary(2e-3),
        output_drag_nm=vary(5e-4) * rated,
        output_viscous_nm_s=vary(1e-3) * rated,
        stiffness_nm_rad=(first, second, third),
        corner_nm=(design.corners[0] * rated, design.corners[1] * rated),
        backlash_rad=vary(design.backlash_arcmin, 0.2) * wear * ARCMIN,
        stop_width_rad=(narrow, wide),
        stop_stiffness_nm_rad=(loops[0] / narrow, loops[1] / wide),
        damping_nm_s=0.1 * float(np.sqrt(second * inertia)),
        error_order=design.error_order,
        error_rad=(errors[0], errors[1], errors[2], errors[3], errors[4], errors[5]),
        error_phase_rad=(phases[0], phases[1], phases[2], phases[3], phases[4], phases[5]),
        input_inertia_kgm2=design.input_inertia_kgm2,
        output_inertia_kgm2=inertia,
    )
