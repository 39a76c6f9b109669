"""The page's tables: measure them on a bench, or read them from a folder."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torquebench.atomic_write import atomic_write
from torquebench.bench.certificates.torque import ReferenceCertificate
from torquebench.bench.channels import certificates
from torquebench.bench.roles import SIDES, Side
from torquebench.calibration import CalibrationData, load_profile
from torquebench.calibration.profile import Profile
from torquebench.campaign.bench_chains import referenced
from torquebench.campaign.calibrating import CALIBRATION, measure_calibration
from torquebench.campaign.fitting import ModelChoice
from torquebench.campaign.measuring import Measured, RunOptions
from torquebench.campaign.registering import registers_calibration
from torquebench.campaign.standard_reducer import FRICTION, within_certificate
from torquebench.campaign.verifying import measure_verification
from torquebench.compensation import RECOMMENDED
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.papers.factors import FactorError
from torquebench.papers.facts import FACTS, FAILED, bench_facts, read_rows, write_rows
from torquebench.procedures import FrictionSettings, StaircaseResult
from torquebench.progress import NO_PROGRESS
from torquebench.records import RunFolder
from torquebench.reducers import CertifiedFriction, load_reducer
from torquebench.station import Station
from torquebench.tables import endings, read_calibration, read_table, reads, write_calibration

FloatArray = NDArray[np.float64]
_KINDS = ("calibration", "same-points", "other-points", "alone")


@dataclass(frozen=True)
class ModuleTables:
    """Measured data of one module.

    Attributes
    ----------
    calibration : CalibrationData
        Calibration in place against the calibrator: rising in each direction, and falling if
        measured.
    same_points, other_points : CalibrationData or None
        Groups against the verification standard, at the same torques and at different torques.
    alone : CalibrationData or None
        Calibration of the transducer alone.
    certificate : ReferenceCertificate or None
        Certificate of the calibrator on this side.
    staircase : float64[n, 4] or None
        All windows of the first calibration steps, with the columns `STAIRCASE`.
    """

    calibration: CalibrationData
    same_points: CalibrationData | None = None
    other_points: CalibrationData | None = None
    alone: CalibrationData | None = None
    certificate: ReferenceCertificate | None = None
    staircase: FloatArray | None = None

    @property
    def rising(self) -> CalibrationData:
        """The rising points of the calibration, which correspond to the papers' series."""
        return self.calibration.subset(self.calibration.branch > 0)

    @property
    def verification(self) -> CalibrationData | None:
        """The fresh points in groups at the same torques, else those at different torques."""
        return self.same_points if self.same_points is not None else self.other_points


@dataclass(frozen=True)
class FrictionTable:
    """No-load torque of the standard reducer: readings of the input module, and certified values.

    Attributes
    ----------
    speed_rpm, reading_nm : float64[n]
        Nominal input speed and reading without compensation, N·m.
    repeat, branch : int64[n]
    known_nm, known_u_nm : float64[n]
        Certified torque and its U (k = 2), N·m.
    """

    speed_rpm: FloatArray
    reading_nm: FloatArray
    repeat: NDArray[np.int64]
    branch: NDArray[np.int64]
    known_nm: FloatArray
    known_u_nm: FloatArray


@dataclass(frozen=True)
class ReducerValue:
    """One quantity of a reducer test, as in its report.

    Attributes
    ----------
    test, quantity, unit : str
    value, expanded_uncertainty : float
    """

    test: str
    quantity: str
    value: float
    expanded_uncertainty: float
    unit: str


@dataclass(frozen=True)
class BenchTables:
    """All measured data of one bench.

    Attributes
    ----------
    name : str
        Name of the bench, with preset and seed of a simulated one.
    simulated : bool
    modules : mapping of side to ModuleTables
    friction : FrictionTable or None
    facts : mapping of str to str
        Results of `facts.bench_facts`.
    reducer : tuple of ReducerValue
        Results of a short test of the mounted reducer.
    factors : tuple of FactorError
        Errors over temperature, speed and lubricant.
    """

    name: str
    simulated: bool
    modules: Mapping[Side, ModuleTables]
    friction: FrictionTable | None = None
    facts: Mapping[str, str] = field(default_factory=dict)
    reducer: tuple[ReducerValue, ...] = ()
    factors: tuple[FactorError, ...] = ()


@dataclass(frozen=True)
class PapersSettings:
    """Settings of the measurements on a bench.

    Attributes
    ----------
    calibration, verification : Profile
    others : bool
        Whether groups at different torques follow those at the same torques.
    friction : FrictionSettings or None
    seed : int
        Seed of the verifications' random points.
    reducer_test : str
        Short test of `campaign.reducers` on the simulated reducer; empty for none. On a real bench,
        `torquebench test` does this with the reducer's description.
    """

    calibration: Profile = field(default_factory=lambda: load_profile("rapid-in-situ"))
    verification: Profile = field(default_factory=lambda: load_profile("verification"))
    others: bool = True
    friction: FrictionSettings | None = field(
        default_factory=lambda: FrictionSettings(counter_clockwise=False)
    )
    seed: int = 1
    reducer_test: str = "full"

    @classmethod
    def quick(cls, seed: int = 1) -> PapersSettings:
        """Return settings of a short run: few points, groups and speeds."""
        return cls(
            calibration=load_profile("rapid-in-situ").with_options(step_percent=20.0),
            verification=load_profile("verification").with_options(groups=2, points=8),
            others=False,
            friction=FrictionSettings((100.0, 1200.0), repeats=2, counter_clockwise=False),
            seed=seed,
            reducer_test="starting",
        )


def measure_tables(
    station: Station,
    settings: PapersSettings,
    certified: tuple[CertifiedFriction, ...],
    options: RunOptions,
) -> BenchTables:
    """Measure both modules against calibrator and standard, and the standard reducer's friction.

    The tables contain readings; the page compensates them by its models.

    Parameters
    ----------
    station : Station
    settings : PapersSettings
    certified : tuple of CertifiedFriction
        Certified friction of the standard reducer; by default that of the simulated bench. Without
        it, no friction is measured.
    options : RunOptions
        Options of each run.

    Raises
    ------
    LimitError, InterlockError, BenchError, SignalFault, RunAbortedError
        The measurement fails, as any procedure can.
    """
    # On a simulated bench, the reducer test uses compensated torques.
    compensated = bool(settings.reducer_test) and station.drivers.truth is not None
    registered = registers_calibration([ModelChoice(RECOMMENDED)], RECOMMENDED)
    metadata = {**options.get("metadata", {}), **(registered if compensated else {})}
    calibrating: RunOptions = {**options, "metadata": metadata}
    calibrations = {
        side: measure_calibration(station, side, settings.calibration, **calibrating)
        for side in SIDES
    }
    same = settings.verification.with_options(same_points=True)
    modules: dict[Side, ModuleTables] = {}
    for side in SIDES:
        parts = [
            measure_verification(station, side, profile, settings.seed, **options)
            for profile in ((same, settings.verification) if settings.others else (same,))
        ]
        modules[side] = ModuleTables(
            _referenced(calibrations[side]),
            _referenced(parts[0]),
            _referenced(parts[1]) if settings.others else None,
            _alone(station, side, calibrations[side].result.data),
            certificates(station.description, station.drivers, "calibrator").get(side),
            _staircase(calibrations[side], side),
        )
    certified = certified or station.drivers.reducer_certificate
    friction = None
    if settings.friction is not None and certified:
        friction = _friction(station, settings.friction, certified, options)
    if compensated:
        for side, measured in calibrations.items():
            progress = options.get("progress", NO_PROGRESS)
            CALIBRATION.evaluate_and_register(station.registry, measured, progress)
            station.activate_compensation(side)
    description = station.description
    name = description.name
    if description.simulated:
        drawn = description.simulation
        name += f", preset {drawn.get('preset', 'nominal')}, seed {drawn.get('seed', 1)}"
    quantities, failures = _reducer(station, settings.reducer_test, options)
    facts = {**bench_facts(station, options.get("mounting")), **failures}
    return BenchTables(name, description.simulated, modules, friction, facts, quantities)


STAIRCASE = ("time_s", "reading_nm", "standard_nm", "averaged")
_SHOWN_STEPS = 6
_AROUND_S = 0.5


def _staircase(measured: Measured[StaircaseResult], side: Side) -> FloatArray:
    """Return the windows of the first steps: time, torque, standard, and 1 where a mean uses it."""
    folder = RunFolder.open(measured.record.folder)
    points = [each["data"] for each in itertools.islice(folder.points(), _SHOWN_STEPS)]
    middle, samples = (
        np.array([float(each[f"{side}-steady-{name}"]) for each in points])
        for name in ("time_s", "samples")
    )
    device = f"{side}-steady"
    (window_s,) = (
        float(each["configuration"][device]["data"][f"{device}-window_s"])
        for _, each in folder.documents("descriptor")
        if each["name"] == "points"
    )
    columns = folder.raw().columns
    time_s = columns["time_s"]
    stop_s = middle + 0.5 * window_s
    start_s = stop_s - samples * float(np.median(np.diff(time_s)))  # the settled part
    kept = (time_s > start_s[0] - _AROUND_S) & (time_s < stop_s[-1])
    time_s = time_s[kept]
    inside = (time_s[:, None] > start_s) & (time_s[:, None] < stop_s)
    averaged = inside.any(axis=1)
    torques = (columns[f"{side}_{name}"][kept] for name in ("torque_nm", "reference_nm"))
    return np.column_stack([time_s - time_s[0], *torques, averaged])


def _reducer(
    station: Station, test: str, options: RunOptions
) -> tuple[tuple[ReducerValue, ...], dict[str, str]]:
    """Return the quantities of a short reducer test, and its failed parts."""
    if not test or station.drivers.truth is None:
        return (), {}
    from torquebench.campaign.reducers.settings import ReducerTestSettings
    from torquebench.campaign.reducers.tests import run_reducer_test

    held = str(station.description.simulation.get("reducer", "standard"))
    record = run_reducer_test(
        station, test, load_reducer(held), ReducerTestSettings.short(), **options
    )
    quantities = tuple(
        ReducerValue(
            outcome.title,
            each.title,
            float(each.value),
            float(each.expanded_uncertainty),
            each.unit,
        )
        for outcome in record.outcomes
        for each in outcome.quantities
    )
    return quantities, {f"{FAILED}{each.title}": str(each.message) for each in record.failures}


def measure_module(
    station: Station, side: Side, settings: PapersSettings, options: RunOptions
) -> ModuleTables:
    """Calibrate and verify one module; calibrate a simulated transducer alone, too."""
    calibrated = measure_calibration(station, side, settings.calibration, **options)
    same = settings.verification.with_options(same_points=True)
    verified = measure_verification(station, side, same, settings.seed, **options)
    data = calibrated.result.data
    return ModuleTables(
        _referenced(calibrated), _referenced(verified), None, _alone(station, side, data)
    )


def _referenced(measured: Measured[StaircaseResult]) -> CalibrationData:
    """Return the points with the data of the mounted standard."""
    found = measured.result
    return referenced(found.data, measured.record.metadata, found.standard_serial)


def _alone(station: Station, side: Side, calibration: CalibrationData) -> CalibrationData | None:
    """Return a laboratory's calibration of a simulated transducer alone, at the same steps."""
    truth = station.drivers.truth
    if truth is None or calibration.nominal_nm is None:
        return None
    steps = calibration.nominal_nm
    reading, _branch = truth.dense_sweep(side, steps, alone=True)
    return CalibrationData(
        reading,
        steps,
        calibration.series,
        calibration.branch,
        calibration.range_nm,
        side=side,
        nominal_nm=steps,
        simulated=True,
    )


def _friction(
    station: Station,
    settings: FrictionSettings,
    certified: tuple[CertifiedFriction, ...],
    options: RunOptions,
) -> FrictionTable:
    speeds = [point.speed_rpm for point in certified]
    settings = within_certificate(settings, certified)
    sweep = FRICTION.measure(station, "input", settings, **options).result
    speed = np.abs(sweep.nominal_rpm)
    return FrictionTable(
        sweep.nominal_rpm,
        sweep.torque_nm,
        sweep.repeat,
        sweep.branch.astype(np.int64),
        np.interp(speed, speeds, [point.torque_nm for point in certified]),
        np.interp(speed, speeds, [point.expanded_uncertainty_nm for point in certified]),
    )


# -- folders --------------------------------------------------------------------------------


def write_tables(folder: Path, tables: BenchTables) -> list[Path]:
    """Write all tables as CSV files into a folder that `read_tables` can read."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    remarks = {"bench": tables.name}
    for side, module in tables.modules.items():
        for kind in _KINDS:
            data = getattr(module, kind.replace("-", "_"))
            if data is not None:
                path = folder / f"{kind}-{side}.csv"
                write_calibration(path, data, remarks)
                written.append(path)
        if module.certificate is not None:
            columns = [getattr(module.certificate, name) for name in _CERTIFICATE]
            rows = zip(*(column.tolist() for column in columns), strict=True)
            path = folder / f"certificate-{side}.csv"
            written.append(write_rows(path, [_CERTIFICATE, *rows]))
        if module.staircase is not None:
            path = folder / f"staircase-{side}.csv"
            written.append(write_rows(path, [STAIRCASE, *module.staircase.tolist()]))
    if tables.facts:
        facts = [("item", "value"), *tables.facts.items()]
        written.append(write_rows(folder / FACTS, facts))
    for name, values in ((REDUCER, tables.reducer), (FACTORS, tables.factors)):
        if values:
            header = [each.name for each in fields(values[0])]
            written.append(write_rows(folder / name, [header, *map(astuple, values)]))
    if tables.friction is not None:
        path = folder / "friction-standard-reducer.csv"
        atomic_write(path, _friction_csv(tables))
        written.append(path)
    return written


_CERTIFICATE = ("torque_nm", "error_nm", "expanded_uncertainty_nm")
REDUCER, FACTORS = "reducer.csv", "factors.csv"
_FRICTION = ("speed_rpm", "reading_nm", "repeat", "branch", "known_nm", "known_u_nm")


def _friction_csv(tables: BenchTables) -> str:
    friction = tables.friction
    assert friction is not None
    lines = [f"# bench = {tables.name}", f"# simulated = {str(tables.simulated).lower()}"]
    lines.append(",".join(_FRICTION))
    columns = [getattr(friction, name) for name in _FRICTION]
    lines += [",".join(repr(value.item()) for value in row) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"


def read_tables(paths: Sequence[Path]) -> BenchTables:
    """Read recorded tables: a folder, or its files.

    At least one side needs `calibration-SIDE.csv` (or another format, see `read_table`). Optional
    files are `same-points-SIDE`, `other-points-SIDE`, `alone-SIDE`, `friction-standard-reducer`,
    `certificate-SIDE.csv` (of the calibrator), `staircase-SIDE.csv`, `reducer.csv` (quantities of a
    test), `factors.csv` and `bench.csv` (components of the bench). Columns are those of `fit`; the
    friction's are `speed_rpm`, `reading_nm`, `repeat`, `known_nm` and `known_u_nm`.

    Raises
    ------
    InputError
        There is no calibration, or a table is invalid.
    """
    files: dict[str, Path] = {}
    for each in paths:
        if not each.exists():
            raise InputError(Message("no folder {folder}", each), "a folder of recorded tables")
        files |= {file.name: file for file in ([each] if each.is_file() else each.iterdir())}
    folder = Message.joined(map(str, paths))
    modules: dict[Side, ModuleTables] = {}
    names: list[str] = []
    for side in SIDES:
        found = {
            kind.replace("-", "_"): read_calibration(path, side=side)
            for kind in _KINDS
            if (path := _table_file(files, f"{kind}-{side}")) is not None
        }
        if "calibration" in found:
            certified = _read_numbers(files.get(f"certificate-{side}.csv"), _CERTIFICATE)
            certificate = None if certified is None else ReferenceCertificate(*certified.T)
            staircase = _read_numbers(files.get(f"staircase-{side}.csv"), STAIRCASE)
            modules[side] = ModuleTables(**found, certificate=certificate, staircase=staircase)
        elif found:
            raise InputError(
                Message(
                    "{folder}: tables of the {side} module without calibration-{side}", folder, side
                ),
                "the calibration that the models are fitted to",
            )
    if not modules:
        raise InputError(
            Message("{folder}: no calibration", folder),
            Message("calibration-input or calibration-output, as {read}", reads()),
            "rename the tables; `torquebench papers-tables` writes an example",
        )
    friction = None
    path = _table_file(files, "friction-standard-reducer")
    if path is not None:
        friction, name = _read_friction(path)
        names.append(name)
    simulated = any(module.calibration.simulated for module in modules.values())
    return BenchTables(
        _bench_name(files) or paths[0].stem,
        simulated,
        modules,
        friction,
        dict(read_rows(files.get(FACTS), 2)),
        tuple(map(_reducer_value, read_rows(files.get(REDUCER), len(fields(ReducerValue))))),
        tuple(map(_factor_error, read_rows(files.get(FACTORS), len(fields(FactorError))))),
    )


def _reducer_value(row: Sequence[str]) -> ReducerValue:
    test, quantity, *stated, unit = row
    value, uncertainty = _numbers(REDUCER, stated)
    return ReducerValue(test, quantity, value, uncertainty, unit)


def _factor_error(row: Sequence[str]) -> FactorError:
    side, condition, *stated = row
    points, *errors = _numbers(FACTORS, stated)
    return FactorError(side, condition, round(points), *errors)


def _numbers(path: Path | str, cells: Iterable[str]) -> list[float]:
    try:
        return [float(cell) for cell in cells]
    except ValueError as error:
        raise InputError(
            Message("{path}: {error}", path, error), "numbers with a decimal point"
        ) from error


def _read_numbers(path: Path | None, columns: Sequence[str]) -> FloatArray | None:
    rows = [_numbers(str(path), row) for row in read_rows(path, len(columns))]
    return np.array(rows) if rows else None


def _table_file(files: Mapping[str, Path], stem: str) -> Path | None:
    return next((files[name] for e in endings() if (name := f"{stem}{e}") in files), None)


def _bench_name(files: Mapping[str, Path]) -> str:
    names = (f"calibration-{side}.csv" for side in SIDES)
    read = (read_table(files[name]).remarks.get("bench") for name in names if name in files)
    return next(filter(None, read), "")


def _read_friction(path: Path) -> tuple[FrictionTable, str]:
    table = read_table(path)
    for name in ("speed_rpm", "reading_nm", "known_nm"):
        if name not in table:
            raise InputError(Message("{path}: no column {name}", path, name), ", ".join(_FRICTION))
    n = len(table)

    def column(name: str, default: float) -> FloatArray:
        if name not in table:
            return np.full(n, default)
        return table.numbers(name)

    return (
        FrictionTable(
            column("speed_rpm", 0.0),
            column("reading_nm", 0.0),
            column("repeat", 1.0).astype(np.int64),
            column("branch", 1.0).astype(np.int64),
            column("known_nm", 0.0),
            column("known_u_nm", 0.0),
        ),
        table.remarks.get("bench", ""),
    )
