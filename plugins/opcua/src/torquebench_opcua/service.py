"""The option `--opcua` of `torquebench panel`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from torquebench.panel.beside import PanelService, ServedBench
from torquebench_opcua.endpoint import Endpoint

__all__ = ["SERVICE"]


@contextmanager
def _serve(bench: ServedBench, endpoint: Endpoint, note: Callable[[str], None]) -> Iterator[str]:
    from torquebench_opcua.server import OpcUaServer

    with OpcUaServer(bench, endpoint, lambda text: note(f"OPC UA: {text}")) as server:
        yield f"OPC UA: {server.url}"


SERVICE = PanelService(
    option="opcua",
    value="URL",
    help="Also serve the bench by OPC UA, as in opc.tcp://0.0.0.0:4840.",
    settings=Endpoint.parse,
    serve=_serve,
)
