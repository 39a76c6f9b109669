"""The page with every item of the papers: figure or table, and verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData, repeatability
from torquebench.compensation import NetworkModel
from torquebench.figures import Curve
from torquebench.papers.acquisition import acquisition_blocks, streamed
from torquebench.papers.factors import changing_torque, factor_table
from torquebench.papers.facts import FAILED, MOUNTING
from torquebench.papers.in_place import alone_cells, alone_diagram, alone_row, alone_table
from torquebench.papers.items import (
    HARDWARE,
    ITEMS,
    LIMIT_PERCENT,
    LOADING,
    SUB_SYSTEMS,
    Answer,
    Fulfilment,
)
from torquebench.papers.mechanics import (
    DESIGNS,
    Blocks,
    additional_torque_blocks,
    section_blocks,
    sign_blocks,
    support_blocks,
)
from torquebench.papers.models import (
    BP_DIRECT,
    BP_RESIDUAL,
    CHOICES,
    NODE_EPOCHS,
    POLYNOMIAL,
    RECOMMENDED_NAME,
    FittedModule,
)
from torquebench.papers.study import CHAINS, CLAIMED_RATIO, NETWORK_NM, POLYNOMIAL_NM, Row
from torquebench.papers.tables import BenchTables, FrictionTable
from torquebench.reducers import CertifiedFriction, FrictionCheck, check_friction
from torquebench.reports.calibration_report import error_curves, loading_figures
from torquebench.reports.curve_figures import Panel
from torquebench.reports.errors_table import number
from torquebench.reports.page import Diagram, Facts, Page, Section, Table
from torquebench.reports.reducers.standard import (
    friction_check_table,
    friction_diagram,
)
from torquebench.reports.verification_report import (
    Verified,
    before_after_diagram,
    kept_words,
    verification_tables,
)
from torquebench.uncertainty import stated

MESH_M, STREAM_S = (0.06, 0.12), (5.0, 1.0)
"""Size of finite elements, and duration of the stream, for the full and the quick page."""


@dataclass(frozen=True, eq=False)
class BenchResult:
    """One bench's tables, and the models fitted to them.

    Attributes
    ----------
    tables : BenchTables
    modules : mapping of side to FittedModule
    """

    tables: BenchTables
    modules: Mapping[Side, FittedModule]


Items = dict[int, tuple[Answer, Blocks]]


def papers_page(
    benches: Sequence[BenchResult], study: Sequence[Row], seeds: int, *, quick: bool = False
) -> Page:
    """Build the page from all measured and computed results.

    Parameters
    ----------
    benches : sequence of BenchResult
        Benches; the figures are those of the first, and several simulated ones show the influence
        of the seed.
    study : sequence of Row
        Results of `study.Study`.
    seeds : int
        Number of chains of each family in the study.
    quick : bool
        Whether to use coarse finite elements and a short stream.
    """
    first = benches[0]
    items: Items = {
        **_bench_items(first, STREAM_S[quick]),
        **_mechanics_items(MESH_M[quick]),
        **_calibration_items(first),
        14: _groups(benches),
        15: study_blocks(study, seeds),
        16: _alone(benches),
        17: _standard_reducer(benches),
        **_interface_items(benches),
        22: acquisition_blocks(),
    }
    simulated = first.tables.simulated
    heading = "The two source papers, item by item"
    sections = [_summary(items, benches)]
    for number_, (answer, blocks) in sorted(items.items()):
        item = ITEMS[number_]
        text = f"Papers: {item.theirs}. Here: {answer.ours}."
        if answer.why:
            text += f" {answer.why[0].upper()}{answer.why[1:]}."
        text += f" Command: {item.command}."
        sections.append(Section(f"{number_}. {item.title}: {answer.verdict}", text, blocks))
    sections.append(_beyond())
    return Page(
        heading,
        "Yu and Zhang, Journal of Sensors, 2021 [J]; Yu, Zhang, Yu and Liu, Measurement and "
        "Control, 2022 [M], doi 10.1177/00202940221103308. Bench: "
        + "; ".join(bench.tables.name for bench in benches),
        sections,
        simulated=simulated,
    )


def _summary(items: Items, benches: Sequence[BenchResult]) -> Section:
    rows = [
        [
            f"{number_}. {ITEMS[number_].title}",
            ITEMS[number_].theirs,
            answer.ours,
            answer.verdict + (f": {answer.why}" if answer.why else ""),
        ]
        for number_, (answer, _) in sorted(items.items())
    ]
    verdicts = [answer.verdict for answer, _ in items.values()]
    counted = ", ".join(f"{verdicts.count(each)} {each}" for each in dict.fromkeys(verdicts))
    source = "simulated" if benches[0].tables.simulated else "measured"
    return Section(
        "Summary",
        f"{len(items)} items: {counted}. Figures of benches are {source}; those of items 4 to 7, "
        "15 and 22, the stream in 3 and the changing torque in 19 are computed. The tables and "
        "pictures of the papers aren't available as text: what is compared is what their text "
        "states.",
        (Table(("item", "the papers", "here", "met or not, and why"), rows, words=True),),
    )


BEYOND = (
    (
        "chains that rotate",
        "temperature, drag, inertia and ripple are identified from empty runs and corrected: "
        "coverage of U 94.7 to 96.8 % by speed, torque and temperature (synthetic)",
        "benchmarks.rotating",
    ),
    (
        "U of every reading",
        "coverage of single readings by tenths of the range 89 to 97 % on chains of another "
        "author's generator (synthetic, 50 points)",
        "benchmarks.compensation",
    ),
    (
        "calibrations that contradict themselves",
        "in two loops 96 to 100 % of faults beyond 3 U found at the right rows, none of 720 "
        "healthy tables refused (simulated)",
        "benchmarks.contradictions",
    ),
    (
        "recordings of other benches",
        "six kinds of recordings with their disturbances: coverage of U 90 to 100 % (synthetic)",
        "benchmarks.evaluations",
    ),
    (
        "other people's instruments",
        "16 instruments (SCPI, VISA, Modbus, CANopen, NI-DAQmx, HBM, displays, OPC UA) pass 13 "
        "tests each against independent devices (simulated), none yet on hardware",
        "tests/system/test_driver_contract.py",
    ),
)
"""Subjects that the papers don't treat: subject, result (from docs/benchmarks.md), benchmark."""


def _beyond() -> Section:
    return Section(
        "Beyond the papers",
        "Measured by separate benchmarks, which the documentation lists with all figures.",
        (Table(("subject", "here", "measured with"), [list(row) for row in BEYOND], words=True),),
    )


# -- items 1 to 3: the bench ------------------------------------------------------------------


def _bench_items(bench: BenchResult, stream_s: float) -> Items:
    facts = bench.tables.facts
    described = [name for name in SUB_SYSTEMS if facts.get(name)]
    systems = Table(
        ("sub-system", "here"),
        [[name, facts.get(name, "not in the bench description")] for name in SUB_SYSTEMS],
        words=True,
    )
    missing = [name for name in SUB_SYSTEMS if name not in described]
    return {
        1: (
            Answer(
                f"{len(described)} of {len(SUB_SYSTEMS)} described",
                "met" if not missing else "partly",
                "rail and supply are devices with interlocks"
                if not missing
                else ", ".join(missing) + " missing from the description or the tables",
            ),
            [systems],
        ),
        2: _mounting(facts),
        3: _hardware(bench, stream_s),
    }


_MOUNTED = ("Coaxiality found", "Clamp pressure", "Time to mount", "Lubrication")


def _mounting(facts: Mapping[str, str]) -> tuple[Answer, Blocks]:
    found = {
        name.removeprefix(MOUNTING): value
        for name, value in facts.items()
        if name.startswith(MOUNTING)
    }
    coaxiality = found.get("Coaxiality found")
    block = Facts(
        (
            ("Modes", "free, driven, locked on each side, with interlocks"),
            ("Clamp", "hydraulic; closed before torque is applied, opened only without load"),
            *found.items(),
            *((name, "not entered") for name in _MOUNTED if name not in found),
        )
    )
    if coaxiality is None:
        answer = Answer(
            "modes and clamp with interlocks",
            "partly",
            "no data of the mounting were entered (--mounting)",
        )
    else:
        kept = "≤" in coaxiality
        answer = Answer(
            f"coaxiality {coaxiality}",
            "met" if kept else "not met",
            "the record of the mounting, which the certificate states"
            if kept
            else "the axes are further apart than the limit",
        )
    return answer, [block]


def _hardware(bench: BenchResult, stream_s: float) -> tuple[Answer, Blocks]:
    facts, stream = bench.tables.facts, streamed(stream_s)
    rows = [
        [name, theirs, facts.get(name, "not in the tables")] for name, theirs in HARDWARE.items()
    ]
    worst: list[float] = []
    figures: Blocks = []
    for side, module in bench.modules.items():
        data = module.tables.calibration
        accuracy = data.loading_accuracy_percent
        if accuracy is not None:
            worst.append(accuracy)
            rows.append([f"loading, {side}", LOADING, f"{number(accuracy)} % of range"])
            figures += loading_figures(data)
    table = Table(
        ("hardware", "the papers", "this bench"),
        rows,
        "Loading: largest difference of the standard from the requested torque, over all "
        "steps of the calibration; the figures show every step.",
        words=True,
    )
    card = Facts(
        (
            ("Stream of a card", f"simulated, {stream.edges_per_s:,.0f} edges/s on 4 "
             f"channels, blocks of 10 ms, at its rate for {stream.seconds:g} s"),
            ("Blocks lost", f"{stream.lost} of {stream.blocks}"),
            ("Windows refused", str(stream.faults)),
        )
    )  # fmt: skip
    loading = f"loading within {number(max(worst))} % of range" if worst else "no targets recorded"
    kept = bool(worst) and max(worst) <= LIMIT_PERCENT and not stream.lost and not stream.faults
    return Answer(
        f"{loading}; {stream.lost} of {stream.blocks} blocks of a simulated card lost",
        "partly" if not worst else "met" if kept else "not met",
        "their FlexRIO card (PXIe-7961) would stream edges or frequency to a driver plugin, "
        "or into files, in the same way; torquebench wasn't tried on one",
    ), [table, card, *figures]


# -- items 4 to 7 -----------------------------------------------------------------------------


def _mechanics_items(mesh_m: float) -> Items:
    parts = [additional_torque_blocks(design) for design in DESIGNS.values()]
    answer = Answer("; ".join(each.ours for each, _ in parts), parts[0][0].verdict, parts[0][0].why)
    return {
        4: (answer, [block for _, blocks in parts for block in blocks]),
        5: sign_blocks(),
        6: section_blocks(),
        7: support_blocks(size_m=mesh_m),
    }


# -- items 8 to 13: calibration, models, errors -----------------------------------------------


def _calibration_items(bench: BenchResult) -> Items:
    """Return answers and figures of the papers' items about calibration, by item number."""
    curves, staircase = _error_curves(bench), _loading(bench)
    before_after, answers = _before_after(bench)
    trained = _training(bench)
    points = {side: len(each.tables.rising) for side, each in bench.modules.items()}
    steps = ", ".join(
        f"{count} rising points of the {side} module" for side, count in points.items()
    )
    return {
        8: _calibrator(bench),
        9: (Answer(steps, "shown", "0.5 s a step, mean of the settled part"), staircase),
        10: trained,
        11: (
            Answer(_polynomial_words(bench), "shown", "fitted to the same rising points"),
            _polynomials(bench),
        ),
        12: (Answer(_raw_words(bench), "shown", ""), curves),
        13: (answers, before_after),
    }


def _calibrator(bench: BenchResult) -> tuple[Answer, Blocks]:
    panels, words = [], []
    for side, module in bench.modules.items():
        found = module.tables.certificate
        if found is None:
            continue
        points = int(np.sum(found.torque_nm > 0.0))
        stated_nm = float(np.max(found.expanded_uncertainty_nm))
        words.append(f"{side}: {points} points in each direction, U up to {number(stated_nm)} N·m")
        upper, lower = found.error_nm + stated_nm, found.error_nm - stated_nm
        panels.append(
            Panel(
                [
                    Curve("error", found.torque_nm, found.error_nm),
                    Curve("error + U", found.torque_nm, upper, raw=True),
                    Curve("error - U", found.torque_nm, lower, raw=True),
                ],
                "torque in N·m",
                "error in N·m",
                title=f"calibrator, {side} side",
            )
        )
    if not panels:
        return Answer("no certificate of the calibrator", "not measured", "give its CSV file"), []
    figure = Diagram(
        panels,
        "Errors of the calibrator at its certified points, corrected in every calibration.",
        columns=2,
    )
    return Answer("; ".join(words), "met", "two outputs, errors corrected between points"), [figure]


def _polynomials(bench: BenchResult) -> Blocks:
    panels, rows = [], []
    for side, module in bench.modules.items():
        data = module.tables.rising
        grid = np.linspace(data.reading_nm.min(), data.reading_nm.max(), 200)
        torque = module.models[POLYNOMIAL].torque_nm(grid, np.ones(grid.size))
        order = np.argsort(data.reading_nm)
        points = data.additional_torque_nm[order]
        panels.append(
            Panel(
                [
                    Curve("points", data.reading_nm[order], points, raw=True),
                    Curve("polynomial, degree 2", grid, torque - grid),
                ],
                "reading in N·m",
                "additional torque in N·m",
                title=f"{side} module",
            )
        )
        c2, c1, c0 = np.polyfit(grid / data.range_nm, torque, 2)
        rows.append([side, *(number(value, 5) for value in (c0, c1, c2))])
    return [
        Diagram(panels, "The polynomial through the rising points.", columns=2),
        Table(
            ("module", "c0, N·m", "c1, N·m", "c2, N·m"),
            rows,
            "Torque = c0 + c1 x + c2 x², x: reading by range.",
        ),
    ]


def _raw_words(bench: BenchResult) -> str:
    words = []
    for side, module in bench.modules.items():
        data = module.tables.rising
        worst = 100.0 * float(np.max(np.abs(module.errors_nm(data)))) / data.range_nm
        words.append(f"{side}: up to {number(worst)} % FS before compensation")
    return "; ".join(words)


def _polynomial_words(bench: BenchResult) -> str:
    return "; ".join(
        f"{side}: {number(np.max(np.abs(each.errors_nm(each.tables.rising, POLYNOMIAL))))} N·m on "
        "its own points"
        for side, each in bench.modules.items()
    )


def _loading(bench: BenchResult) -> Blocks:
    blocks: Blocks = []
    for side, module in bench.modules.items():
        data, first = module.tables.calibration, module.tables.staircase
        if data.time_s is None:
            continue
        panels = [
            Panel(
                [Curve("", data.time_s - data.time_s[0], data.standard_nm)],
                "bench time in s",
                "standard in N·m",
                markers=True,
            )
        ]
        words = "the steps as the calibrator read them."
        if first is not None:
            time_s, _reading, standard, averaged = first.T
            panels.append(
                Panel(
                    [
                        Curve(name, time_s, np.where(averaged == part, standard, np.nan))
                        for name, part in (("settling", 0.0), ("averaged: DC component", 1.0))
                    ],
                    "time in s",
                    "torque in N·m",
                    markers=True,
                    title="the first steps, in windows of 10 ms",
                )
            )
            words += (
                " Below, the first of them in full: each settles, then its windows are averaged."
            )
        blocks.append(
            Diagram(
                panels,
                f"{side.capitalize()} module: {words} The rising points of each direction are the "
                "papers' series; the falling ones are measured beside them, because a series that "
                "only rises can't show hysteresis.",
                height=2.0,
            )
        )
    return blocks


def _error_curves(bench: BenchResult) -> Blocks:
    panels = [
        error_curves(module.tables.calibration, f"{side} module")
        for side, module in bench.modules.items()
    ]
    return [
        Diagram(
            panels,
            "Error curve of each module in both directions: reading minus standard at every step "
            "of the calibration, without compensation.",
        )
    ]


def _training(bench: BenchResult) -> tuple[Answer, Blocks]:
    panels, words, reached = [], [], []
    for side, module in bench.modules.items():
        curves = []
        for name in (BP_RESIDUAL, BP_DIRECT):
            fitted = module.models[name]
            assert isinstance(fitted.model, NetworkModel)
            curve = fitted.model.training_curve_
            curves.append(Curve(fitted.choice.title, curve[:, 0], curve[:, 1]))
            reached.append(curve[-1, 1] / module.tables.calibration.range_nm)
            words.append(f"{side}, {fitted.choice.title}: {number(curve[-1, 1])} N·m")
        panels.append(
            Panel(
                curves,
                "epoch",
                "RMS of residuals in N·m",
                logarithmic="xy",
                title=f"{side} module",
            )
        )
    parameters = Facts(
        (
            ("Layers", "1-50-1, tansig, purelin"),
            ("Training", "batch gradient descent, learning rate 0.01, 50 000 epochs"),
            ("Start", "weights even within ±0.5; the papers publish none"),
            ("Target error", "none here; item 15 has trainings that end at one"),
        )
    )
    figure = Diagram(
        panels,
        "Training of the network in both mappings on the rising points: gradient descent leaves a "
        "larger error with the standard torque, because its output then covers the whole range.",
        columns=2,
    )
    return Answer(
        "RMS of residuals after 50 000 epochs: " + "; ".join(words),
        "partly",
        "the mapping of [J] trains well, that of [M] doesn't by gradient descent; see item 15",
    ), [parameters, figure, *_nodes(bench)]


def _nodes(bench: BenchResult) -> Blocks:
    """Return a table of the network's errors by number of hidden nodes, for both modules."""
    rows = []
    for side, module in bench.modules.items():
        for found in module.nodes:
            fresh = "–" if found.fresh_nm is None else number(found.fresh_nm)
            rows.append([side, str(found.hidden), number(found.rms_nm), fresh])
    return [
        Table(
            ("module", "hidden nodes", "RMS of residuals, N·m", "worst of fresh readings, N·m"),
            rows,
            f"Trials of the number of nodes: additional torque, small start, {NODE_EPOCHS} epochs.",
        )
    ]


_SHOWN: tuple[tuple[str, Side], ...] = (
    (BP_RESIDUAL, "input"),
    (BP_RESIDUAL, "output"),
    (POLYNOMIAL, "output"),
)


def _before_after(bench: BenchResult) -> tuple[Blocks, Answer]:
    blocks: Blocks = []
    words, met, beyond = [], [], []
    for name, side in _SHOWN:
        module = bench.modules.get(side)
        data = None if module is None else module.tables.verification
        if module is None or data is None:
            continue
        title = CHOICES[name].title
        worst = float(np.max(np.abs(module.errors_nm(data, name))))
        percent = 100.0 * worst / data.range_nm
        if name == BP_RESIDUAL:
            met.append(percent <= LIMIT_PERCENT)
            if not met[-1]:
                beyond.append(side)
        words.append(f"{title}, {side}: {number(worst)} N·m ({number(percent)} % FS)")
        torque = module.models[name].torque_nm(data.reading_nm, data.branch.astype(np.float64))
        blocks.append(before_after_diagram(data, Verified(title, torque), LIMIT_PERCENT))
    if not words:
        return [], Answer("no verification", "not measured")
    return blocks, Answer(
        "; ".join(words),
        "met" if met and all(met) else "not met",
        "0.1 % FS for BP"
        if all(met)
        else f"the network's worst reading exceeds 0.1 % FS on the {' and '.join(beyond)} module",
    )


# -- item 14 ----------------------------------------------------------------------------------


def _verified(module: FittedModule, data: CalibrationData) -> list[Verified]:
    branch = data.branch.astype(np.float64)
    return [
        Verified("raw reading", data.reading_nm),
        *(
            Verified(each.choice.title, each.torque_nm(data.reading_nm, branch))
            for each in module.models.values()
        ),
    ]


def _groups(benches: Sequence[BenchResult]) -> tuple[Answer, Blocks]:
    blocks: Blocks = []
    for side, module in benches[0].modules.items():
        for found, data, what in (
            (module.same, module.tables.same_points, "groups at the same torques"),
            (module.others, module.tables.other_points, "groups at other torques"),
        ):
            if found is not None and data is not None:
                words = f"{side.capitalize()} module, {found.groups} {what}"
                tables = verification_tables(data, _verified(module, data), words, LIMIT_PERCENT)
                blocks += tables if found is module.same else tables[-1:]
    rows, kept, counted = [], 0, 0
    for bench in benches:
        for side, module in bench.modules.items():
            found, data = module.verified, module.tables.verification
            if found is None or data is None:
                continue
            cells = [bench.tables.name, side]
            for name in (BP_RESIDUAL, POLYNOMIAL, RECOMMENDED_NAME):
                error = module.errors_nm(data, name)
                worst = 100.0 * float(np.max(np.abs(error))) / data.range_nm
                repeated = repeatability(error, data)
                spread = None if repeated is None else repeated.worst_percent_fs
                cells.append(f"{number(worst)} / {number(spread)}")
                if name == BP_RESIDUAL:
                    counted += 1
                    kept += worst <= LIMIT_PERCENT and (spread or 0.0) <= LIMIT_PERCENT
            rows.append(cells)
    if not rows:
        return Answer("no verification", "not measured"), []
    if len(benches) > 1:
        titles = [CHOICES[n].title for n in (BP_RESIDUAL, POLYNOMIAL, RECOMMENDED_NAME)]
        blocks.append(
            Table(
                ("bench", "module", *titles),
                rows,
                "Worst error / repeatability in % FS on every bench, groups at the same torques.",
            )
        )
    return Answer(
        f"BP keeps 0.1 % error and 0.1 % repeatability on {kept} of {counted} modules",
        "met" if kept == counted else "not met" if kept == 0 else "partly",
        "worst single reading, and standard deviation over the groups at one place"
        if kept == counted
        else "the verification loads up and down, the papers' calibration only up",
    ), blocks


# -- item 15 ----------------------------------------------------------------------------------


def study_blocks(rows: Sequence[Row], seeds: int) -> tuple[Answer, Blocks]:
    """Return which variants reach the claimed ratio on which chains, and tables of all results.

    Parameters
    ----------
    rows : sequence of Row
    seeds : int
        Number of chains of each family.
    """
    if not rows:
        return Answer("not run", "not measured", "leave --no-study out"), []
    networks = [row for row in rows if row.title.startswith("BP")]
    groups = {(row.family, row.series): f"{row.family}, {row.series}" for row in rows}
    holds = {
        words: [
            row.title.removeprefix("BP, ")
            for row in networks
            if (row.family, row.series) == key and row.beats > row.chains / 2
        ]
        for key, words in groups.items()
    }
    where = "; ".join(f"{words}: {' / '.join(found) or 'none'}" for words, found in holds.items())
    fails = sum(1 for row in networks if row.ratio < 1.0)
    few = f"; {seeds} chains are few, with --whole there are {CHAINS}" if seeds < CHAINS else ""
    families = f"{seeds} chains of each family, for which the best quadratic has an error of"
    return Answer(
        f"variants of BP with a ratio of {CLAIMED_RATIO:.1f} on most chains: {where}. "
        f"{fails} of {len(networks)} variants are worse than the polynomial",
        "partly" if any(holds.values()) else "not met",
        "points, start, mapping and epochs decide; the papers publish neither start nor epochs"
        + few,
    ), [
        _study_table(
            rows,
            groups,
            lambda row: f"{number(row.ratio)} ({row.beats})",
            "Worst error of the polynomial divided by that of the model, median over the chains; "
            f"in brackets the number of {seeds} chains with a ratio of {CLAIMED_RATIO:.1f} or "
            f"more. {families} {POLYNOMIAL_NM:g} N·m of 2000, repeatability 0.2 N·m.",
        ),
        _study_table(
            rows,
            groups,
            lambda row: f"{number(row.worst_nm)} ({row.below})",
            "Worst of 500 fresh single readings in N·m, median over the chains; in brackets the "
            f"number of {seeds} chains below {NETWORK_NM:g} N·m.",
        ),
    ]


def _study_table(
    rows: Sequence[Row],
    groups: Mapping[tuple[str, str], str],
    cell: Callable[[Row], str],
    caption: str,
) -> Table:
    """Return a table with one row per model and one column per family and series."""
    found = {(row.title, row.family, row.series): cell(row) for row in rows}
    titles = dict.fromkeys(row.title for row in rows)
    return Table(
        ("model", *groups.values()),
        [[title, *(found.get((title, *key), "–") for key in groups)] for title in titles],
        caption,
    )


# -- item 16 ----------------------------------------------------------------------------------


def _alone(benches: Sequence[BenchResult]) -> tuple[Answer, Blocks]:
    blocks: Blocks = []
    rows, worst = [], []
    for bench in benches:
        for side, module in bench.modules.items():
            found = alone_row(module)
            if found is None:
                continue
            data = module.tables.verification
            assert data is not None
            worst.append(found[1])
            rows.append(alone_cells(bench.tables.name, side, found))
            if bench is benches[0]:
                blocks.append(alone_diagram(side, module))
    if not rows:
        return Answer("no transducer calibrated alone", "not measured", "give alone-SIDE.csv"), []
    blocks.append(alone_table(rows))
    return Answer(
        f"calibrated alone: {number(min(worst))} to {number(max(worst))} % FS in the chain",
        "shown",
        "a calibration of the transducer alone doesn't contain the chain's additional torque",
    ), blocks


# -- item 17 ----------------------------------------------------------------------------------


def friction_blocks(
    friction: FrictionTable, module: FittedModule, name: str = RECOMMENDED_NAME
) -> tuple[Answer, Blocks]:
    """Compare certified and measured friction: error and repeatability, with their verdicts.

    Parameters
    ----------
    friction : FrictionTable
    module : FittedModule
        The input module with its models.
    name : str
        Key of the model that compensates the readings.
    """
    range_nm = module.tables.calibration.range_nm
    checks = {each: _friction_check(friction, module, each) for each in ("", BP_RESIDUAL, name)}
    title = module.models[name].choice.title
    titles = ("raw reading", module.models[BP_RESIDUAL].choice.title, title)
    relative = {each: _percent_of_friction(check) for each, check in checks.items()}
    verdicts = [
        [
            words,
            number(check.error_percent),
            kept_words(check.error_percent, LIMIT_PERCENT),
            number(check.repeatability_percent),
            kept_words(check.repeatability_percent, LIMIT_PERCENT),
            number(relative[each]),
        ]
        for words, (each, check) in zip(titles, checks.items(), strict=True)
    ]
    compensated = checks[name]
    better = relative[name] < relative[""]
    answer = Answer(
        f"error {number(relative[name])} % of the friction ({number(relative[''])} % without "
        f"compensation), {number(compensated.error_percent)} % FS; repeatability "
        f"{number(compensated.repeatability_percent)} % FS of {range_nm:g} N·m",
        "not met" if not compensated.kept else "met" if better else "partly",
        f"compensated by {title}; the raw reading keeps {LIMIT_PERCENT:g} % FS as well, because "
        "the friction is a small part of the range: the share of the friction tells them apart"
        if checks[""].kept
        else f"compensated by {title}; against {LIMIT_PERCENT:g} % FS",
    )
    return answer, [
        replace(
            friction_diagram(compensated),
            caption=f"Known friction of the standard reducer and each repeat, by {title}; below, "
            f"the difference. Dashed: ±{LIMIT_PERCENT:g} % FS.",
        ),
        friction_check_table(compensated),
        Table(
            (
                "",
                "error, % FS",
                "≤ 0.1 %",
                "repeatability, % FS",
                "≤ 0.1 %",
                "error, % of the friction",
            ),
            verdicts,
            "Largest over all speeds. 0 rpm has no row: at rest the torque lies anywhere between "
            "both break-away torques, which torquebench test starting measures.",
        ),
    ]


def _percent_of_friction(check: FrictionCheck) -> float:
    """Return the largest relative error in % of the certified friction at the same speed."""
    return max(100.0 * abs(point.error_nm / point.known_nm) for point in check.points)


def _friction_check(friction: FrictionTable, module: FittedModule, name: str) -> FrictionCheck:
    """Check the friction by a model's torques, or by the raw readings if the name is empty."""
    branch = friction.branch.astype(np.float64)
    torque = friction.reading_nm
    if name:
        torque = module.models[name].torque_nm(friction.reading_nm, branch)
    range_nm = module.tables.calibration.range_nm
    return check_friction(
        friction.speed_rpm, torque, friction.repeat, _certified(friction), range_nm, LIMIT_PERCENT
    )


def _certified(friction: FrictionTable) -> tuple[CertifiedFriction, ...]:
    """Return the certified friction from the table's columns, by increasing speed."""
    speeds, first = np.unique(np.abs(friction.speed_rpm), return_index=True)
    return tuple(
        CertifiedFriction(
            speed_rpm=float(speed),
            torque_nm=float(friction.known_nm[row]),
            expanded_uncertainty_nm=float(friction.known_u_nm[row]),
        )
        for speed, row in zip(speeds, first, strict=True)
    )


def _standard_reducer(benches: Sequence[BenchResult]) -> tuple[Answer, Blocks]:
    found = [
        (bench, friction_blocks(bench.tables.friction, bench.modules["input"]))
        for bench in benches
        if bench.tables.friction is not None and "input" in bench.modules
    ]
    if not found:
        return Answer("no standard reducer", "not measured", "give its certified friction"), []
    answer, blocks = found[0][1]
    if len(found) > 1:
        rows = [[bench.tables.name, each.ours, each.verdict] for bench, (each, _) in found]
        blocks = [*blocks, Table(("bench", "error and repeatability", "0.1 %"), rows, words=True)]
        met = sum(each.verdict == "met" for _, (each, _) in found)
        verdict: Fulfilment = "met" if met == len(found) else "partly" if met else "not met"
        ours = f"{answer.ours}; within 0.1 % on {met} of {len(found)} benches"
        return Answer(ours, verdict, answer.why), blocks
    return answer, blocks


# -- items 18 to 21 ---------------------------------------------------------------------------


def _interface_items(benches: Sequence[BenchResult]) -> Items:
    first = benches[0]
    interface = Table(
        ("their interface", "panel: page", "API"),
        [list(row) for row in INTERFACE],
        words=True,
    )
    return {
        18: (
            Answer(
                "panel and API: loading, acquisition, training, compensation, display, "
                "parameters, status, faults, operation",
                "met",
                "the network's parameters, target error and training curve are in the wizard",
            ),
            [interface],
        ),
        19: _dynamic(first),
        20: _factors(first),
        21: _purpose(first),
    }


INTERFACE = (
    ("loading", "Calibrate: steps, rising only, largest torque", "operations/calibrate"),
    ("acquisition", "Live", "readings, stream"),
    (
        "training",
        "Calibrate, models: parameters, target error, curve",
        "operations/records-fit-model",
    ),
    ("compensation", "Calibrate, sign off: the model in use", "operations/records-use"),
    ("display", "Live: torque with U, speed, angle, efficiency", "readings, stream"),
    ("parameters", "Settings: bench, profiles, reducers", "settings"),
    ("status", "every page: connection, who commands, job", "bench, jobs"),
    ("faults", "Alarms", "alarms"),
    ("operation", "start, pause, abort, stop; roles", "jobs, stop"),
)


def _dynamic(bench: BenchResult) -> tuple[Answer, Blocks]:
    """Return the errors at standstill, during rotation, and under changing torque."""
    rows, worst = [], []
    for side, fitted in bench.modules.items():
        data = fitted.tables.verification
        if data is None:
            continue
        error = 100.0 * np.abs(fitted.errors_nm(data, RECOMMENDED_NAME)) / data.range_nm
        rows.append([f"{side}, at rest", f"{len(data)} readings", number(float(np.max(error)))])
        worst.append(float(np.max(error)))
    friction, module = bench.tables.friction, bench.modules.get("input")
    if friction is not None and module is not None:
        points = _friction_check(friction, module, RECOMMENDED_NAME).points
        errors = [point.error_percent for point in points]
        speeds = f"turning at {points[0].speed_rpm:g} to {points[-1].speed_rpm:g} rpm"
        rows.append([f"input, {speeds}, unloaded", f"{len(points)} speeds", number(max(errors))])
    turning = [each for each in bench.tables.factors if each.condition == "turning, grease"]
    for each in turning:
        measured = f"{each.points} points, random torques and speeds"
        rows.append([f"{each.side}, turning", measured, number(each.identified)])
        worst.append(each.identified)
    if not rows:
        return Answer("no verification", "not measured"), []
    before, after, changing = changing_torque()
    table = Table(
        ("module", "measured", "worst error, % FS"),
        rows,
        "Compensated by the recommended model; turning by what item 20 identifies as well.",
        words=True,
    )
    return Answer(
        f"worst error at rest and turning {number(max(worst))} % FS; amplitude of changing torque "
        f"up to the resonance {number(before)} % wrong before and {number(after)} % after "
        "compensation",
        "met" if max(worst) <= LIMIT_PERCENT and turning else "partly",
        "against 0.1 % FS for steady torque"
        if turning
        else "turning under load isn't measured here: torquebench turn --profile "
        "turning-verification",
    ), [table, *changing]


def _factors(bench: BenchResult) -> tuple[Answer, Blocks]:
    lubrication = bench.tables.facts.get(f"{MOUNTING}Lubrication", "")
    errors = bench.tables.factors
    recorded = Table(
        ("factor", "recorded", "identified and counted in U"),
        [
            ["speed", "with every reading", "zero and drag over speed: turn empty, fit --empty"],
            [
                "lubrication",
                f"record of the mounting: {lubrication or 'not entered'}",
                "drag and running-in: turn empty",
            ],
            ["temperature", "probes with every point", "zero and span: fit --empty"],
        ],
        words=True,
    )
    if not errors:
        return Answer(
            "speed, lubrication and temperature are recorded; what isn't measured widens U",
            "partly",
            "errors over them are measured by the whole page of simulated benches",
        ), [recorded]
    raw, rest, found = (
        max(getattr(each, name) for each in errors) for name in ("raw", "at_rest", "identified")
    )
    return Answer(
        f"worst error from 17 to 32 °C, at rest and turning, with two lubricants: {number(raw)} % "
        f"FS raw, {number(rest)} % FS calibrated at rest, {number(found)} % FS with what was "
        "identified",
        "met" if found <= LIMIT_PERCENT else "not met",
        "against 0.1 % FS",
    ), [factor_table(errors), recorded]


def _purpose(bench: BenchResult) -> tuple[Answer, Blocks]:
    found = bench.tables.reducer
    if not found:
        return Answer(
            "torsional rigidity, transmission error, backlash, lost motion, efficiency, friction",
            "shown",
            "measured by torquebench test full, with U and verdicts",
        ), [Table(("quantity", "command"), [list(row) for row in PURPOSE], words=True)]
    rows = [
        [each.test, each.quantity, *stated(each.value, each.expanded_uncertainty), each.unit]
        for each in found
        if "order " not in each.quantity
    ]
    failed = [
        (name, value) for name, value in bench.tables.facts.items() if name.startswith(FAILED)
    ]
    return Answer(
        f"{len(rows)} quantities of the mounted reducer, each with U",
        "shown",
        "torques compensated by the recommended model; a first look without warming up, "
        "torquebench test full takes all points",
    ), [
        Table(
            ("test", "quantity", "value", "U (k = 2)", "unit"),
            rows,
            "First look at the mounted reducer.",
            words=True,
        ),
        *([Facts(failed)] if failed else []),
    ]


PURPOSE = (
    ("torsional rigidity, backlash, lost motion", "torquebench test hysteresis"),
    ("transmission error", "torquebench test transmission-error"),
    ("efficiency", "torquebench test efficiency"),
)
