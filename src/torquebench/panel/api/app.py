"""The application of the HTTP API."""

from __future__ import annotations

from typing import Any

from fastapi import Depends, FastAPI

import torquebench
from torquebench.panel.api import (
    bench_routes,
    events,
    job_routes,
    people_routes,
    record_routes,
    stream,
)
from torquebench.panel.api.access import known_query
from torquebench.panel.api.describing import describe, name_choices
from torquebench.panel.api.problems import PROBLEMS, add_handlers
from torquebench.panel.service import BenchService

API_PATH = "/api/v1"
DESCRIPTION = """\
All functions of the operator panel, for programs. Every request contains
`Authorization: Bearer TOKEN`: the token of a client, which an administrator makes, or that of a
person's session. Whoever commands the bench holds the command lease (`/command`); a stop needs
none. Refusals are problem details (RFC 9457). Live data over a WebSocket: `/api/v1/stream`.

All torques are in N·m, clockwise positive; null means that there is no value.
"""


def create_api(service: BenchService) -> FastAPI:
    """Return the API's application around a service, to be mounted at `API_PATH`."""
    api = FastAPI(
        title="torquebench",
        version=torquebench.__version__,
        description=DESCRIPTION,
        docs_url=None,  # these pages would load files from a content delivery network
        redoc_url=None,
        openapi_url="/openapi.json",
        responses=PROBLEMS,
        dependencies=[Depends(known_query)],
        generate_unique_id_function=lambda route: route.name,
        servers=[{"url": API_PATH}],
        root_path_in_servers=False,
    )
    api.state.service = service
    for routes in (bench_routes, people_routes, job_routes, events, record_routes, stream):
        api.include_router(routes.router)
    api.include_router(record_routes.settings_router)
    add_handlers(api)

    def described() -> dict[str, Any]:
        if api.openapi_schema is None:
            api.openapi_schema = describe(api)
        name_choices(api.openapi_schema, service.settings)
        return api.openapi_schema

    api.openapi = described  # type: ignore[method-assign]
    return api
