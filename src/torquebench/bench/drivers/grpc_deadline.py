"""A time limit for every gRPC call, so that a server that hangs doesn't block its client."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import grpc


class _Details(NamedTuple):
    method: str
    timeout: float | None
    metadata: Any
    credentials: Any
    wait_for_ready: bool | None
    compression: Any


class Deadline(grpc.UnaryUnaryClientInterceptor):
    """Interceptor that limits the duration of every call."""

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s

    def intercept_unary_unary(
        self, continuation: Callable[[Any, Any], Any], client_call_details: Any, request: Any
    ) -> Any:
        """Forward the call with the time limit."""
        given = client_call_details
        details = _Details(
            given.method,
            self._timeout_s + float(getattr(request, "timeout", 0.0)),
            given.metadata,
            given.credentials,
            getattr(given, "wait_for_ready", None),
            getattr(given, "compression", None),
        )
        return continuation(details, request)
