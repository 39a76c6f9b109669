"""Stream live data over a WebSocket, at the requested rate or as fast as the client reads.

The client sends one JSON message, `{"token": "…", "signals": […], "since": 0, "rate": 30}`; only
the token is required. Then every message from the server is a `LiveRows`. The token isn't in a
header, because browsers can't send headers with a WebSocket, and not in the URL, which may be
logged.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from typing import Annotated

from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from torquebench.errors import TorquebenchError
from torquebench.panel.api.access import caller_of
from torquebench.panel.api.bench_routes import live_document
from torquebench.panel.api.events import until_left
from torquebench.panel.service import BenchService

router = APIRouter()

FIRST_MESSAGE_S = 15.0
CLOSING_S = 1.0
SLOWEST_S = 20.0
"""Timeout for sending to a client, s; at most one message waits."""
REFUSED = 1008


class StreamRequest(BaseModel):
    """The first message of a client."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    token: Annotated[str, Field(min_length=1, max_length=200)]
    signals: Annotated[list[str], Field(max_length=32)] | None = None
    since: Annotated[int, Field(ge=0, le=2**53)] = 0
    rate: Annotated[
        float, Field(gt=0, le=50, description="Largest number of messages per second.")
    ] = 30.0


@router.websocket("/stream")
async def stream(websocket: WebSocket) -> None:
    """Send new rows until the client disconnects or its token is revoked."""
    service: BenchService = websocket.app.state.service
    await websocket.accept()
    try:
        request = await _first(websocket)
        await _send(websocket, service, request)
    except (TimeoutError, ValidationError, TorquebenchError, ValueError, KeyError) as error:
        reason = error.found if isinstance(error, TorquebenchError) else "an unusable message"
        with contextlib.suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
            await asyncio.wait_for(websocket.close(REFUSED, reason[:100]), CLOSING_S)
    except (WebSocketDisconnect, RuntimeError):  # the client disconnected, perhaps during a send
        return


async def _first(websocket: WebSocket) -> StreamRequest:
    text = await asyncio.wait_for(websocket.receive_text(), FIRST_MESSAGE_S)
    return StreamRequest.model_validate_json(text)


async def _send(websocket: WebSocket, service: BenchService, request: StreamRequest) -> None:
    left = asyncio.ensure_future(until_left(websocket.receive))
    try:
        sequence = request.since
        while not left.done():
            caller_of(service, request.token, touch=False)  # the token may have been revoked
            trend = service.live.since(sequence, request.signals)
            if trend.time_s.size or trend.sequence != sequence:
                sequence = trend.sequence
                message = json.dumps(live_document(trend))
                await asyncio.wait_for(websocket.send_text(message), SLOWEST_S)
            await asyncio.sleep(1.0 / request.rate)
    finally:
        left.cancel()
