"""Keep records: verify, amend, back up, restore, rebuild, and export runs."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.certificates import Record, subject_of
from torquebench.operations.equipment import Entered
from torquebench.operations.operation import Flag, Operation, Request, field
from torquebench.operations.place import Place, data_directory
from torquebench.operations.records import find_run
from torquebench.operations.result import Result
from torquebench.progress import Progress
from torquebench.reports.page import Block, Facts, Page, Section, Table

if TYPE_CHECKING:
    from torquebench.records import IntegrityReport

Run = Annotated[
    str,
    field("A run's id or its beginning, or `latest`.", argument=True, min_length=1, max_length=100),
]


# -- verify and amend -----------------------------------------------------------------------


class VerifyRecordsRequest(Request):
    """Compare every record and every file with its entry; nothing is written.

    This checks the database with its indexes, tables and triggers, every row by the hash chain,
    every run folder, model and certificate, unregistered folders, and the audit log by its own
    chain. Each defect is listed with its remedy, and the check fails if there is one.
    """

    end: Annotated[
        tuple[str, ...],
        field("An end of the chain noted down earlier (number:hash). May be repeated."),
    ] = ()
    files: Annotated[
        Flag, field("Also compare run folders and files, which reads all of them.")
    ] = True


@dataclass(frozen=True)
class Defect:
    """A record that has changed since its entry."""

    kind: str
    where: str
    found: str
    remedy: str


@dataclass(frozen=True, kw_only=True)
class VerifiedRecords(Result):
    """All records and files compared with their entries."""

    intact: bool
    records: int
    runs: int
    files_compared: int
    audit_lines: int
    chain_end: str
    defects: Sequence[Defect]

    @property
    def failed(self) -> bool:
        """Whether a record has changed."""
        return not self.intact

    def page(self) -> Page:
        """Return its description."""
        compared = Message("{count} records", self.records)
        if self.runs or self.files_compared:
            compared = Message(
                "{records}, {runs} run folders and {files} files",
                compared,
                self.runs,
                self.files_compared,
            )
        compared = Message("{what}, {count} lines of the audit log", compared, self.audit_lines)
        blocks: list[Block] = [Facts([("compared", compared), ("chain end", self.chain_end)])]
        if self.defects:
            rows = [(each.kind, each.where, each.found, each.remedy) for each in self.defects]
            header = ("what", "where", "found", "way back")
            blocks.insert(0, Table(header, rows, words=True))
        return Page("Records compared with their entries", "", [Section("", "", blocks)])


def compare(
    folder: Path, end: tuple[str, ...], files: bool, _progress: Progress
) -> IntegrityReport:
    """Compare a data directory with its registry, possibly in another process."""
    from torquebench.records import anchor_of
    from torquebench.station.data_check import check_data_directory

    anchors = tuple(anchor_of(each) for each in end)
    return check_data_directory(folder, anchors=anchors, folders=files)


def run_verify(place: Place, request: VerifyRecordsRequest, progress: Progress) -> VerifiedRecords:
    """Compare all records and files."""
    folder = _with_runs(place.folder)
    report = place.compute(compare, folder, request.end, request.files, progress=progress)
    count = len(report.findings)
    defects = "1 defect." if count == 1 else Message("{count} defects.", count)
    return VerifiedRecords(
        headline="All are unchanged." if report.intact else defects,
        remarks=report.remarks,
        intact=report.intact,
        records=report.records,
        runs=report.runs,
        files_compared=report.files,
        audit_lines=report.audit_lines,
        chain_end=str(report.head),
        defects=[
            Defect(each.kind, each.place, each.what, each.way_back) for each in report.findings
        ],
    )


def _with_runs(folder: Path) -> Path:
    """Return a data directory with a registry, or with runs whose registry is lost.

    Raises
    ------
    InputError
        The directory has neither a registry nor runs.
    """
    from torquebench.station.data_check import run_folders

    return folder if run_folders(folder) else data_directory(folder)


class AmendRequest(Request):
    """Enter a correction of a record. The record itself isn't changed."""

    record: Record
    changes: Annotated[
        dict[str, str],
        field(
            "Corrected value of a field, as measured_by=Anna.",
            title="Corrections",
            argument=True,
            min_length=1,
            max_length=50,
            examples=({"measured_by": "Anna"},),
        ),
    ]
    reason: Annotated[str, field("Why.", min_length=1, max_length=500)]


def run_amend(place: Place, request: AmendRequest, _progress: Progress) -> Entered:
    """Register the correction."""
    subject, number = subject_of(request.record)
    place.registry.amend(
        subject,
        number,
        request.changes,
        amended_by=place.operator,
        reason=request.reason,
        signature=place.signature,
    )
    return Entered(
        headline=Message(
            "{record} amended: {fields}. The record itself stays as it was.",
            request.record,
            ", ".join(request.changes),
        ),
        record=request.record,
    )


# -- back up, restore, rebuild --------------------------------------------------------------


class BackupRequest(Request):
    """Copy all records into a folder, even while the bench runs.

    The registry is copied in one consistent state, with all files that it names: runs, models,
    certificates, audit log, accounts of the panel. Sealed runs are copied once. The copy is a data
    directory: `--data` lists, verifies and exports it. The check fails if something is damaged and
    couldn't be copied.
    """

    target: Annotated[
        Path,
        field(
            "A new folder, or an earlier backup, which is brought up to date.",
            argument=True,
            output=("folder",),
        ),
    ]


@dataclass(frozen=True, kw_only=True)
class BackedUp(Result):
    """Result of a backup."""

    runs: int
    known_runs: int
    open_runs: Sequence[str]
    files_copied: int
    outside: Sequence[str]
    problems: Sequence[str]
    chain_end: str

    @property
    def failed(self) -> bool:
        """Whether something couldn't be copied."""
        return bool(self.problems)


def run_backup(place: Place, request: BackupRequest, progress: Progress) -> BackedUp:
    """Copy the data directory."""
    from torquebench.station.backup import back_up

    done = back_up(data_directory(place.folder), request.target, progress)
    return BackedUp(
        headline=Message(
            "{runs} run folders and {files} other files copied to {target}, {known} run folders "
            "were there already.",
            done.runs,
            done.files,
            request.target,
            done.known_runs,
        ),
        remarks=(
            *(
                Message("{file} lies outside the data directory and isn't in the backup", file)
                for file in done.outside
            ),
            *(Message("not copied: {problem}", problem) for problem in done.problems),
        ),
        runs=done.runs,
        known_runs=done.known_runs,
        open_runs=done.open_runs,
        files_copied=done.files,
        outside=done.outside,
        problems=done.problems,
        chain_end=str(done.head),
    )


class RestoreRequest(Request):
    """Restore missing files from a backup, and with `--replace` damaged ones.

    The backup is compared with its registry first; nothing is restored from a damaged one, or from
    one with links. Nothing is overwritten: without `--replace` the command refuses if files differ;
    with it, the present files are moved to a separate folder. Data newer than the backup are kept.
    Everything is restored, or nothing.
    """

    source: Annotated[Path, field("A backup.", argument=True)]
    replace: Annotated[
        Flag, field("Also restore files that differ; the present ones are kept aside.")
    ] = False


@dataclass(frozen=True, kw_only=True)
class RestoredFiles(Result):
    """What was restored, replaced and kept; `aside` has the replaced files."""

    restored: Sequence[str]
    replaced: Sequence[str]
    kept: Sequence[str]
    missing: Sequence[str]
    aside: str | None


def run_restore(place: Place, request: RestoreRequest, progress: Progress) -> RestoredFiles:
    """Restore the files."""
    from torquebench.station.backup import restore

    done = restore(request.source, place.folder, replace=request.replace, progress=progress)
    return RestoredFiles(
        headline=Message(
            "{restored} restored, {replaced} replaced, {kept} kept. See `torquebench records "
            "verify`; runs that are newer than the backup are entered by `torquebench records "
            "rebuild`.",
            len(done.restored),
            len(done.replaced),
            len(done.kept),
        ),
        remarks=tuple(Message("the backup doesn't have {name}", name) for name in done.missing),
        restored=done.restored,
        replaced=done.replaced,
        kept=done.kept,
        missing=done.missing,
        aside=None if done.aside is None else str(done.aside),
    )


class RebuildRequest(Request):
    """Rebuild a lost or damaged registry from the run folders, or complete an intact one.

    A damaged registry is kept under another name. Runs, their benches and zeros, calibrations,
    models and certificates are entered again; information that only the registry contained is
    listed. Restore a backup instead if there is one.
    """


@dataclass(frozen=True, kw_only=True)
class RebuiltRegistry(Result):
    """Content of a rebuilt registry; `lost` was in the previous one only, which is `aside`."""

    anew: bool
    mended: Sequence[str]
    aside: str | None
    runs: Sequence[str]
    calibrations: Sequence[str]
    models: Sequence[str]
    certificates: Sequence[str]
    unfitted: Sequence[str]
    problems: Sequence[str]
    lost: Sequence[str]

    @property
    def failed(self) -> bool:
        """Whether something couldn't be entered."""
        return bool(self.problems)


def run_rebuild(place: Place, _request: RebuildRequest, progress: Progress) -> RebuiltRegistry:
    """Rebuild the registry."""
    from torquebench.campaign.rebuilding import NOT_REBUILT, rebuild

    done = rebuild(_with_runs(place.folder), place.operator, progress)
    return RebuiltRegistry(
        headline=Message(
            "{runs} runs, {calibrations} calibrations, {models} models and {certificates} "
            "certificates entered{anew}.",
            len(done.runs),
            len(done.calibrations),
            len(done.models),
            len(done.certificates),
            " in a new registry" if done.anew else "",
        ),
        remarks=(
            *(
                Message("run {run} has no model: `torquebench records finish {run}` fits it", run)
                for run in done.unfitted
            ),
            *(Message("not entered: {problem}", problem) for problem in done.problems),
        ),
        anew=done.anew,
        mended=done.mended,
        aside=None if done.aside is None else str(done.aside),
        runs=done.runs,
        calibrations=done.calibrations,
        models=done.models,
        certificates=done.certificates,
        unfitted=done.unfitted,
        problems=done.problems,
        lost=NOT_REBUILT if done.anew else (),
    )


# -- export ---------------------------------------------------------------------------------


class ExportRunRequest(Request):
    """Write all data of a run as CSV, JSON, PDF and XML, with a README."""

    run: Run
    out: Annotated[
        Path,
        field(
            "A ZIP archive (.zip), or a folder that doesn't exist yet or is empty.",
            output=(".zip", "folder"),
        ),
    ] = Path("run.zip")


@dataclass(frozen=True, kw_only=True)
class ExportedRun(Result):
    """An exported run; `content` has the names of all its files."""

    content: Sequence[str]

    def page(self) -> Page:
        """Return its description."""
        files = Facts([("", name) for name in self.content])
        return Page(self.headline, "", [Section("", "", [files])], simulated=self.simulated)


def run_export(place: Place, request: ExportRunRequest, _progress: Progress) -> ExportedRun:
    """Write the run's files into a folder, or into an archive."""
    from torquebench.reports.export import export_run

    run, out = find_run(place.registry, request.run), request.out
    packed = out.suffix.lower() == ".zip"
    with tempfile.TemporaryDirectory(prefix="torquebench-") as scratch:
        exported = export_run(place.registry, run, Path(scratch) / run.run_id if packed else out)
        if packed:
            with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
                for name in exported.files:
                    archive.write(exported.folder / name, f"{run.run_id}/{name}")
    return ExportedRun(
        headline=Message("{count} files.", len(exported.files)),
        simulated=run.simulated,
        run_ids=(run.run_id,),
        remarks=tuple(exported.remarks),
        files=(str(out),) if packed else tuple(str(out / name) for name in exported.files),
        content=exported.files,
    )


class ExportDataRequest(Request):
    """Write a run's samples or edges as CSV, Parquet, HDF5, TDMS or MDF4, with units."""

    run: Run
    out: Annotated[
        Path, field("File to write.", output=(".csv", ".parquet", ".h5", ".tdms", ".mf4"))
    ] = Path("samples.csv")
    format: Annotated[
        Literal["csv", "parquet", "hdf5", "tdms", "mdf4"] | None,
        field(
            "By default that of the file's suffix, else CSV. TDMS, MDF4 and HDF5 need the extra "
            "of their name."
        ),
    ] = None
    stream: Annotated[
        Literal["samples", "edges"],
        field("Torque, angle, speed, temperature; or every edge."),
    ] = "samples"


@dataclass(frozen=True, kw_only=True)
class ExportedStream(Result):
    """A run's samples or edges for other programs."""

    run: str
    stream: str
    format: str


def run_export_data(
    place: Place, request: ExportDataRequest, _progress: Progress
) -> ExportedStream:
    """Write the stream."""
    from torquebench.records import RunFolder
    from torquebench.records.export.streams import export_streams

    chosen = _format(request)
    run = find_run(place.registry, request.run)
    export_streams(RunFolder.open(run.folder), request.out, chosen, request.stream)
    return ExportedStream(
        headline=Message("{stream} of {run} as {format}.", request.stream, run.run_id, chosen),
        simulated=run.simulated,
        run_ids=(run.run_id,),
        files=(str(request.out),),
        run=run.run_id,
        stream=request.stream,
        format=chosen,
    )


def check_format(_place: Place, request: ExportDataRequest) -> Iterable[str]:
    """Raise an error for a suffix of another format."""
    _format(request)
    return ()


def _format(request: ExportDataRequest) -> Literal["csv", "parquet", "hdf5", "tdms", "mdf4"]:
    """Return the format to write, as requested or by the file's suffix.

    Raises
    ------
    InputError
        Where the suffix is that of another format.
    """
    from torquebench.records.export.streams import STREAM_FORMATS
    from torquebench.tables.formats import format_of

    out, wanted = request.out, request.format
    found = format_of(out) if out.suffix else None
    named = next((each for each in STREAM_FORMATS if found and each == found.name), None)
    if found is not None and (named is None or named != (wanted or named)):
        raise InputError(
            Message("{name} for {wanted}", out.name, wanted or found.name),
            "an ending of the format: .csv, .parquet, .h5, .tdms, .mf4",
            "choose such an ending, or the --format that it names",
        )
    return wanted or named or "csv"


# -- operations -----------------------------------------------------------------------------

VERIFY_RECORDS = Operation(
    "records verify",
    VerifyRecordsRequest,
    run_verify,
    lambda _request: "Verify the records",
    where="folder",
)
AMEND = Operation(
    "records amend",
    AmendRequest,
    run_amend,
    lambda request: Message("Amend {record}", request.record),
    role="metrologist",
    quick=True,
)
BACKUP = Operation(
    "records backup",
    BackupRequest,
    run_backup,
    lambda request: Message("Back up to {folder}", request.target),
    where="folder",
    local=True,
)
RESTORE = Operation(
    "records restore",
    RestoreRequest,
    run_restore,
    lambda request: Message("Restore {folder}", request.source),
    where="folder",
    local=True,
)
REBUILD = Operation(
    "records rebuild",
    RebuildRequest,
    run_rebuild,
    lambda _request: "Rebuild the registry",
    where="folder",
    local=True,
)
EXPORT_RUN = Operation(
    "records export",
    ExportRunRequest,
    run_export,
    lambda request: Message("Export {run}", request.run),
    quick=True,
)
EXPORT_DATA = Operation(
    "records export-data",
    ExportDataRequest,
    run_export_data,
    lambda request: Message("Export data of {run}", request.run),
    check=check_format,
    quick=True,
)
