"""The two source papers: measure their tables, write their page, compare alone with in place."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as data_field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from torquebench.bench.roles import SIDES, Side
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import (
    WHOLE,
    Flag,
    MountedRequest,
    Name,
    Operation,
    Request,
    field,
    on_files,
)
from torquebench.operations.place import Place
from torquebench.operations.preview import Preview, joined_previews, loading_preview
from torquebench.operations.result import HIDDEN, Result
from torquebench.progress import Progress
from torquebench.reports.page import Page, Section, Table

if TYPE_CHECKING:
    from torquebench.calibration import CalibrationData
    from torquebench.papers.tables import PapersSettings
    from torquebench.reducers import CertifiedFriction


Quick = Annotated[Flag, field("Fewer points, for a first impression.")]


def _settings(quick: bool) -> PapersSettings:
    from torquebench.papers.tables import PapersSettings

    return PapersSettings.quick() if quick else PapersSettings()


def _preview(place: Place, title: str, sides: Sequence[Side], settings: PapersSettings) -> Preview:
    """Rehearse calibration and verification of each side."""
    import numpy as np

    from torquebench import procedures

    station, previews = place.station, []
    profile, same = settings.calibration, settings.verification.with_options(same_points=True)
    for side in sides:
        steps = same.staircase(
            station.description.module(side).range_nm, np.random.default_rng(settings.seed)
        )
        for chosen, plan, chosen_steps in (
            (profile, procedures.calibrate(station.devices, side, profile), None),
            (same, procedures.verify(station.devices, side, same, steps), steps),
        ):
            rehearsal = procedures.rehearse(station.devices, plan)
            previews.append(
                loading_preview(title, station.description, side, chosen, rehearsal, chosen_steps)
            )
    return joined_previews(previews, title)


# -- alone and in place ---------------------------------------------------------------------


class InPlaceRequest(MountedRequest):
    """Compare the calibration of a transducer alone with that of its chain in place.

    The chain is calibrated in place and verified at fresh points. Both calibrations are applied to
    the same readings: the transducer's own calibration doesn't contain the chain's additional
    torque. No model is put into use.
    """

    side: Annotated[
        Literal["input", "output"], field("Which module.", title="Module", argument=True)
    ] = "output"
    alone: Annotated[
        Path | None,
        field(
            "A calibration of the transducer alone (a table: reading_nm, standard_nm); needed on "
            "a real bench.",
            title="Calibrated alone",
        ),
    ] = None
    quick: Quick = False


@dataclass(frozen=True, kw_only=True)
class InPlace(Result):
    """Worst error of fresh readings in the chain, for each calibration."""

    side: str
    range_nm: float
    worst_percent_fs: Mapping[str, float | None]
    described: Any = data_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return its description."""
        page: Page = self.described()
        return page


def in_place_title(request: InPlaceRequest) -> str:
    """Return a short title."""
    return Message("Calibrate the {side} module alone and in place", request.side)


def check_in_place(place: Place, request: InPlaceRequest) -> Iterable[str]:
    """Raise an error without a calibration of a real transducer alone."""
    description = place.station.description
    if request.alone is None and not description.simulated:
        raise InputError(
            Message("no calibration of the transducer alone for {name}", description.name),
            "a table with reading_nm and standard_nm",
            "give --alone FILE.csv",
        )
    if request.alone is not None:
        place.compute(
            read_alone, request.alone, request.side, description.module(request.side).range_nm
        )
    return ()


def read_alone(path: Path, side: Side, range_nm: float, _progress: Progress) -> CalibrationData:
    """Read a table, possibly in another process."""
    from torquebench.tables import read_calibration

    return read_calibration(path, range_nm=range_nm, side=side)


def preview_in_place(place: Place, request: InPlaceRequest) -> Preview:
    """Rehearse calibration and verification."""
    settings = _settings(request.quick)
    return _preview(place, in_place_title(request), (request.side,), settings)


def run_in_place(place: Place, request: InPlaceRequest, progress: Progress) -> InPlace:
    """Measure the module, and apply each calibration to the same readings."""
    from torquebench.papers.tables import measure_module

    side, description = request.side, place.station.description
    options = place.run_options(progress, request.mounting)
    measured = measure_module(place.station, side, _settings(request.quick), options)
    if request.alone is not None:
        range_nm = description.module(side).range_nm
        table = place.compute(read_alone, request.alone, side, range_nm, progress=progress)
        measured = replace(measured, alone=table)
    from torquebench.papers.in_place import alone_row, in_place_page
    from torquebench.papers.models import BP_RESIDUAL, RECOMMENDED_NAME, fit_module

    fitted = fit_module(measured, (BP_RESIDUAL, RECOMMENDED_NAME))
    found = alone_row(fitted)
    assert found is not None
    names = ("none: raw reading", "transducer alone", "in place", "in place, rising only (BP)")
    return InPlace(
        headline="Worst error of fresh readings in the chain, by calibration.",
        simulated=description.simulated,
        side=side,
        range_nm=measured.calibration.range_nm,
        worst_percent_fs=dict(zip(names, found, strict=True)),
        described=lambda: in_place_page(description.name, side, fitted),
    )


# -- tables of the papers -------------------------------------------------------------------


class PapersTablesRequest(MountedRequest):
    """Measure the tables of the two source papers, from which `papers` makes its page.

    Both modules are calibrated and verified in ten groups at the same torques (and ten at others),
    and the standard reducer's friction is measured. On a real bench no model is put into use.
    """

    reducer: Annotated[
        Name | None,
        field(
            "Description of the standard reducer, with its certified friction.",
            choices="reducers",
        ),
    ] = None
    quick: Quick = False
    out: Annotated[Path, field("Folder of the tables.", local=True, output=("folder",))] = Path(
        "torquebench-papers"
    )


@dataclass(frozen=True, kw_only=True)
class PapersTables(Result):
    """Measured tables of the papers."""

    tables: Sequence[str]


def _certified(place: Place, reducer: str | None) -> tuple[CertifiedFriction, ...]:
    if reducer is None:
        return ()
    found = place.library.reducer(reducer)
    if not found.certified_friction:
        raise InputError(
            Message("{name}: no certified_friction", reducer),
            "a standard reducer's description with [[certified_friction]]",
            "enter speed_rpm, torque_nm and expanded_uncertainty_nm of its certificate",
        )
    return found.certified_friction


def check_tables(place: Place, request: PapersTablesRequest) -> Iterable[str]:
    """Raise an error for a reducer without certified friction."""
    _certified(place, request.reducer)
    return ()


def preview_tables(place: Place, request: PapersTablesRequest) -> Preview:
    """Rehearse calibrations and verifications."""
    return _preview(place, "Measure the papers' tables", SIDES, _settings(request.quick))


def run_tables(place: Place, request: PapersTablesRequest, progress: Progress) -> PapersTables:
    """Measure both modules and the standard reducer, and write the tables."""
    from torquebench.papers.tables import measure_tables, write_tables

    options = place.run_options(progress, request.mounting)
    certified = _certified(place, request.reducer)
    measured = measure_tables(place.station, _settings(request.quick), certified, options)
    folder = request.out if request.out.is_absolute() else Path.cwd() / request.out
    written = write_tables(folder, measured)
    return PapersTables(
        headline=Message("{count} tables.", len(written)),
        simulated=measured.simulated,
        files=tuple(map(str, written)),
        tables=[path.name for path in written],
    )


# -- page of the papers ---------------------------------------------------------------------


class PapersRequest(Request):
    """Reproduce the two source papers item by item: one page with figures, tables and verdicts.

    A simulated bench is measured as `papers-tables` measures a real one, or recorded tables are
    read, and the results are compared with the papers' claims. By default few points are taken,
    which needs about a minute of computing; --whole takes all points, at all temperatures, speeds
    and lubricants, and the whole study, on a computer that has nothing else to do. After an
    interruption, the same command continues with the study's stored results.
    """

    tables: Annotated[
        tuple[Path, ...],
        field(
            "Recorded tables (CSV, TDMS, …) instead of simulated benches: a folder, or its files.",
            argument=True,
        ),
    ] = ()
    out: Annotated[
        tuple[Path, ...],
        field("The page to write, .html or .pdf. May be repeated.", output=(".html", ".pdf")),
    ] = (Path("torquebench-papers.html"), Path("torquebench-papers.pdf"))
    whole: Annotated[Flag, field("All points, several benches, and the whole study.")] = False
    seeds: Annotated[
        int, field("How many simulated benches the whole page measures.", ge=1, le=50), WHOLE
    ] = 3
    study: Annotated[Flag, field("Study when BP beats the polynomial.")] = True


@dataclass(frozen=True)
class ReproducedItem:
    """One item of the source papers."""

    item: str
    verdict: str


@dataclass(frozen=True, kw_only=True)
class Reproduced(Result):
    """The items of the source papers."""

    items: Sequence[ReproducedItem]
    described: Any = data_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return the items with their verdicts, and the sections of the page as details."""
        rows = [(each.item, each.verdict) for each in self.items]
        table = Table(("item", "met or not"), rows, words=True)
        page: Page = self.described
        details = [replace(section, detail=True) for section in page.sections]
        return replace(page, sections=[Section("", "", [table]), *details])


def check_papers(_place: Place, request: PapersRequest) -> Iterable[str]:
    """Raise an error for a missing folder, or a page of another kind."""
    from torquebench.papers.tables import read_tables
    from torquebench.reports.page_pdf import check_suffix

    for path in request.out:
        check_suffix(path)
    if request.tables:
        read_tables(request.tables)
    return ()


def run_papers(place: Place, request: PapersRequest, progress: Progress) -> Reproduced:
    """Write the page."""
    from torquebench.reports.page_pdf import write_report

    file = request.out[0].with_suffix(".study")
    try:
        page = papers_page_of(request, file, progress)
    finally:
        if file.is_file() and (done := max(len(file.read_text("utf-8").splitlines()) - 1, 0)):
            kept = Message(
                "the study's {done} chains are in {file}; the same command goes on from there",
                done,
                file,
            )
            place.remarks.append(kept)
    written = [write_report(page, path) for path in request.out]
    file.unlink(missing_ok=True)
    summary = next(each for each in page.sections[0].blocks if isinstance(each, Table))
    return Reproduced(
        headline=page.title,
        simulated=page.simulated,
        files=tuple(map(str, written)),
        items=[ReproducedItem(item, verdict) for item, _, _, verdict, _ in summary.rows],
        described=page,
    )


def papers_page_of(request: PapersRequest, file: Path, progress: Progress) -> Page:
    """Measure or read the tables, and return the page; the study's results are kept in a file."""
    from torquebench.bench import default_bench
    from torquebench.papers.factors import CONDITIONS, measured_at
    from torquebench.papers.page import papers_page
    from torquebench.papers.run import page_study, results_of, seeded, with_factors, workers
    from torquebench.papers.tables import measure_tables, read_tables
    from torquebench.station import Station

    quick = not request.whole
    with contextlib.ExitStack() as opened:
        pool = opened.enter_context(workers())
        conditions = []
        if request.whole and not request.tables:
            first = seeded(default_bench(), 1)
            conditions = [pool.submit(measured_at, first, each) for each in CONDITIONS]
        computed = page_study(pool, file, quick=quick) if request.study else None
        tables = [read_tables(request.tables)] if request.tables else []
        for number in range(1, 2 if quick else request.seeds + 1):
            if request.tables:
                break
            settings = replace(_settings(quick), seed=number)
            if number > 1:
                settings = replace(settings, others=False, reducer_test="")
            with (
                tempfile.TemporaryDirectory(prefix="torquebench-papers-") as scratch,
                Station.open(seeded(default_bench(), number), Path(scratch)) as station,
            ):
                tables.append(measure_tables(station, settings, (), {"progress": progress}))
        results = results_of(tables, progress)
        if conditions:
            progress.start("Comparing temperatures, speeds and lubricants", None)
            with_factors(results, [each.result() for each in conditions])
        study, chains = computed or (None, 0)
        if study is not None:
            progress.start("Studying when BP beats the polynomial", study.total)
        rows = study.rows(progress) if study is not None else []
        progress.start("Computing supports and writing the page", None)
        return papers_page(results, rows, chains, quick=quick)


IN_PLACE = Operation(
    "in-place",
    InPlaceRequest,
    run_in_place,
    in_place_title,
    preview_in_place,
    check_in_place,
    where="bench",
    moves=True,
    loads=True,
    can_pause=True,
)
PAPERS_TABLES = Operation(
    "papers-tables",
    PapersTablesRequest,
    run_tables,
    lambda _request: "Measure the papers' tables",
    preview_tables,
    check_tables,
    where="bench",
    moves=True,
    loads=True,
    can_pause=True,
    activates=True,
)
PAPERS = on_files(
    "papers",
    PapersRequest,
    run_papers,
    lambda _request: "The papers' page",
    check_papers,
    quick=False,
)
