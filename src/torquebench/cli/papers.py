"""`torquebench papers`: the two source papers, item by item, on one page."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from dataclasses import field as data_field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.mounting import MountingOption, mounting_record
from torquebench.cli.options import (
    DEFAULT_DATA,
    RealTimeOption,
    RecordsOption,
    YesOption,
    bench_description,
    check_output_folder,
)
from torquebench.cli.reports import Told, check_reports, write_reports
from torquebench.cli.terminal.console import answer, narrow_table, note, out, say
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.result import HIDDEN
from torquebench.reports.page import Page

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.bench.mounting_record import MountingRecord
    from torquebench.papers.factors import Measurement
    from torquebench.papers.study import Study
    from torquebench.papers.tables import BenchTables, PapersSettings
    from torquebench.reducers import CertifiedFriction

__all__ = ["papers"]

SEEDS = 3


@dataclass(frozen=True)
class ReproducedItem:
    """One item of the source papers."""

    item: str
    verdict: str


@dataclass(frozen=True, kw_only=True)
class Reproduced(Told):
    """The items of the source papers."""

    items: Sequence[ReproducedItem]
    described: Any = data_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return the page."""
        page: Page = self.described
        return page


def papers(
    report: Annotated[
        list[Path] | None,
        typer.Option(
            "--out", help="The page to write, .html or .pdf; without it both. May be repeated."
        ),
    ] = None,
    bench: Annotated[
        Path | None,
        typer.Option("--bench", help="Measure on this bench; without it on simulated ones."),
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option("--data", help="Read recorded tables from this folder (CSV or TDMS)."),
    ] = None,
    save: Annotated[
        Path | None, typer.Option(help="Write the measured tables into this folder.")
    ] = None,
    reducer: Annotated[
        str | None,
        typer.Option(help="Description of the standard reducer, with its certified friction."),
    ] = None,
    seeds: Annotated[
        int, typer.Option(min=1, max=50, help="How many simulated benches are measured.")
    ] = SEEDS,
    study: Annotated[
        bool, typer.Option("--study/--no-study", help="When does BP beat the polynomial?")
    ] = True,
    quick: Annotated[
        bool, typer.Option("--quick", help="Few points, one bench; takes about a minute.")
    ] = False,
    records: RecordsOption = None,
    mounting: MountingOption = None,
    yes: YesOption = False,
    real_time: RealTimeOption = False,
) -> Reproduced:
    """Reproduce the two source papers item by item: one page with figures, tables and verdicts.

    Both modules are calibrated and verified in ten groups at the same torques (and ten at others),
    the standard reducer's friction is measured, and the results are compared with the papers'
    claims. On a real bench no model is put into use. --save writes the tables, from which --data
    makes the same page again. After an interruption, the same command continues with the study's
    stored results.
    """
    reports = report or [Path("torquebench-papers.html"), Path("torquebench-papers.pdf")]
    check_reports(reports)
    if save is not None:
        check_output_folder(save)
    if bench is not None and data is not None:
        raise InputError(
            "--bench and --data", "one of both", "either measure or read recorded tables"
        )
    if data is not None and (save is not None or reducer is not None or mounting):
        raise InputError(
            "--data together with options of a measurement",
            "--data alone",
            "leave --save, --reducer, --mounting out",
        )
    from torquebench.papers.run import page_study, seeded, workers

    entered = mounting_record(mounting)
    certified = _certified(reducer)
    file = reports[0].with_suffix(".study")
    with contextlib.ExitStack() as closing:
        closing.callback(_note_study, file)
        pool = closing.enter_context(workers())
        conditions: list[Future[dict[str, Measurement]]] = []
        if data is not None:
            from torquebench.papers.tables import read_tables

            tables, computed = (
                [read_tables(data)],
                page_study(pool, file, quick=quick) if study else None,
            )
        else:
            description = bench_description(bench)
            if bench is None and not quick:
                conditions = _conditions(seeded(description, 1), pool)
            computed = page_study(pool, file, quick=quick) if study else None
            measure = partial(
                _on_bench, certified=certified, mounted=entered, real_time=real_time, yes=yes
            )
            tables = _measured(
                description, bench, 1 if quick else seeds, quick, records, yes, measure
            )
        page = _page(tables, conditions, computed, quick, save)
        items = _write(page, reports)
        file.unlink(missing_ok=True)
    return Reproduced(headline=page.title, simulated=page.simulated, items=items, described=page)


def _certified(reducer: str | None) -> tuple[CertifiedFriction, ...]:
    if reducer is None:
        return ()
    from torquebench.reducers import load_reducer

    found = load_reducer(reducer)
    if not found.certified_friction:
        raise InputError(
            Message("{name}: no certified_friction", reducer),
            "a standard reducer's description with [[certified_friction]]",
            "enter speed_rpm, torque_nm and expanded_uncertainty_nm of its certificate",
        )
    return found.certified_friction


def _measured(
    description: BenchDescription,
    bench: Path | None,
    seeds: int,
    quick: bool,
    records: Path | None,
    yes: bool,
    measure: Callable[[BenchDescription, PapersSettings, Path], BenchTables],
) -> list[BenchTables]:
    import dataclasses
    import tempfile

    from torquebench.cli.simulate import simulators_running
    from torquebench.papers.run import seeded
    from torquebench.papers.tables import PapersSettings

    settings = PapersSettings.quick() if quick else PapersSettings()
    if bench is not None:
        _confirm(description, yes)
        with simulators_running(description, bench) as started:
            if started:
                note("simulators started for this page; they end with it")
            return [measure(description, settings, records or DEFAULT_DATA)]
    tables = []
    for number in range(1, seeds + 1):
        chosen = dataclasses.replace(settings, seed=number)
        if number > 1:
            chosen = dataclasses.replace(chosen, others=False, reducer_test="")
        with tempfile.TemporaryDirectory(prefix="torquebench-papers-") as scratch:
            folder = Path(scratch) if records is None else records / f"seed-{number}"
            note(f"simulated bench {number} of {seeds}")
            tables.append(measure(seeded(description, number), chosen, folder))
    return tables


def _confirm(description: BenchDescription, yes: bool) -> None:
    from torquebench.calibration import load_profile
    from torquebench.cli.terminal.confirming import confirm_start

    confirm_start(description, "both modules", load_profile("rapid-in-situ"), yes)


def _on_bench(
    description: BenchDescription,
    settings: PapersSettings,
    records: Path,
    *,
    certified: tuple[CertifiedFriction, ...],
    mounted: MountingRecord | None,
    real_time: bool,
    yes: bool,
) -> BenchTables:
    from torquebench.cli.bench_session import open_bench
    from torquebench.papers.tables import measure_tables

    with (
        open_bench(description, records, real_time=real_time, yes=yes, announce=False) as session,
        session.measuring(may_pause=False) as (progress, _),
    ):
        return measure_tables(session.station, settings, certified, progress, mounted)


def _conditions(
    description: BenchDescription, pool: Executor
) -> list[Future[dict[str, Measurement]]]:
    from torquebench.papers.factors import CONDITIONS, measured_at

    return [pool.submit(measured_at, description, condition) for condition in CONDITIONS]


def _note_study(file: Path) -> None:
    """Print the file of an interrupted study."""
    if file.is_file() and (done := max(len(file.read_text("utf-8").splitlines()) - 1, 0)):
        note(f"the study's {done} chains are in {file}; the same command goes on from there")


def _page(
    tables: list[BenchTables],
    conditions: list[Future[dict[str, Measurement]]],
    computed: tuple[Study, int] | None,
    quick: bool,
    save: Path | None,
) -> Page:
    from torquebench.cli.terminal.progress import TerminalProgress
    from torquebench.papers.page import papers_page
    from torquebench.papers.run import results_of, with_factors
    from torquebench.papers.tables import write_tables

    with TerminalProgress() as progress:
        results = results_of(tables, progress)
        if conditions:
            progress.start("Comparing temperatures, speeds and lubricants", None)
            with_factors(results, [each.result() for each in conditions])
        if save is not None:
            written = write_tables(save, results[0].tables)
            say(f"Tables: {len(written)} in {save}")
            answer(files=[str(path) for path in written])
        rows, chains = [], 0
        if computed is not None:
            study, chains = computed
            progress.start("Studying when BP beats the polynomial", study.total)
            rows = study.rows(progress)
        progress.start("Computing supports and writing the page", None)
        return papers_page(results, rows, chains, quick=quick)


def _write(page: Page, reports: list[Path]) -> list[ReproducedItem]:
    """Print the items with their verdicts, and write the page."""
    table = narrow_table(
        page.title + (" - simulated" if page.simulated else ""), columns=("item", "met or not")
    )
    items = []
    for section in page.sections[1:]:
        item, _, verdict = section.heading.rpartition(": ")
        table.add_row(item, verdict)
        items.append(ReproducedItem(item, verdict))
    out().print(table)
    write_reports(page, reports, "Page")
    return items
