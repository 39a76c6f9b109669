"""The page with every item of the papers: figure or table, and verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from torquebench.bench.roles import SIDE_TITLES, Side
from torquebench.calibration import CalibrationData, repeatability
from torquebench.compensation import NetworkModel
from torquebench.figures import Curve
from torquebench.message import Message
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
    sections = [_summary(items, benches)]
    for number_, (answer, blocks) in sorted(items.items()):
        item = ITEMS[number_]
        text = Message(
            "Papers: {theirs}. Here: {ours}.{why} Command: {command}.",
            item.theirs,
            answer.ours,
            Message(" {reason}.", answer.why) if answer.why else "",
            item.command,
        )
        heading = Message("{number}. {title}: {verdict}", number_, item.title, answer.verdict)
        sections.append(Section(heading, text, blocks))
    sections.append(_beyond())
    return Page(
        "The two source papers, item by item",
        Message(
            "Yu and Zhang, Journal of Sensors, 2021 [J]; Yu, Zhang, Yu and Liu, Measurement and "
            "Control, 2022 [M], doi 10.1177/00202940221103308. Bench: {benches}",
            "; ".join(bench.tables.name for bench in benches),
        ),
        sections,
        simulated=simulated,
    )


def _summary(items: Items, benches: Sequence[BenchResult]) -> Section:
    rows = [
        [
            Message("{number}. {title}", number_, ITEMS[number_].title),
            ITEMS[number_].theirs,
            answer.ours,
            answer.verdict,
            answer.why,
        ]
        for number_, (answer, _) in sorted(items.items())
    ]
    verdicts = [answer.verdict for answer, _ in items.values()]
    counted = Message.joined(
        Message("{count} {verdict}", verdicts.count(each), each) for each in dict.fromkeys(verdicts)
    )
    source = "simulated" if benches[0].tables.simulated else "measured"
    return Section(
        "Summary",
        Message(
            "{count} items: {verdicts}. Figures of benches are {source}; those of items 4 to 7, "
            "15 and 22, the stream in 3 and the changing torque in 19 are computed. The tables and "
            "pictures of the papers aren't available as text: what is compared is what their text "
            "states.",
            len(items),
            counted,
            source,
        ),
        (Table(("item", "the papers", "here", "met or not", "why"), rows, words=True),),
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
                Message("{count} of {all} described", len(described), len(SUB_SYSTEMS)),
                "met" if not missing else "partly",
                "Rail and supply are devices with interlocks"
                if not missing
                else Message(
                    "Missing from the description or the tables: {missing}", Message.joined(missing)
                ),
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
            "No data of the mounting were entered (--mounting)",
        )
    else:
        kept = "≤" in coaxiality
        answer = Answer(
            Message("coaxiality {coaxiality}", coaxiality),
            "met" if kept else "not met",
            "The record of the mounting, which the certificate states"
            if kept
            else "The axes are further apart than the limit",
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
            share = Message("{share} % of range", number(accuracy))
            rows.append([Message("loading, {side}", side), LOADING, share])
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
            (
                "Stream of a card",
                Message(
                    "simulated, {rate:,.0f} edges/s on 4 channels, blocks of 10 ms, at its rate "
                    "for {seconds:g} s",
                    stream.edges_per_s,
                    stream.seconds,
                ),
            ),
            ("Blocks lost", Message("{lost} of {blocks}", stream.lost, stream.blocks)),
            ("Windows refused", str(stream.faults)),
        )
    )
    loading = "no targets recorded"
    if worst:
        loading = Message("loading within {share} % of range", number(max(worst)))
    kept = bool(worst) and max(worst) <= LIMIT_PERCENT and not stream.lost and not stream.faults
    return Answer(
        Message(
            "{loading}; {lost} of {blocks} blocks of a simulated card lost",
            loading,
            stream.lost,
            stream.blocks,
        ),
        "partly" if not worst else "met" if kept else "not met",
        "Their FlexRIO card (PXIe-7961) would stream edges or frequency to a driver plugin, "
        "or into files, in the same way; torquebench wasn't tried on one",
    ), [table, card, *figures]


# -- items 4 to 7 -----------------------------------------------------------------------------


def _mechanics_items(mesh_m: float) -> Items:
    parts = [additional_torque_blocks(design) for design in DESIGNS.values()]
    ours = Message.joined((each.ours for each, _ in parts), "; ")
    answer = Answer(ours, parts[0][0].verdict, parts[0][0].why)
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
    steps = Message.joined(
        Message("{count} rising points of the {side} module", count, side)
        for side, count in points.items()
    )
    return {
        8: _calibrator(bench),
        9: (Answer(steps, "shown", "0.5 s a step, mean of the settled part"), staircase),
        10: trained,
        11: (
            Answer(_polynomial_words(bench), "shown", "Fitted to the same rising points"),
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
        words.append(
            Message(
                "{side}: {points} points in each direction, U up to {u} N·m",
                side,
                points,
                number(stated_nm),
            )
        )
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
                title=Message("calibrator, {side} side", side),
            )
        )
    if not panels:
        return Answer("no certificate of the calibrator", "not measured", "Give its CSV file"), []
    figure = Diagram(
        panels,
        "Errors of the calibrator at its certified points, corrected in every calibration.",
        columns=2,
    )
    ours = Message.joined(words, "; ")
    return Answer(ours, "met", "Two outputs, errors corrected between points"), [figure]


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
                title=Message("{side} module", side),
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
        words.append(Message("{side}: up to {worst} % FS before compensation", side, number(worst)))
    return Message.joined(words, "; ")


def _polynomial_words(bench: BenchResult) -> str:
    worst = {
        side: float(np.max(np.abs(each.errors_nm(each.tables.rising, POLYNOMIAL))))
        for side, each in bench.modules.items()
    }
    return Message.joined(
        (
            Message("{side}: {worst} N·m on its own points", side, number(worst_nm))
            for side, worst_nm in worst.items()
        ),
        "; ",
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
        below = ""
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
            below = Message(
                " Below, the first of them in full: each settles, then its windows are averaged."
            )
        blocks.append(
            Diagram(
                panels,
                Message(
                    "{module}: the steps as the calibrator read them.{below} The rising points of "
                    "each direction are the papers' series; the falling ones are measured beside "
                    "them, because a series that only rises can't show hysteresis.",
                    SIDE_TITLES[side],
                    below,
                ),
                height=2.0,
            )
        )
    return blocks


def _error_curves(bench: BenchResult) -> Blocks:
    panels = [
        error_curves(module.tables.calibration, Message("{side} module", side))
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
            rms = number(curve[-1, 1])
            words.append(Message("{side}, {model}: {rms} N·m", side, fitted.choice.title, rms))
        panels.append(
            Panel(
                curves,
                "epoch",
                "RMS of residuals in N·m",
                logarithmic="xy",
                title=Message("{side} module", side),
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
        Message("RMS of residuals after 50 000 epochs: {modules}", Message.joined(words, "; ")),
        "partly",
        "The mapping of [J] trains well, that of [M] doesn't by gradient descent; see item 15",
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
            Message(
                "Trials of the number of nodes: additional torque, small start, {epochs} epochs.",
                NODE_EPOCHS,
            ),
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
        words.append(
            Message(
                "{model}, {side}: {worst} N·m ({share} % FS)",
                title,
                side,
                number(worst),
                number(percent),
            )
        )
        torque = module.models[name].torque_nm(data.reading_nm, data.branch.astype(np.float64))
        blocks.append(before_after_diagram(data, Verified(title, torque), LIMIT_PERCENT))
    if not words:
        return [], Answer("no verification", "not measured")
    return blocks, Answer(
        Message.joined(words, "; "),
        "met" if met and all(met) else "not met",
        "0.1 % FS for BP"
        if all(met)
        else Message(
            "The network's worst reading exceeds 0.1 % FS on the {sides} module",
            Message.joined(beyond, " and "),
        ),
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
                words = Message("{module}, {count} {groups}", SIDE_TITLES[side], found.groups, what)
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
        Message(
            "BP keeps 0.1 % error and 0.1 % repeatability on {kept} of {all} modules", kept, counted
        ),
        "met" if kept == counted else "not met" if kept == 0 else "partly",
        "Worst single reading, and standard deviation over the groups at one place"
        if kept == counted
        else "The verification loads up and down, the papers' calibration only up",
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
        return Answer("not run", "not measured", "Leave --no-study out"), []
    networks = [row for row in rows if row.title.startswith("BP")]
    groups = {(row.family, row.series): Message.joined((row.family, row.series)) for row in rows}
    holds = {
        words: [
            row.title
            for row in networks
            if (row.family, row.series) == key and row.beats > row.chains / 2
        ]
        for key, words in groups.items()
    }
    where = Message.joined(
        (
            Message("{chains}: {models}", words, Message.joined(found or ["none"], " / "))
            for words, found in holds.items()
        ),
        "; ",
    )
    fails = sum(1 for row in networks if row.ratio < 1.0)
    why = "Points, start, mapping and epochs decide; the papers publish neither start nor epochs"
    if seeds < CHAINS:
        why = Message(
            "{reason}; {seeds} chains are few, with --whole there are {all}", why, seeds, CHAINS
        )
    return Answer(
        Message(
            "variants of BP with a ratio of {ratio:.1f} on most chains: {variants}. {fails} of "
            "{all} variants are worse than the polynomial",
            CLAIMED_RATIO,
            where,
            fails,
            len(networks),
        ),
        "partly" if any(holds.values()) else "not met",
        why,
    ), [
        _study_table(
            rows,
            groups,
            lambda row: f"{number(row.ratio)} ({row.beats})",
            Message(
                "Worst error of the polynomial divided by that of the model, median over the "
                "chains; in brackets the number of {seeds} chains with a ratio of {ratio:.1f} or "
                "more. {seeds} chains of each family, for which the best quadratic has an error of "
                "{error:g} N·m of 2000, repeatability 0.2 N·m.",
                seeds,
                CLAIMED_RATIO,
                POLYNOMIAL_NM,
            ),
        ),
        _study_table(
            rows,
            groups,
            lambda row: f"{number(row.worst_nm)} ({row.below})",
            Message(
                "Worst of 500 fresh single readings in N·m, median over the chains; in brackets "
                "the number of {seeds} chains below {limit:g} N·m.",
                seeds,
                NETWORK_NM,
            ),
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
        return Answer("no transducer calibrated alone", "not measured", "Give alone-SIDE.csv"), []
    blocks.append(alone_table(rows))
    return Answer(
        Message(
            "calibrated alone: {least} to {most} % FS in the chain",
            number(min(worst)),
            number(max(worst)),
        ),
        "shown",
        "A calibration of the transducer alone doesn't contain the chain's additional torque",
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
        Message(
            "error {share} % of the friction ({raw} % without compensation), {error} % FS; "
            "repeatability {repeatability} % FS of {range_nm:g} N·m",
            number(relative[name]),
            number(relative[""]),
            number(compensated.error_percent),
            number(compensated.repeatability_percent),
            range_nm,
        ),
        "not met" if not compensated.kept else "met" if better else "partly",
        Message(
            "Compensated by {model}; the raw reading keeps {limit:g} % FS as well, because the "
            "friction is a small part of the range: the share of the friction tells them apart"
            if checks[""].kept
            else "Compensated by {model}; against {limit:g} % FS",
            title,
            LIMIT_PERCENT,
        ),
    )
    return answer, [
        replace(
            friction_diagram(compensated),
            caption=Message(
                "Known friction of the standard reducer and each repeat, by {model}; below, the "
                "difference. Dashed: ±{limit:g} % FS.",
                title,
                LIMIT_PERCENT,
            ),
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
        return Answer("no standard reducer", "not measured", "Give its certified friction"), []
    answer, blocks = found[0][1]
    if len(found) > 1:
        rows = [[bench.tables.name, each.ours, each.verdict] for bench, (each, _) in found]
        blocks = [*blocks, Table(("bench", "error and repeatability", "0.1 %"), rows, words=True)]
        met = sum(each.verdict == "met" for _, (each, _) in found)
        verdict: Fulfilment = "met" if met == len(found) else "partly" if met else "not met"
        ours = Message(
            "{error}; within 0.1 % on {met} of {all} benches", answer.ours, met, len(found)
        )
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
                "The network's parameters, target error and training curve are in the wizard",
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
        readings = Message("{count} readings", len(data))
        rows.append([Message("{side}, at rest", side), readings, number(float(np.max(error)))])
        worst.append(float(np.max(error)))
    friction, module = bench.tables.friction, bench.modules.get("input")
    if friction is not None and module is not None:
        points = _friction_check(friction, module, RECOMMENDED_NAME).points
        errors = [point.error_percent for point in points]
        turned = Message(
            "input, turning at {low:g} to {high:g} rpm, unloaded",
            points[0].speed_rpm,
            points[-1].speed_rpm,
        )
        rows.append([turned, Message("{count} speeds", len(points)), number(max(errors))])
    turning = [each for each in bench.tables.factors if each.condition == "turning, grease"]
    for each in turning:
        measured = Message("{count} points, random torques and speeds", each.points)
        rows.append([Message("{side}, turning", each.side), measured, number(each.identified)])
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
        Message(
            "worst error at rest and turning {worst} % FS; amplitude of changing torque up to the "
            "resonance {before} % wrong before and {after} % after compensation",
            number(max(worst)),
            number(before),
            number(after),
        ),
        "met" if max(worst) <= LIMIT_PERCENT and turning else "partly",
        "Against 0.1 % FS for steady torque"
        if turning
        else "Turning under load isn't measured here: torquebench turn --profile "
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
                Message("record of the mounting: {lubrication}", lubrication or "not entered"),
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
            "Errors over them are measured by the whole page of simulated benches",
        ), [recorded]
    raw, rest, found = (
        max(getattr(each, name) for each in errors) for name in ("raw", "at_rest", "identified")
    )
    return Answer(
        Message(
            "worst error from 17 to 32 °C, at rest and turning, with two lubricants: {raw} % FS "
            "raw, {rest} % FS calibrated at rest, {identified} % FS with what was identified",
            number(raw),
            number(rest),
            number(found),
        ),
        "met" if found <= LIMIT_PERCENT else "not met",
        "Against 0.1 % FS",
    ), [factor_table(errors), recorded]


def _purpose(bench: BenchResult) -> tuple[Answer, Blocks]:
    found = bench.tables.reducer
    if not found:
        return Answer(
            "torsional rigidity, transmission error, backlash, lost motion, efficiency, friction",
            "shown",
            "Measured by torquebench test full, with U and verdicts",
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
        Message("{count} quantities of the mounted reducer, each with U", len(rows)),
        "shown",
        "Torques compensated by the recommended model; a first look without warming up, "
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
