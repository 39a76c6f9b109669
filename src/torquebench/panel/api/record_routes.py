"""Routes of records and settings, which are addressed by identifiers."""

from __future__ import annotations

from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Body, Path, Query, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel

from torquebench.bench.roles import Side
from torquebench.operations import Moment
from torquebench.panel.api.access import Caller, Service, Watched
from torquebench.panel.api.bench_routes import finite_list
from torquebench.panel.api.models import DocumentBody, ReasonBody
from torquebench.panel.service import (
    CalibrationDetail,
    ErrorCurve,
    RunDetail,
    RunPage,
    SettingsChange,
    SettingsItem,
    UnfinishedView,
)
from torquebench.panel.service.records.queries import MEDIA
from torquebench.records import CalibrationEntry, CertificateEntry, ModelEntry

router = APIRouter(tags=["records"])
settings_router = APIRouter(tags=["settings"])


Text = Annotated[str, Query(max_length=200)]
RunId = Annotated[str, Path(max_length=100)]
Number = Annotated[int, Path(ge=1, le=2**53)]
Word = Annotated[str | None, Query(max_length=64)]
Serial = Annotated[str | None, Query(max_length=200, description="A serial number.")]


class TrendOfRun(BaseModel):
    """Raw samples of a run over time: lowest, highest and mean of each row."""

    time_s: list[float]
    columns: dict[str, dict[str, list[float | None]]]


@router.get("/runs")
def runs(
    service: Watched,
    text: Text = "",
    kind: Word = None,
    side: Annotated[Side | None, Query()] = None,
    status: Word = None,
    since: Annotated[Moment | None, Query()] = None,
    until: Annotated[Moment | None, Query()] = None,
    limit: Annotated[int, Query(ge=1, le=500)] = 50,
    offset: Annotated[int, Query(ge=0, le=10**9)] = 0,
) -> RunPage:
    """Search the runs, the newest first."""
    return service.records.runs(
        text,
        kind=kind,
        side=side,
        status=status,
        since=since,
        until=until,
        limit=limit,
        offset=offset,
    )


@router.get("/runs/{run_id}")
def run(service: Watched, run_id: RunId) -> RunDetail:
    """Return all data of one run, and whether its files still match the seal."""
    return service.records.run(run_id)


@router.get("/unfinished")
def unfinished(service: Watched) -> list[UnfinishedView]:
    """Return unfinished runs, the oldest first."""
    return service.unfinished()


@router.get("/runs/{run_id}/columns")
def run_columns(service: Watched, run_id: RunId) -> list[str]:
    """Return the columns of a run's raw stream other than time."""
    return list(service.records.run_columns(run_id))


@router.get("/runs/{run_id}/trend")
def run_trend(
    service: Watched,
    run_id: RunId,
    columns: Annotated[list[Annotated[str, Query(max_length=64)]], Query(max_length=16)],
    points: Annotated[int, Query(ge=1, le=5000)] = 1000,
) -> TrendOfRun:
    """Return raw samples of a run, reduced without losing extremes."""
    rows = service.records.run_trend(run_id, columns, points)
    return TrendOfRun(
        time_s=rows.time_s.tolist(),
        columns={
            name: {
                "low": finite_list(rows.low[place]),
                "high": finite_list(rows.high[place]),
                "mean": finite_list(rows.mean[place]),
            }
            for place, name in enumerate(columns)
        },
    )


def _sends(words: str, *media_types: str) -> dict[str, Any]:
    """Describe an operation that sends a file."""
    answer = {"content": {media_type: {} for media_type in media_types}, "description": words}
    return {"response_class": Response, "responses": {200: answer}}


@router.get("/runs/{run_id}/report", **_sends("The report as PDF.", "application/pdf"))
def run_report(service: Watched, run_id: RunId) -> Response:
    """Return the report of a reducer test by its first run."""
    content = service.records.report_file(run_id)
    return Response(content, media_type="application/pdf", headers=_attached(f"{run_id}.pdf"))


def _attached(name: str) -> dict[str, str]:
    """Return the header with a file's name, for any characters."""
    return {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name, safe='')}"}


@router.get("/calibrations")
def calibrations(
    service: Watched,
    transducer: Serial = None,
    limit: Annotated[int, Query(ge=1, le=500)] = 100,
) -> list[CalibrationEntry]:
    """Return calibrations, the newest first."""
    return service.records.calibrations(transducer, limit)


@router.get("/calibrations/{calibration_id}")
def calibration(service: Watched, calibration_id: Number) -> CalibrationDetail:
    """Return a calibration with its models, verifications, reviews and certificates."""
    return service.records.calibration(calibration_id)


@router.get("/calibrations/{calibration_id}/errors")
def errors(
    service: Watched,
    calibration_id: Number,
    model_id: Annotated[int | None, Query(ge=1, le=2**53)] = None,
) -> ErrorCurve:
    """Return the error of a chain over torque, raw and compensated by a model."""
    return service.records.error_curve(calibration_id, model_id)


@router.get("/models")
def models(service: Watched, transducer: Serial = None) -> list[ModelEntry]:
    """Return models; the attribute `active` says which are in use."""
    return service.records.models(transducer)


@router.get("/models/{model_id}/file", **_sends("The file of the model.", "application/json"))
def model_file(service: Watched, model_id: Number) -> Response:
    """Return a model's file for `torquebench apply`, checked by its registered hash."""
    content, name = service.records.model_file(model_id)
    return Response(content, media_type="application/json", headers=_attached(name))


@router.get("/transducers")
def transducers(service: Watched) -> list[str]:
    """Return the serial numbers of all registered transducers."""
    return service.records.transducers()


@router.get("/certificates")
def certificates(service: Watched) -> list[CertificateEntry]:
    """Return all certificates, the newest first."""
    return service.records.certificates()


@router.get(
    "/certificates/{number}/{name}",
    **_sends("The file, checked by its registered hash.", *MEDIA.values()),
)
def certificate_file(
    service: Watched,
    number: Annotated[str, Path(max_length=100)],
    name: Annotated[str, Path(max_length=200)],
) -> Response:
    """Return one file of a certificate."""
    content, media_type = service.records.certificate_file(number, name)
    return Response(content, media_type=media_type, headers=_attached(name))


# -- files of operations --------------------------------------------------------------------


class FileReference(BaseModel):
    """Name of a file for the fields of operations that take a file."""

    file: str


@router.post("/files", status_code=201)
def add_file(
    service: Watched,
    content: Annotated[bytes, Body(media_type="application/octet-stream")],
    name: Annotated[str, Query(max_length=200)] = "table.csv",
) -> FileReference:
    """Hand in a file, such as a table, for operations; it is kept until the server ends."""
    return FileReference(file=service.files.add(content, name))


@router.get("/files/{reference:path}", response_class=Response)
def file(service: Watched, reference: Annotated[str, Path(max_length=200)]) -> FileResponse:
    """Return a file that was handed in, or that an operation has written."""
    path = service.files.path(reference)
    kind = MEDIA.get(path.suffix, "application/octet-stream")
    return FileResponse(path, media_type=kind, headers=_attached(path.name))


# -- settings -------------------------------------------------------------------------------

SectionPath = Annotated[str, Path(max_length=40)]
ItemPath = Annotated[str, Path(max_length=80)]


@settings_router.get("/settings/{section}")
def items(service: Watched, section: SectionPath) -> list[SettingsItem]:
    """Return all documents of a section: bench, profiles or reducers."""
    return service.settings.items(section)


@settings_router.get("/settings/{section}/{name}")
def item(service: Watched, section: SectionPath, name: ItemPath) -> SettingsItem:
    """Return one document."""
    return service.settings.get(section, name)


@settings_router.post("/settings/{section}/{name}/preview")
def preview(
    service: Watched, section: SectionPath, name: ItemPath, body: DocumentBody
) -> SettingsChange:
    """Validate a document and return the changes that it would make."""
    return service.settings.preview(section, name, body.document)


@settings_router.put("/settings/{section}/{name}")
def change(
    service: Service, caller: Caller, section: SectionPath, name: ItemPath, body: DocumentBody
) -> SettingsChange:
    """Change or add a document."""
    return service.settings.change(
        caller, section, name, body.document, reason=body.reason, version=body.version
    )


@settings_router.delete("/settings/{section}/{name}")
def delete(
    service: Service, caller: Caller, section: SectionPath, name: ItemPath
) -> SettingsChange:
    """Delete a user's profile or reducer; it stays in the history."""
    return service.settings.change(caller, section, name, None)


@settings_router.get("/changes")
def history(
    service: Watched,
    section: Word = None,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> list[SettingsChange]:
    """Return changes of the settings, the newest first."""
    return service.settings.history(section, limit)


@settings_router.post("/changes/{number}/undo")
def undo(service: Service, caller: Caller, number: Number, body: ReasonBody) -> SettingsChange:
    """Undo a change, which makes another change."""
    return service.settings.undo(caller, number, body.reason)
