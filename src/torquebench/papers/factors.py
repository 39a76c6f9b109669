"""Items 19 and 20: errors during rotation, under changing torque, and by influence quantities."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import SIDES, Side
from torquebench.calibration import CalibrationData, load_profile, verify
from torquebench.campaign.bench_chains import referenced
from torquebench.campaign.fitting import feature_columns
from torquebench.campaign.turning import identify_turning, joined_tables
from torquebench.campaign.turning_runs import measure_turning
from torquebench.campaign.verifying import measure_verification
from torquebench.chain import EmptyRun, MeasuringChain
from torquebench.compensation import CompensationModel, make_model
from torquebench.dynamics import Known, design_inverse, identify
from torquebench.figures import Curve
from torquebench.message import Message
from torquebench.procedures.turning.profile import RandomPoints, load_turning_profile
from torquebench.reports.curve_figures import Panel
from torquebench.reports.errors_table import number
from torquebench.reports.page import Block, Diagram, Table
from torquebench.station import Station
from torquebench.tables import read_calibration, read_empty_run
from torquebench.units import DEG_PER_RAD, MS_PER_S, TURN

FloatArray = NDArray[np.float64]
Measurement = CalibrationData | EmptyRun

CALIBRATED_C, USED_C = (10.0, 40.0), (17.0, 32.0)
"""Temperatures of additional calibration points, and of the fresh points."""
OTHER_LUBRICANT = "oil"
CONDITIONS: tuple[tuple[str, Side | float], ...] = (
    *((lubricant, side) for side in SIDES for lubricant in ("grease", OTHER_LUBRICANT)),
    *(("temperature", celsius) for celsius in (*CALIBRATED_C, *USED_C)),
)
"""Conditions, each measured on a separate simulated bench, so that processes can share the work."""


@dataclass(frozen=True)
class FactorError:
    """Worst errors of fresh points against the standard under one condition, % FS.

    Attributes
    ----------
    side, condition : str
    points : int
    raw, at_rest, identified : float
        Errors of the reading, with the calibration at standstill and one temperature, and with the
        identified effects of temperature and rotation.
    """

    side: str
    condition: str
    points: int
    raw: float
    at_rest: float
    identified: float


def measured_at(
    description: BenchDescription, condition: tuple[str, Side | float]
) -> dict[str, Measurement]:
    """Measure a simulated bench under one of `CONDITIONS`, which a real bench can't be set to."""
    what, place = condition
    changed = {"ambient_c": place} if isinstance(place, float) else {"lubricant": what}
    bench = description.model_copy(update={"driver": {**description.driver, **changed}})
    with (
        tempfile.TemporaryDirectory(prefix="torquebench-papers-") as scratch,
        Station.open(bench, Path(scratch) / "data") as station,
    ):
        if isinstance(place, float):
            return {
                f"{side}, {place:g} °C": _few_points(station, side, round(place)) for side in SIDES
            }
        return dict(_turned(station, place, what, Path(scratch)))


def _few_points(station: Station, side: Side, seed: int) -> CalibrationData:
    profile = load_profile("verification").with_options(groups=1, points=12)
    measured = measure_verification(station, side, profile, seed)
    found = measured.result
    return referenced(found.data, measured.record.metadata, found.standard_serial)


def _turned(
    station: Station, side: Side, lubricant: str, folder: Path
) -> Iterator[tuple[str, Measurement]]:
    """Measure fresh points during rotation, an empty run, and with grease a calibration, too."""
    fresh = load_turning_profile("turning-verification").model_copy(
        update={"repeats": 1, "random": RandomPoints(speeds=4, torques=3, seed=1)}
    )
    path = folder / "table.csv"
    measure_turning(station, side, fresh, path)
    yield f"{side}, turning, {lubricant}", read_calibration(path, side=side)
    measure_turning(station, side, load_turning_profile("identification"), path)
    yield f"{side}, empty, {lubricant}", read_empty_run(path)
    if lubricant != OTHER_LUBRICANT:
        profile = load_turning_profile("turning-calibration").model_copy(
            update={"torque_shares": [0.5, 1.0]}
        )
        measure_turning(station, side, profile, path)
        yield f"{side}, calibration, {lubricant}", read_calibration(path, side=side)


def factor_errors(
    calibrations: Mapping[Side, CalibrationData],
    at_rest: Mapping[Side, CompensationModel],
    measured: Mapping[str, Measurement],
) -> tuple[FactorError, ...]:
    """Compensate all fresh points without and with the identified effects.

    Parameters
    ----------
    calibrations, at_rest : mapping
        Points of both modules at rest, and the models fitted to them.
    measured : mapping
        Results of `measured_at` for all conditions.
    """
    errors: list[FactorError] = []
    for side, calibration in calibrations.items():

        def points(
            *names: str, side: Side = side, first: CalibrationData = calibration
        ) -> dict[str, CalibrationData]:
            further = {name: measured[f"{side}, {name}"] for name in names}
            return {"at rest": first} | {
                name: each for name, each in further.items() if isinstance(each, CalibrationData)
            }

        warm = [f"{celsius:g} °C" for celsius in CALIBRATED_C]
        found = {}
        for lubricant in ("grease", OTHER_LUBRICANT):
            run = measured[f"{side}, empty, {lubricant}"]
            assert isinstance(run, EmptyRun)
            turned = ["calibration, grease"] if lubricant == "grease" else []
            found[lubricant] = identify_turning(joined_tables(points(*warm, *turned)), [run])
        curve = found["grease"].points
        model = make_model("hybrid", range_nm=curve.range_nm)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.fit_curve(curve.features(feature_columns(model)), curve.standard_nm)
        chains = {name: MeasuringChain(model, each.effects) for name, each in found.items()}
        rest = MeasuringChain(at_rest[side])
        for name, condition, chain in (
            *(
                (f"{celsius:g} °C", Message("at rest, {celsius:g} °C", celsius), "grease")
                for celsius in USED_C
            ),
            ("turning, grease", "turning, grease", "grease"),
            ("turning, oil", "turning, oil; empty run with grease", "grease"),
            ("turning, oil", "turning, oil; empty run with oil", OTHER_LUBRICANT),
        ):
            data = points(name)[name]
            worst = [
                100.0 * each.against_standard.worst_nm / data.range_nm
                for each in verify(data, {"rest": rest, "chain": chains[chain]}).models
            ]
            errors.append(FactorError(side, condition, len(data), *worst))
    return tuple(errors)


def factor_table(errors: Sequence[FactorError]) -> Table:
    """Return the table of errors by condition."""
    return Table(
        ("module, condition", "points", "raw, % FS", "at rest, % FS", "identified, % FS"),
        [
            [Message.joined((each.side, each.condition)), str(each.points), number(each.raw),
             number(each.at_rest), number(each.identified)]
            for each in errors
        ],
        "Worst error of fresh points against the standard. At rest: by the calibration "
            "at 23 °C alone. Identified: also by points at 10 and 40 °C, a calibration "
            "during rotation and an empty run.",
    )  # fmt: skip


# -- changing torque --------------------------------------------------------------------------

INTERVAL_S, NOISE_SHARE = 2e-4, 1e-4
FREQUENCIES_HZ = (10.0, 50.0, 100.0, 200.0, 300.0, 500.0)
_FINE = 20
_INERTIA, _STIFFNESS, _DAMPING = 1.0, 2.57e6, 320.0
_LAG_S, _DELAY_S = 53e-6, 167e-6


def _read(torque: FloatArray, seed: int) -> FloatArray:
    """Simulate readings of a torque that is sampled twenty times per window.

    The chain of an output module: flange on an elastic shaft, lag and delay of the transducer,
    means over windows. It is independent of `TransferFunction`.
    """
    from scipy.signal import lsim

    fine_s = INTERVAL_S / _FINE
    late = np.interp(np.arange(torque.size) - _DELAY_S / fine_s, np.arange(torque.size), torque)
    spring = [_DAMPING, _STIFFNESS]
    swinging = np.polymul([_INERTIA, *spring], [_LAG_S, 1.0])
    _, shown, _ = lsim((spring, swinging), late, np.arange(torque.size) * fine_s)
    noise = NOISE_SHARE * np.random.default_rng(seed).standard_normal(torque.size // _FINE)
    return np.asarray(shown.reshape(-1, _FINE).mean(axis=1) + noise)


def _times(seconds: float) -> FloatArray:
    return np.asarray(np.arange(round(seconds / INTERVAL_S) * _FINE) * INTERVAL_S / _FINE)


def _windows(torque: FloatArray) -> FloatArray:
    """Return the torque in the middle of every window."""
    pairs = torque.reshape(-1, _FINE)
    return np.asarray(0.5 * (pairs[:, _FINE // 2 - 1] + pairs[:, _FINE // 2]))


def _step(time_s: FloatArray, start_s: float) -> FloatArray:
    return np.clip((time_s - start_s) / 5e-4, 0.0, 1.0)


def changing_torque() -> tuple[float, float, list[Block]]:
    """Return the worst amplitude errors up to resonance, raw and compensated, and figures.

    The chain is identified from two steps and its inverse filter designed; both are then tested
    with other signals, sines and a step.
    """
    time_s = _times(0.5)
    known = _step(time_s, 0.05) - _step(time_s, 0.25)
    transfer = identify([Known(INTERVAL_S, _read(known, 1), _windows(known))], INTERVAL_S)
    designed = design_inverse(transfer, INTERVAL_S)
    late = round(designed.delay_s / INTERVAL_S)

    def compensated(reading: FloatArray) -> FloatArray:
        pushed = designed.filter.stream().push(reading, np.zeros(reading.size))
        return np.asarray(pushed.value[late:])

    rows, worst = [], [0.0, 0.0]
    for frequency in FREQUENCIES_HZ:
        time_s = _times(0.4)
        torque = np.sin(TURN * frequency * time_s)
        reading = _read(torque, 2)
        cells = []
        for place, values in enumerate((reading, compensated(reading))):
            ratio = _phasor(values, frequency) / _phasor(_windows(torque)[: values.size], frequency)
            amplitude = 100.0 * (abs(ratio) - 1.0)
            cells += [number(amplitude), number(DEG_PER_RAD * float(np.angle(ratio)))]
            if frequency <= transfer.resonance_hz:
                worst[place] = max(worst[place], abs(amplitude))
        rows.append([Message("sine, {frequency:g} Hz", frequency), *cells])
    time_s = _times(0.1)
    step = _step(time_s, 0.02)
    reading = _read(step, 3)
    after = compensated(reading)
    grid = 1e3 * INTERVAL_S * np.arange(reading.size, dtype=np.float64)
    over = [100.0 * (float(np.max(values)) - 1.0) for values in (reading, after)]
    rows.append(["step: overshoot", number(over[0]), "–", number(over[1]), "–"])
    panel = Panel(
        [
            Curve("torque", grid, _windows(step), raw=True),
            Curve("reading", grid, reading),
            Curve("after the inverse filter", grid[: after.size], after),
        ],
        "time in ms",
        "share of the step",
    )
    return worst[0], worst[1], [
        Table(
            ("torque", "amplitude before, %", "phase before, °", "amplitude after, %",
             "phase after, °"),
            rows,
            Message(
                "Errors against the known torque (synthetic chain of an output module, resonance "
                "{resonance} Hz with U = {u} Hz, windows of 0.2 ms, noise 0.01 %). It was "
                "identified from two steps; the inverse filter passes {bandwidth:.0f} Hz (-3 dB) "
                "and its values come {delay:.1f} ms later, each with the time of its torque.",
                number(transfer.resonance_hz),
                number(2.0 * transfer.standard_uncertainty("resonance_hz")),
                designed.bandwidth_hz,
                MS_PER_S * designed.delay_s,
            ),
        ),
        Diagram([panel], "A step of torque that wasn't used to identify the chain.", height=2.2),
    ]  # fmt: skip


def _phasor(values: FloatArray, frequency_hz: float) -> complex:
    """Return amplitude and phase at a frequency over whole periods, after the transient."""
    first = round(0.1 / INTERVAL_S)
    count = round(round(0.2 * frequency_hz) / frequency_hz / INTERVAL_S)
    turns = np.exp(-1j * TURN * frequency_hz * INTERVAL_S * np.arange(first, first + count))
    return complex(values[first : first + count] @ turns)
