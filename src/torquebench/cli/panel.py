"""`torquebench panel`: the bench in a browser, and the same operations over HTTP."""

from __future__ import annotations

import contextlib
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from torquebench.cli.options import (
    DEFAULT_DATA,
    AddressOptions,
    BenchOption,
    DataOption,
    bench_description,
)
from torquebench.cli.terminal.console import note, say, warn

__all__ = ["panel"]


def panel(
    bench: BenchOption = None,
    data: DataOption = DEFAULT_DATA,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to listen on; 0 takes a free one.")
    ] = 8080,
    behind_proxy: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Trust the client address stated by the reverse proxy at this address.",
        ),
    ] = "",
    opcua: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Also serve the bench by OPC UA, as in opc.tcp://0.0.0.0:4840 (extra opcua).",
        ),
    ] = None,
    fast: Annotated[
        bool,
        typer.Option("--fast", help="Simulated procedures run as fast as they compute."),
    ] = False,
    sparkplug: Annotated[
        Path | None,
        typer.Option(
            help="Publish the bench by MQTT Sparkplug B, as this settings file (.toml) says."
        ),
    ] = None,
    *,
    serving: AddressOptions,
) -> None:
    """Open the bench and serve the operator panel and the HTTP API.

    The simulated bench by default, in real time, on the loopback address. The first start prints
    a code with which the administrator is set up in the browser. Ctrl-C ends it; the bench is
    without torque before the process ends.
    """
    from torquebench.panel.address import ANY_ADDRESS

    address = serving.address(port, behind_proxy)
    endpoint = None
    if opcua is not None:
        import_module("asyncua")  # first, so that the error names this extra
        from torquebench.opcua import Endpoint

        endpoint = Endpoint.parse(opcua)
    description = bench_description(bench)
    published = None
    if sparkplug is not None:
        import_module("paho.mqtt")
        from torquebench.panel.sparkplug.publisher import Publisher
        from torquebench.panel.sparkplug.settings import load_settings

        published = load_settings(sparkplug)

    from torquebench.panel.server import serve
    from torquebench.panel.service import BenchService

    with (
        BenchService.open(description, data, fast=fast) as service,
        contextlib.ExitStack() as served,
    ):
        if service.station.description.simulated:
            note("simulated bench")

        plant = ""
        if endpoint is not None:
            from torquebench.opcua import OpcUaServer

            plant = served.enter_context(OpcUaServer(service, endpoint)).url

        def ready(url: str) -> None:
            if plant:
                say(f"OPC UA: {plant}")
            say(f"Panel: {url}")
            code = service.people.setup_code
            if code is not None:
                say(f"Set up the administrator there with the code {code}")
            if address.insecure_network and not address.secure:
                warn(
                    "without TLS everybody in this network can read passwords and measured "
                    "values; it answers to its own addresses and to "
                    + ", ".join(name for name in address.hosts if name != ANY_ADDRESS)
                )
            note("Ctrl-C ends it.")

        with contextlib.ExitStack() as publishing:
            if published is not None:
                publisher = Publisher.of(
                    service, published, lambda text: note(f"Sparkplug: {text}")
                )
                publishing.enter_context(publisher)
            serve(service, address, ready)
    note("panel ended; the bench is without torque")
