"""Plant view in a browser: results of all benches, available without any bench.

Pages are plain HTML, generated on the server, and never change data.
"""

from __future__ import annotations

import base64
import secrets
import tempfile
from collections.abc import Callable, Mapping
from datetime import UTC, date, datetime
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from fastapi import FastAPI, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, HTMLResponse, PlainTextResponse, Response
from starlette.background import BackgroundTask

import torquebench_plant as questions
from torquebench.errors import InputError, TorquebenchError
from torquebench.figures import COLOURS, new_figure, svg_text
from torquebench.message import Message
from torquebench.panel.address import Address
from torquebench.panel.server import serve_application
from torquebench.panel.text import Language, choose_language
from torquebench.translations import translated
from torquebench_plant import Answer, Plant, SpecimenFilter

STYLE = Path(__file__).with_name("view.css")
SHOWN = 200
"""Largest number of table rows on a page; the files for download contain all rows."""
PAGES = {
    "overview": "Benches and due dates",
    "runs": "Runs",
    "transducers": "Transducers",
    "production": "Production",
    "comparison": "Comparison of benches",
}
"""Titles of the pages by their paths."""
LANGUAGES: Mapping[Language, tuple[str, str]] = {"en": ("en", "English"), "zh": ("zh-CN", "中文")}
"""Tag and name of each language."""
HEADINGS = {
    "last_contact": "Heard from (UTC)",
    "run_id": "Run",
    "started": "Started (UTC)",
    "specimen_type": "Type",
    "serial": "Serial number",
    "when": "When (UTC)",
    "span_error_percent": "Span error, %",
    "expanded_uncertainty": "U",
    "cp": "Cp (capability)",
    "cp_low": "Cp from",
    "cp_high": "Cp to",
    "cpk": "Cpk (capability)",
    "cpk_low": "Cpk from",
    "cpk_high": "Cpk to",
    "ewma": "Weighted average (EWMA)",
    "ewma_lower": "EWMA, lower limit",
    "ewma_upper": "EWMA, upper limit",
    "what": "Item",
    "p_value": "Probability by chance",
    "en": "Deviation number E_n",
    "lower": "Lower limit",
    "upper": "Upper limit",
    "reference": "Reference bench",
}
"""Headings of columns whose names aren't clear enough."""
_FORMS: Mapping[str, tuple[str, ...]] = {
    "runs": ("bench", "kind", "status", "specimen_type", "serial", "batch", "operator"),
    "transducers": ("serial", "kind"),
    "production": ("specimen_type", "quantity", "bench", "batch", "lower", "upper"),
    "comparison": ("serial", "quantity", "reference"),
}
Wanted = Mapping[str, str]


def _number(wanted: Wanted, name: str) -> int | None:
    given = wanted.get(name, "")
    if not given:
        return None
    if not given.isdecimal():
        raise InputError(Message("{name} {given!r}", name, given), "a number")
    return int(given)


def _limit(wanted: Wanted, name: str) -> float | None:
    try:
        return float(wanted[name].replace(",", ".")) if wanted.get(name) else None
    except ValueError as error:
        raise InputError(Message("{name} {wanted!r}", name, wanted[name]), "a number") from error


def _benches(plant: Plant, _wanted: Wanted) -> Answer:
    states = plant.benches()
    columns: dict[str, list[Any]] = {
        "bench": [each.title for each in states],
        "place": [each.place for each in states],
        "runs": [each.runs for each in states],
        "folders": [each.folders for each in states],
        "entries": [each.head.sequence for each in states],
        "last_contact": [each.last_contact for each in states],
        "replaced_by": [each.replaced_by for each in states],
    }
    return Answer("Benches", columns)


def _runs(plant: Plant, wanted: Wanted) -> Answer:
    filters: dict[str, Any] = {
        name: wanted[name] for name in _FORMS["runs"][1:] if wanted.get(name)
    }
    found = plant.runs(SHOWN, bench_key=_number(wanted, "bench"), **filters)
    names = ("run_id", "bench", "kind", "started", "specimen_type", "serial", "batch", "operator")
    columns: dict[str, list[Any]] = {name: [getattr(run, name) for run in found] for name in names}
    columns["status"] = ["withdrawn" if run.withdrawn else run.status for run in found]
    return Answer("Runs", columns, simulated=any(run.simulated for run in found))


def _due(plant: Plant, _wanted: Wanted) -> Answer:
    return questions.due(plant, 60)


def _drift(plant: Plant, wanted: Wanted) -> Answer | None:
    if wanted.get("kind"):
        return questions.drift_of_kind(plant, wanted["kind"])
    return questions.drift(plant, wanted["serial"]) if wanted.get("serial") else None


def _specimens(wanted: Wanted) -> SpecimenFilter | None:
    if not (wanted.get("specimen_type") and wanted.get("quantity")):
        return None
    return SpecimenFilter(
        wanted["specimen_type"],
        wanted["quantity"],
        _number(wanted, "bench"),
        wanted.get("batch") or None,
    )


def _capability(plant: Plant, wanted: Wanted) -> Answer | None:
    chosen = _specimens(wanted)
    if chosen is None:
        return None
    lower, upper = _limit(wanted, "lower"), _limit(wanted, "upper")
    return questions.capability(plant, chosen, lower=lower, upper=upper)


def _charts(plant: Plant, wanted: Wanted) -> Answer | None:
    chosen = _specimens(wanted)
    return None if chosen is None else questions.charts(plant, chosen)


def _outliers(plant: Plant, wanted: Wanted) -> Answer | None:
    chosen = _specimens(wanted)
    return None if chosen is None else questions.outliers(plant, chosen)


def _comparison(plant: Plant, wanted: Wanted) -> Answer | None:
    if not (wanted.get("serial") and wanted.get("quantity")):
        return None
    reference = _number(wanted, "reference")
    return questions.compare(plant, wanted["serial"], wanted["quantity"], reference=reference)


ANSWERS: Mapping[str, Callable[[Plant, Wanted], Answer | None]] = {
    "benches": _benches,
    "due": _due,
    "runs": _runs,
    "drift": _drift,
    "capability": _capability,
    "charts": _charts,
    "outliers": _outliers,
    "compare": _comparison,
}
_ON_PAGE: Mapping[str, tuple[str, ...]] = {
    "overview": ("benches", "due"),
    "runs": ("runs",),
    "transducers": ("drift",),
    "production": ("capability", "charts", "outliers"),
    "comparison": ("compare",),
}


def create_plant_view(plant: Plant, password: str = "") -> FastAPI:
    """Return the application; every page requires the password, if there is one (any user name)."""
    app = FastAPI(title="torquebench plant", docs_url=None, redoc_url=None, openapi_url=None)

    def refused(request: Request) -> Response | None:
        if not password:
            return None
        scheme, _, given = request.headers.get("authorization", "").partition(" ")
        try:
            said = base64.b64decode(given).decode().partition(":")[2]
        except ValueError:
            said = ""
        if scheme.lower() == "basic" and secrets.compare_digest(said.encode(), password.encode()):
            return None
        return Response("", 401, {"WWW-Authenticate": 'Basic realm="torquebench plant"'})

    @app.get("/view.css")
    async def style() -> Response:
        return FileResponse(STYLE)

    @app.get("/")
    @app.get("/{page}")
    async def page(request: Request, page: str = "overview") -> Response:
        if (answer := refused(request)) is not None:
            return answer
        name, _, ending = page.partition(".")
        wanted = {key: value.strip() for key, value in request.query_params.items()}
        if name in ANSWERS and ending in ("csv", "parquet"):
            return await run_in_threadpool(_file, plant, name, ending, wanted)
        language = choose_language(wanted.get("lang"), request.headers.get("accept-language"))
        if page not in PAGES:
            return HTMLResponse(_frame(language, "overview", ""), 404)
        return await run_in_threadpool(_page, plant, language, page, wanted)

    return app


def serve_plant_view(
    plant: Plant,
    address: Address,
    password: str = "",
    on_ready: Callable[[str], None] = lambda _url: None,
) -> None:
    """Serve the view until Ctrl-C.

    Raises
    ------
    InputError
        Other computers could read the view without a password.
    """
    address.check()
    if not address.local and not password:
        raise InputError(
            Message("a plant view on {host} without a password", address.host),
            "a password, or the loopback address",
            "set TORQUEBENCH_VIEW_PASSWORD",
        )
    serve_application(create_plant_view(plant, password), address, on_ready)


def _file(plant: Plant, name: str, ending: str, wanted: Wanted) -> Response:
    try:
        found = ANSWERS[name](plant, wanted)
    except TorquebenchError as error:
        return PlainTextResponse(f"{error}\n", _status(error))
    if found is None:
        return Response("", 404)
    with tempfile.NamedTemporaryFile(suffix=f".{ending}", delete=False) as file:
        path = Path(file.name)
    found.write(path)
    done = BackgroundTask(path.unlink, missing_ok=True)
    return FileResponse(path, filename=f"{name}.{ending}", background=done)


def _page(plant: Plant, language: Language, page: str, wanted: Wanted) -> HTMLResponse:
    parts, status = [_form(language, page, wanted)], 200
    for name in _ON_PAGE[page]:
        try:
            answer = ANSWERS[name](plant, wanted)
        except TorquebenchError as error:
            parts.append(_refusal(language, error))
            status = _status(error)
            break
        if answer is not None:
            parts.append(_section(language, name, answer, wanted))
    return HTMLResponse(_frame(language, page, "".join(parts)), status)


def _status(error: TorquebenchError) -> int:
    return 400 if isinstance(error, InputError) else 503


def _say(language: Language, said: str) -> str:
    """Return a text of the plant or of the core in a language, for HTML."""
    return escape(translated(said, language))


def _refusal(language: Language, error: TorquebenchError) -> str:
    more = [_say(language, Message("Allowed: {allowed}", error.allowed))] if error.allowed else []
    more += [_say(language, error.remedy)] if error.remedy else []
    found = _say(language, error.found)
    return f'<p class="problem" role="alert">{found}<br>{"; ".join(more)}</p>'


def _section(language: Language, name: str, answer: Answer, wanted: Wanted) -> str:
    simulated = f" · {_say(language, 'simulated')}" if answer.simulated else ""
    facts = "".join(
        f"<dt>{_say(language, key)}</dt><dd>{_shown(value, language)}</dd>"
        for key, value in answer.facts.items()
    )
    notes = "".join(f"<p>{_say(language, said)}</p>" for said in answer.notes)
    asked = urlencode({key: value for key, value in wanted.items() if key != "lang"})
    files = " · ".join(
        f'<a href="/{name}.{ending}?{escape(asked)}">{ending.upper()}</a>'
        for ending in ("csv", "parquet")
    )
    figure = _figure(language, answer) if name == "charts" else ""
    return (
        f"<section><h2>{_say(language, answer.title)}{simulated}</h2>{notes}<dl>{facts}</dl>"
        f"{figure}{_table(language, answer)}<p>{files}</p></section>"
    )


def _table(language: Language, answer: Answer) -> str:
    rows = answer.rows()
    if not rows:
        return f"<p>{_say(language, 'Nothing')}</p>"
    kept = [name for name in answer.columns if any(row[name] not in (None, "") for row in rows)]
    shown = answer.shown(SHOWN)
    head = "".join(f'<th scope="col">{_heading(language, name)}</th>' for name in kept)
    body = "".join(
        "<tr>" + "".join(f"<td>{_shown(row[name], language)}</td>" for name in kept) + "</tr>"
        for row in (reversed(shown) if answer.in_time else shown)
    )
    more = Message(
        "The last {shown} of {all} rows; the files hold all."
        if answer.in_time
        else "The first {shown} of {all} rows; the files hold all.",
        SHOWN,
        len(rows),
    )
    return (
        f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
        f"</div><p>{_say(language, more) if len(rows) > SHOWN else ''}</p>"
    )


def _heading(language: Language, name: str) -> str:
    words = name.replace("_", " ")
    heading = HEADINGS.get(name) or words.capitalize()
    known = language == "en" or translated(heading, language) != heading
    return _say(language, heading if known else words)  # the core's own words begin small


def _shown(value: Any, language: Language) -> str:
    if value is None:
        return "-"
    if isinstance(value, datetime):
        return f"{value.astimezone(UTC):%Y-%m-%d %H:%M}"
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, float):
        return f"{value:.4g}"
    return _say(language, value if isinstance(value, str) else str(value))


def _figure(language: Language, answer: Answer) -> str:
    """Return both control charts, one above the other."""
    figure, (single, moving) = new_figure(2.4, 2)
    single.plot(answer.columns["value"], ".", color=COLOURS[0], markersize=3)
    for name in ("lower limit of single values", "centre", "upper limit of single values"):
        single.axhline(answer.facts[name], color=COLOURS[1], linewidth=0.8)
    moving.plot(answer.columns["ewma"], color=COLOURS[0], linewidth=1.0)
    for name in ("ewma_lower", "ewma_upper"):
        moving.plot(answer.columns[name], color=COLOURS[1], linewidth=0.8)
    for axes in (single, moving):
        axes.margins(y=0.1)  # limits stay off the frame
    label = _say(language, "Control charts")
    return f'<div role="img" aria-label="{label}">{svg_text(figure)}</div>'


def _form(language: Language, page: str, wanted: Wanted) -> str:
    fields = _FORMS.get(page)
    if fields is None:
        return ""
    inputs = "".join(
        f"<label>{_heading(language, name)} "
        f'<input name="{name}" value="{escape(wanted.get(name, ""))}"></label> '
        for name in fields
    )
    chosen = f'<input type="hidden" name="lang" value="{language}">'
    show = _say(language, "Show")
    return f'<form method="get" action="/{page}">{inputs}{chosen}<button>{show}</button></form>'


def _frame(language: Language, page: str, content: str) -> str:
    links = "".join(
        f'<a href="/{name}?lang={language}"{" aria-current=page" if name == page else ""}>'
        f"{_say(language, title)}</a>"
        for name, title in PAGES.items()
    )
    others = "".join(
        f'<a href="/{page}?lang={each}" lang="{each}">{name}</a>'
        for each, (_, name) in LANGUAGES.items()
        if each != language
    )
    title = _say(language, "Plant")
    return (
        f'<!DOCTYPE html><html lang="{LANGUAGES[language][0]}"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>{title} · torquebench</title>"
        '<link rel="stylesheet" href="/view.css"></head>'
        f"<body><header><h1>{title}</h1><nav>{links}</nav><nav>{others}</nav></header>"
        f"<main>{content}</main></body></html>"
    )
