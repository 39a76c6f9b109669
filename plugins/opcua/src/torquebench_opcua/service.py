"""The option `--opcua` of `torquebench panel`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from torquebench.panel.beside import PanelService
from torquebench_opcua.endpoint import Endpoint

if TYPE_CHECKING:
    from torquebench.panel.service import BenchService

__all__ = ["SERVICE"]


@contextmanager
def _serve(bench: BenchService, endpoint: Endpoint, _note: Callable[[str], None]) -> Iterator[str]:
    from torquebench_opcua.server import OpcUaServer

    with OpcUaServer(bench, endpoint) as server:
        yield f"OPC UA: {server.url}"


SERVICE = PanelService(
    option="opcua",
    value="URL",
    help="Also serve the bench by OPC UA, as in opc.tcp://0.0.0.0:4840.",
    settings=Endpoint.parse,
    serve=_serve,
)
