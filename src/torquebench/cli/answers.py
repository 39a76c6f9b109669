"""What each command answers with `--json`: one table of facts a command.

A new command needs its answer here. The documentation's page of answers is generated from this
file, and tests compare it with what commands print. Names end with their unit; `None` stands for a
value that is unknown or doesn't exist.
"""

from typing import Any, NotRequired, TypedDict

__all__ = ["ANSWERS", "WITHOUT_ANSWER"]


class Errors(TypedDict):
    """Worst and RMS error of points, in N·m, in % of full scale and in % of reading."""

    points: int
    worst_nm: float
    rms_nm: float
    worst_at_nm: float
    worst_percent_fs: float
    rms_percent_fs: float
    worst_percent_reading: float | None
    rms_percent_reading: float | None
    reading_rule: str


class Repeatability(TypedDict):
    """Scatter of readings of one torque between groups."""

    pooled_nm: float
    worst_nm: float
    pooled_percent_fs: float
    worst_percent_fs: float
    places: int
    rule: str


class VerifiedModel(TypedDict):
    """Errors of one model, or of the raw reading, at points that it wasn't fitted to."""

    name: str
    against_standard: Errors
    against_truth: Errors | None
    groups: list[Errors]
    averaged: Errors | None
    repeatability: Repeatability | None
    expanded_uncertainty_nm: float | None


class Contradiction(TypedDict):
    """Contradictory points of a calibration."""

    kind: str
    clause: str
    found: str
    allowed: str
    cause: str


class Deviation(TypedDict):
    """Deviations of a calibration from its profile, and their treatment in the certificate."""

    kind: str
    clause: str
    found: str
    allowed: str
    consequence: str
    key: str
    values: dict[str, str | float]


class Finding(TypedDict):
    """Findings of a reducer test besides its quantities."""

    name: str
    message: str
    remedy: str
    severe: bool


class DemoModule(TypedDict):
    """One module of the demo."""

    side: str
    range_nm: float
    transducer: str
    recommended: str
    models: list[VerifiedModel]
    runs: list[str]


class Demo(TypedDict):
    """Both modules, raw and by each model."""

    simulated: bool
    modules: list[DemoModule]
    bench_seconds: float
    files: list[str]


class CalibratedModule(TypedDict):
    """One module after its calibration."""

    side: str
    range_nm: float
    transducer: str
    simulated: bool
    points: int
    kind: str
    raw: Errors
    fitted: Errors
    loading_accuracy_percent: float | None
    model: str
    calibration: str
    in_use: bool
    run: str
    unsettled: int
    contradictions: list[Contradiction]


class Plan(TypedDict):
    """Loads of a `--dry-run`."""

    side: str
    points: int
    duration_s: float


class Calibrated(TypedDict):
    """Calibrated modules, or the plans of a dry run."""

    modules: NotRequired[list[CalibratedModule]]
    plans: NotRequired[list[Plan]]
    files: NotRequired[list[str]]


class CheckedPoint(TypedDict):
    """One point against the check standard."""

    standard_nm: float
    error_nm: float
    expanded_uncertainty_nm: float
    verdict: str


class Check(TypedDict):
    """A module against the check standard."""

    side: str
    range_nm: float
    transducer: str
    simulated: bool
    model: str | None
    points: list[CheckedPoint]
    verdict: str
    worst_percent_fs: float
    tolerance_percent_fs: float
    run: str
    not_in_u: list[str]


class Certificate(TypedDict):
    """A certificate that was issued, or that was checked."""

    number: str
    simulated: NotRequired[bool]
    verdict: NotRequired[str | None]
    tolerance_percent_fs: NotRequired[float | None]
    unreviewed: NotRequired[list[str]]
    deviations: NotRequired[list[Deviation]]
    supersedes: NotRequired[str]
    files: NotRequired[list[str]]
    matches: NotRequired[bool]
    findings: NotRequired[list[str]]
    schema: NotRequired[str]
    replaced_by: NotRequired[str]


class ComparedModel(TypedDict):
    """One kind of model at steps that it wasn't fitted to."""

    name: str
    worst_nm: float
    rms_nm: float
    worst_averaged_nm: float
    worst_percent_fs: float
    rms_percent_fs: float
    worst_percent_reading: float
    effective_parameters: float
    fit_time_s: float
    complexity: int
    mean_square_difference: float
    standard_error: float
    reason: str


class Fitted(TypedDict):
    """A model that was fitted to a table; `comparison` with `--compare`."""

    points: int
    range_nm: float
    simulated: bool
    kind: str
    title: str
    raw: Errors
    fitted: Errors
    scatter_nm: float | None
    comparison: NotRequired[list[ComparedModel]]
    contradictions: list[Contradiction]
    files: list[str]


class Applied(TypedDict):
    """Readings that were compensated."""

    rows: int
    simulated: bool
    lowest_nm: float
    highest_nm: float
    largest_uncertainty_nm: float
    unmeasured: list[str]
    files: list[str]


class Cell(TypedDict):
    """Errors and coverage of U in a range of speed, temperature and torque."""

    speed_rpm: list[float] | None
    temperature_c: list[float] | None
    torque_share: list[float]
    points: int
    rms_percent_fs: float
    worst_percent_fs: float
    coverage: float


class Verified(TypedDict):
    """Models at points that they weren't fitted to; the verdict is that of the second entry."""

    range_nm: float
    groups: int
    points: int
    simulated: bool
    models: list[VerifiedModel]
    tolerance_percent_fs: float
    passed: bool
    not_in_u: list[str]
    cells: NotRequired[list[Cell]]
    run: NotRequired[str]
    files: NotRequired[list[str]]


class ExportedModel(TypedDict):
    """A model's table for other programs."""

    intervals: int
    degree: int
    branch_aware: bool
    low_nm: float
    high_nm: float
    largest_deviation_nm: float
    files: list[str]


class DataSheet(TypedDict):
    """A transducer's electronic data sheet, as `teds read` writes it."""

    basic: dict[str, Any]
    templates: list[dict[str, Any]]
    text: NotRequired[str]
    free_bits: NotRequired[str]
    unread: NotRequired[dict[str, str]]


class DataSheetShown(TypedDict):
    """What a memory holds."""

    sheet: DataSheet


class DataSheetRead(TypedDict):
    """Content of a memory, and the file that it was written to."""

    sheet: DataSheet
    files: list[str]


class CalibrationCurve(TypedDict):
    """A compensation as calibration curve, and how far it deviates from the compensation."""

    segments: int
    power: int
    residual_nm: float
    residual_percent_fs: float
    branch_residual_nm: float
    branch_residual_percent_fs: float


class DataSheetWritten(TypedDict):
    """Written content of a memory; `bytes` without checksums."""

    sheet: DataSheet
    bytes: int
    curve: CalibrationCurve | None
    files: list[str]


class BudgetLine(TypedDict):
    """One quantity of a budget; `share` is of the variance, 0 to 1.

    `shared` names what its errors are common to: "calibration", "mounting", "zeroing", "loading",
    or "nothing".
    """

    name: str
    unit: str
    value: float
    standard_uncertainty: float
    degrees_of_freedom: float | None
    distribution: str
    sensitivity: float
    contribution: float
    share: float
    shared: str


class BudgetedReading(TypedDict):
    """The budget of one compensated reading, and the interval of Monte Carlo."""

    reading_nm: float
    branch: str
    torque_nm: float
    standard_uncertainty_nm: float
    coverage_factor: float
    expanded_uncertainty_nm: float
    lines: list[BudgetLine]
    monte_carlo_low_nm: float
    monte_carlo_high_nm: float
    agrees: bool


class Budgets(TypedDict):
    """One budget a reading."""

    readings: list[BudgetedReading]


class MeasuredTorque(TypedDict):
    """Torque of one side: `state` is compensated, raw, beyond range or the fault's name.

    Beyond a range, `detail` names the effect that refuses, the value and the range.
    """

    torque_nm: float | None
    expanded_uncertainty_nm: float | None
    state: str
    detail: str


class MeasuredLine(TypedDict):
    """One averaged interval; `measure` prints each as a line of its own under `line`."""

    time_s: float
    input: MeasuredTorque
    output: MeasuredTorque
    speed_rpm: float | None
    acceleration_rpm_s: float | None
    temperature_c: float


class Measured(TypedDict):
    """Models in use; the measured lines precede it, one JSON object each."""

    simulated: bool
    compensation: dict[str, str]
    not_in_u: dict[str, list[str]]
    lines: int


class Turned(TypedDict):
    """A turning run, or its plan (`--dry-run`)."""

    side: str
    profile: str
    simulated: bool
    rows: NotRequired[int]
    bench_seconds: NotRequired[float]
    run: NotRequired[str]
    files: NotRequired[list[str]]
    points: NotRequired[int]
    duration_s: NotRequired[float]


class PaperItem(TypedDict):
    """One item of the source papers."""

    item: str
    verdict: str


class Papers(TypedDict):
    """The items of the source papers."""

    simulated: bool
    items: list[PaperItem]
    files: list[str]


class InPlace(TypedDict):
    """Worst error of fresh readings in the chain, for each calibration."""

    side: str
    range_nm: float
    simulated: bool
    worst_percent_fs: dict[str, float | None]
    files: NotRequired[list[str]]


class DoctorFinding(TypedDict):
    """One thing that was examined: `state` is ok, note or problem."""

    what: str
    state: str
    found: str
    remedy: str


class Doctor(TypedDict):
    """Everything that was examined."""

    findings: list[DoctorFinding]
    problems: int


class TestQuantity(TypedDict):
    """One quantity of a reducer test, with U (95.45 % coverage)."""

    key: str
    title: str
    value: float
    expanded_uncertainty: float
    unit: str
    limit: str
    verdict: str
    rule: str


class TestPart(TypedDict):
    """One test of a reducer."""

    test: str
    title: str
    run: str
    quantities: list[TestQuantity]
    findings: list[Finding]
    remarks: list[str]


class TestFailure(TypedDict):
    """A test without a result."""

    name: str
    title: str
    message: str
    remedy: str


class TestPlan(TypedDict):
    """Rehearsal of a test (`--dry-run`)."""

    name: str
    title: str
    duration_s: float
    longest_s: float
    longest_warm_up_s: float
    points: int
    largest_torque_nm: dict[str, float]
    largest_speed_rpm: dict[str, float]


class ReducerTest(TypedDict):
    """Tests of a mounted reducer against its data sheet, or their plans."""

    reducer: str
    serial: str
    simulated: bool
    short: NotRequired[bool]
    parts: NotRequired[list[TestPart]]
    failures: NotRequired[list[TestFailure]]
    verdict: NotRequired[str]
    plans: NotRequired[list[TestPlan]]
    files: NotRequired[list[str]]


class FrictionPoint(TypedDict):
    """Known and measured friction at one speed."""

    speed_rpm: float
    known_nm: float
    measured_nm: list[float]
    error_percent_fs: float
    repeatability_percent_fs: float


class StandardReducer(TypedDict):
    """A standard reducer's certified friction against measured friction."""

    reducer: str
    simulated: bool
    compensation: str
    points: list[FrictionPoint]
    error_percent_fs: float
    repeatability_percent_fs: float
    tolerance_percent_fs: float
    passed: bool
    run: str
    files: NotRequired[list[str]]


class ComparedQuantity(TypedDict):
    """One quantity of several specimens: the change of one, or the mean of many."""

    key: str
    title: str
    unit: str
    value: float
    expanded_uncertainty: float
    specimens: list[float]
    significant: NotRequired[bool]
    spread: NotRequired[float]
    outliers: NotRequired[list[str]]


class ComparedSpecimens(TypedDict):
    """Specimens of one type, or one specimen before and after."""

    reducer: str
    test: str
    simulated: bool
    serials: list[str]
    runs: list[str]
    quantities: list[ComparedQuantity]
    files: NotRequired[list[str]]


class TableOfNumbers(TypedDict):
    """A table as it is printed: the headers name quantity and unit."""

    header: list[str]
    rows: list[list[str | float]]


class Mechanics(TypedDict):
    """Results, in words and as tables."""

    result: str
    tables: list[TableOfNumbers]
    facts: dict[str, str]
    files: NotRequired[list[str]]


class Defect(TypedDict):
    """A record that has changed since its entry."""

    kind: str
    where: str
    found: str
    remedy: str


class RecordsVerified(TypedDict):
    """All records and files compared with their entries."""

    intact: bool
    records: int
    runs: int
    files_compared: int
    audit_lines: int
    chain_end: str
    defects: list[Defect]


class Entered(TypedDict):
    """Entries in the registry."""

    record: str


class BackedUp(TypedDict):
    """Result of a backup."""

    runs: int
    known_runs: int
    open_runs: list[str]
    files_copied: int
    outside: list[str]
    problems: list[str]
    chain_end: str


class Restored(TypedDict):
    """Result of a restore."""

    restored: list[str]
    replaced: list[str]
    kept: list[str]
    aside: str | None


class Rebuilt(TypedDict):
    """Content of a rebuilt registry."""

    anew: bool
    mended: list[str]
    aside: str | None
    runs: list[str]
    calibrations: list[str]
    models: list[str]
    certificates: list[str]
    unfitted: list[str]
    problems: list[str]


class ExportedRun(TypedDict):
    """An exported run."""

    folder: str
    files: list[str]


class ExportedData(TypedDict):
    """A run's samples or edges for other programs."""

    run: str
    stream: str
    format: str
    files: list[str]


class CalibrationStep(TypedDict):
    """One reading on one branch (1 rising, -1 falling) by two calibrations."""

    reading_nm: float
    branch: int
    before_nm: float
    after_nm: float
    change_nm: float
    expanded_uncertainty_nm: float
    normalised_error: float
    significant: bool


class ComparedCalibrations(TypedDict):
    """Two calibrations of one transducer."""

    before: str
    after: str
    transducer: str
    simulated: bool
    steps: list[CalibrationStep]
    verdict: str
    files: NotRequired[list[str]]


class Chart(TypedDict):
    """One quantity of a transducer over time."""

    title: str
    unit: str
    simulated: bool
    moments: list[str]
    values: list[float]
    tolerance: float
    mean: float | None
    lower: float | None
    upper: float | None
    in_control: bool | None
    per_year: float | None
    significant: bool | None
    leaves_tolerance: str | None


class Drift(TypedDict):
    """Control charts of one transducer."""

    transducer: str
    charts: list[Chart]
    due: str | None


class Audit(TypedDict):
    """Lines of the audit log as they are written in its files."""

    lines: list[dict[str, Any]]
    earlier: int


class ListedRun(TypedDict):
    """One run."""

    run: str
    started: str
    status: str
    bench: str
    simulated: bool


class ListedCalibration(TypedDict):
    """One calibration."""

    name: str
    performed: str
    transducer: str
    points: int
    range_nm: float
    profile: str
    simulated: bool


class ListedModel(TypedDict):
    """One model."""

    name: str
    created: str
    kind: str
    transducer: str
    range_nm: float
    in_use: bool
    simulated: bool


class ListedEquipment(TypedDict):
    """One piece of equipment."""

    kind: str
    serial: str
    manufacturer: str
    model: str
    range_nm: float | None


class Listed(TypedDict):
    """Content of the registry, the newest first; `more` names lists that go on."""

    runs: NotRequired[list[ListedRun]]
    calibrations: NotRequired[list[ListedCalibration]]
    models: NotRequired[list[ListedModel]]
    equipment: NotRequired[list[ListedEquipment]]
    more: list[str]


class Shown(TypedDict):
    """One record: `facts` as printed, `record` as registered."""

    name: str
    facts: dict[str, str]
    record: dict[str, Any]
    verifications: NotRequired[list[dict[str, Any]]]


class EquipmentShown(TypedDict):
    """Equipment of one serial number with everything that was entered about it."""

    equipment: list[dict[str, Any]]


class FinishedRuns(TypedDict):
    """Finished runs, and their calibrations."""

    finished: list[str]
    unfinished: NotRequired[list[str]]
    modules: NotRequired[list[CalibratedModule]]


class EvaluatedStatic(TypedDict):
    """A calibration in steps; `results` as in the file of `--out`."""

    profile: dict[str, str]
    data_sha256: str
    points: int
    range_nm: float
    deviations: list[Deviation]
    steps_of_profile: bool
    left_out: list[str]
    results: dict[str, Any] | None
    calibration: NotRequired[str]
    model: NotRequired[str | None]
    run: NotRequired[str]
    files: NotRequired[list[str]]


class EstimatedValue(TypedDict):
    """A value with U (k = 2)."""

    value: float
    expanded_uncertainty: float
    unit: str


class EvaluatedDynamics(TypedDict):
    """Resonance, damping and lag of a chain, and the filter that inverts them."""

    simulated: bool
    parameters: dict[str, EstimatedValue]
    bandwidth_hz: float
    noise_gain: float
    delay_s: float
    files: list[str]


class EvaluatedLubrication(TypedDict):
    """Factor on the drag of the bearings by the present lubricant."""

    factor: EstimatedValue
    record: str
    files: list[str]


class EvaluatedQuantity(TypedDict):
    """One quantity with U (95.45 % coverage)."""

    key: str
    title: str
    rule: str
    value: float
    expanded_uncertainty: float
    coverage_factor: float
    unit: str
    limit: NotRequired[str]
    verdict: NotRequired[str]


class EvaluatedReducer(TypedDict):
    """A reducer test from a table."""

    test: str
    data: str
    quantities: list[EvaluatedQuantity]
    findings: list[Finding]
    files: NotRequired[list[str]]


class PlantBench(TypedDict):
    """One bench of a plant; the URL only where it was registered just now."""

    number: int
    name: str
    place: NotRequired[str]
    entries: NotRequired[int]
    runs: NotRequired[int]
    folders: NotRequired[int]
    last_contact: NotRequired[str | None]
    replaced_by: NotRequired[int | None]
    url: NotRequired[str]


class PlantBenches(TypedDict):
    """Benches of a plant."""

    benches: list[PlantBench]


class PlantMade(TypedDict):
    """A plant's registry, or a user of it."""

    plant: str
    folders: NotRequired[str]
    url: NotRequired[str]


class PlantSent(TypedDict):
    """Data sent by a bench."""

    bench: str
    entries: int
    folders: int
    bytes: int
    chain_end: str
    withdrawn: list[str]
    problems: list[str]


class PlantRunListed(TypedDict):
    """One run of a plant."""

    run: str
    bench: str
    kind: str
    started: str
    status: str
    specimen_type: str
    serial: str
    batch: str
    simulated: bool
    withdrawn: bool


class PlantRuns(TypedDict):
    """Runs of a plant, the newest first."""

    runs: list[PlantRunListed]


class PlantWithdrawn(TypedDict):
    """A run that was withdrawn, and in how many registries it was known."""

    run: str
    bench: str
    known: int


class PlantVerifiedBench(TypedDict):
    """One bench's hash chain in the plant."""

    bench: str
    entries: int
    defects: list[str]


class PlantVerified(TypedDict):
    """All chains of a plant."""

    benches: list[PlantVerifiedBench]


class PlantAnswer(TypedDict):
    """An answer of the plant as a table: names end with their unit, values are in the rows."""

    title: str
    simulated: bool
    rows: list[dict[str, Any]]
    facts: dict[str, Any]
    notes: list[str]
    files: NotRequired[list[str]]


_PLANT_QUESTIONS = (
    "due",
    "drift",
    "specimens",
    "capability",
    "charts",
    "outliers",
    "compare",
    "reevaluate",
)
_REDUCER_TESTS = (
    "starting",
    "back-driving",
    "transmission-error",
    "hysteresis",
    "no-load",
    "efficiency",
    "full",
)
_REDUCER_EVALUATIONS = (
    "hysteresis",
    "friction",
    "no-load",
    "breakaway",
    "transmission-error",
    "efficiency",
)

ANSWERS: dict[str, type] = {
    "demo": Demo,
    "calibrate": Calibrated,
    "check": Check,
    "certificate": Certificate,
    "fit": Fitted,
    "apply": Applied,
    "verify": Verified,
    "verification": Verified,
    "export": ExportedModel,
    "budget": Budgets,
    "measure": Measured,
    "turn": Turned,
    "papers": Papers,
    "in-place": InPlace,
    "doctor": Doctor,
    **{f"test {name}": ReducerTest for name in _REDUCER_TESTS},
    "test standard-reducer": StandardReducer,
    "test compare": ComparedSpecimens,
    "mechanics additional-torque": Mechanics,
    "mechanics sections": Mechanics,
    "mechanics supports": Mechanics,
    "records verify": RecordsVerified,
    "records review": Entered,
    "records amend": Entered,
    "records use": Entered,
    "records backup": BackedUp,
    "records restore": Restored,
    "records rebuild": Rebuilt,
    "records export": ExportedRun,
    "records export-data": ExportedData,
    "records compare": ComparedCalibrations,
    "records drift": Drift,
    "records audit": Audit,
    "records equipment": EquipmentShown,
    "records add-equipment": Entered,
    "records add-certificate": Entered,
    "records fit-part": Entered,
    "records adjust": Entered,
    "records finish": FinishedRuns,
    "records discard": Entered,
    "records list": Listed,
    "records show": Shown,
    "teds show": DataSheetShown,
    "teds read": DataSheetRead,
    "teds write": DataSheetWritten,
    "evaluate static": EvaluatedStatic,
    "evaluate dynamics": EvaluatedDynamics,
    "evaluate lubrication": EvaluatedLubrication,
    **{f"evaluate {name}": EvaluatedReducer for name in _REDUCER_EVALUATIONS},
    "plant init": PlantMade,
    "plant register": PlantBenches,
    "plant add-reader": PlantMade,
    "plant push": PlantSent,
    "plant status": PlantBenches,
    "plant runs": PlantRuns,
    "plant withdraw": PlantWithdrawn,
    "plant verify": PlantVerified,
    **{f"plant {name}": PlantAnswer for name in _PLANT_QUESTIONS},
}
"""The answer of each command, by its name."""

WITHOUT_ANSWER = {
    "panel": "serves the panel until it is ended",
    "plant view": "serves the plant's view until it is ended",
    "simulate": "serves simulated instruments until it is ended",
}
"""Commands without `--json`, and the reason."""
