"""Constants of the twin, all drawn from a preset and a seed."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from torquebench.errors import InputError
from torquebench.mechanics import Chain
from torquebench.message import Message
from torquebench.twin import presets
from torquebench.twin.blocks import SIDES, Side
from torquebench.twin.calibrator import ReferenceParameters
from torquebench.twin.chain import ChainConstants, steepest_slope
from torquebench.twin.counter import CounterConstants
from torquebench.twin.drive import DriveConstants
from torquebench.twin.presets import BANDWIDTH, DESIGNS, WEAR, Preset
from torquebench.twin.reducer import ReducerConstants
from torquebench.twin.reducers import ReducerName, draw_reducer
from torquebench.twin.thermal import ThermalConstants
from torquebench.twin.transducer import TransducerConstants
from torquebench.twin.turning import TurningConstants, draw_turning
from torquebench.units import ARCSEC, TURN

_TURNING = 11  # separates the draws of rotation effects from all others


class EncoderConstants(NamedTuple):
    """One encoder.

    Attributes
    ----------
    counts_per_revolution : int
        Lines times interpolation.
    error_rad, error_phase_rad : pair of float
        Graduation error at one and two periods per turn.
    accuracy_rad : float
        Limit over a turn by its data sheet.
    """

    counts_per_revolution: int
    error_rad: tuple[float, float]
    error_phase_rad: tuple[float, float]
    accuracy_rad: float


@dataclass(frozen=True)
class SideParameters:
    """Constants of one side of the bench.

    Attributes
    ----------
    geometry : pair of Chain
        The chain's design for clockwise and counterclockwise torque; its equations give the
        coefficients in ``chain``.
    chain, transducer, drive, encoder, turning
        Constants of the parts.
    calibrator, verification_standard : ReferenceParameters
        The reference transducers that can be mounted on this side.
    """

    geometry: tuple[Chain, Chain]
    chain: ChainConstants
    transducer: TransducerConstants
    drive: DriveConstants
    encoder: EncoderConstants
    turning: TurningConstants
    calibrator: ReferenceParameters
    verification_standard: ReferenceParameters


@dataclass(frozen=True)
class TwinParameters:
    """Every constant of the simulated bench.

    Attributes
    ----------
    preset : {"nominal", "worn"}
        A healthy bench, or one on which all errors are larger.
    seed : int
        Preset and seed of the constants.
    input, output : SideParameters
        Both modules.
    reducer : ReducerConstants
        The reducer that ``mount("reducer")`` mounts.
    thermal, counter
        Temperatures and the counters' clock.
    carrier_hz : float
        Frequency of all transducers at zero torque: 60 kHz or 240 kHz.
    reseating : float
        Relative spread of the chain's linear part from one mounting to the next.

    Examples
    --------
    >>> TwinParameters.draw("nominal", seed=3) == TwinParameters.draw("nominal", seed=3)
    True
    >>> TwinParameters.draw("worn", seed=3).input.transducer.nominal_torque_nm
    50.0
    """

    preset: Preset
    seed: int
    input: SideParameters
    output: SideParameters
    reducer: ReducerConstants
    thermal: ThermalConstants
    counter: CounterConstants
    carrier_hz: float
    reseating: float

    @classmethod
    def draw(
        cls,
        preset: Preset = "nominal",
        seed: int = 0,
        *,
        reducer: ReducerName = "standard",
        carrier_hz: float = 60e3,
    ) -> "TwinParameters":
        """Draw every constant.

        Parameters
        ----------
        preset : {"nominal", "worn"}
            "nominal": repeatability 0.01-0.02 % of the range, raw error 0.3-1 %. "worn": all errors
            are larger.
        seed : int
            Seed of the constants.
        reducer : {"standard", "rv-40e", "harmonic-20"}
            The reducer under test.
        carrier_hz : float
            60e3 or 240e3, the transducers' option.

        Returns
        -------
        TwinParameters
            Drawn constants.

        Raises
        ------
        InputError
            If a name is unknown or the seed is negative.
        """
        if preset not in WEAR:
            raise InputError(
                Message("preset {preset!r}", preset), Message("one of {list}", ", ".join(WEAR))
            )
        if seed < 0:
            raise InputError(Message("seed {seed}", seed), "a whole number of at least 0")
        if carrier_hz not in BANDWIDTH:
            raise InputError(
                Message("carrier {carrier_hz} Hz", carrier_hz), "60000 Hz or 240000 Hz"
            )
        wear = WEAR[preset]
        generators = np.random.default_rng(seed).spawn(5)
        sides = [
            _draw_side(
                generators[k], np.random.default_rng([seed, k, _TURNING]), preset, side, carrier_hz
            )
            for k, side in enumerate(SIDES)
        ]
        return cls(
            preset=preset,
            seed=seed,
            input=sides[0],
            output=sides[1],
            reducer=draw_reducer(generators[2], reducer, wear),
            thermal=presets.draw_thermal(generators[3]),
            counter=presets.draw_counter(generators[4]),
            carrier_hz=carrier_hz,
            reseating=2e-5 * wear,
        )

    def with_reducer(self, reducer: ReducerConstants) -> "TwinParameters":
        """Return the same bench with another reducer to be tested."""
        return replace(self, reducer=reducer)


def _draw_side(
    generator: np.random.Generator,
    turning: np.random.Generator,
    preset: Preset,
    side: Side,
    carrier_hz: float,
) -> SideParameters:
    """Draw a side; a chain that can't be inverted (its step is too steep) is drawn again."""
    design, wear = DESIGNS[side], WEAR[preset]
    while True:
        geometry = presets.draw_geometry(generator, design, wear)
        chain = presets.draw_chain(generator, design, geometry, wear)
        if steepest_slope(chain) < 0.5:
            break
    calibrator, standard = presets.draw_references(generator, design, wear, carrier_hz)
    phase = generator.uniform(0.0, TURN, 2)
    largest = 4.0 if side == "input" else 0.8
    encoder = EncoderConstants(
        360_000 if side == "input" else 3_600_000,
        (
            generator.uniform(0.3, 1.0) * largest * ARCSEC,
            generator.uniform(0.1, 0.4) * largest * ARCSEC,
        ),
        (float(phase[0]), float(phase[1])),
        1.25 * largest * ARCSEC,
    )
    return SideParameters(
        geometry=geometry,
        chain=chain,
        transducer=presets.draw_transducer(generator, design, wear, carrier_hz),
        drive=presets.draw_drive(generator, design, wear),
        encoder=encoder,
        turning=draw_turning(
            turning,
            range_nm=design.range_nm,
            largest_speed_rad_s=design.largest_speed_rad_s,
            temperature_effect_per_k=design.temperature_effect_per_k,
            wear=wear,
        ),
        calibrator=calibrator,
        verification_standard=standard,
    )
