"""`torquebench panel`: serve the bench in a browser, and the same operations by HTTP."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import make_dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.options import (
    DEFAULT_DATA,
    AddressOptions,
    BenchOption,
    DataOption,
    bench_description,
)
from torquebench.cli.terminal.compilation import telling_compilation
from torquebench.cli.terminal.console import note, say, stderr_console, warn

if TYPE_CHECKING:
    from torquebench.panel.beside import PanelService


def panel_command(services: Sequence[PanelService]) -> Callable[..., None]:
    """Return the command `panel` with an option for every additional service."""

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
        fast: Annotated[
            bool,
            typer.Option("--fast", help="Simulated procedures run as fast as they compute."),
        ] = False,
        *,
        serving: AddressOptions,
        beside: Any,
    ) -> None:
        """Open the bench and serve the operator panel and the HTTP API.

        The simulated bench by default, in real time, on the loopback address. The first start
        prints a code with which the administrator is set up in the browser. Ctrl-C ends it; the
        bench is without torque before the process ends.
        """
        from torquebench.panel.address import ANY_ADDRESS

        address = serving.address(port, behind_proxy)
        wanted = [
            (service, service.settings(value))
            for service in services
            if (value := getattr(beside, _field(service))) is not None
        ]
        description = bench_description(bench)

        from torquebench.panel.lean_import import import_nicegui

        import_nicegui()
        from torquebench.panel.server import serve
        from torquebench.panel.service import BenchService

        addresses: list[str] = []

        def ready(url: str) -> None:
            for other in addresses:
                say(other)
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

        with (
            telling_compilation(stderr_console()),
            BenchService.open(description, data, fast=fast) as service,
            contextlib.ExitStack() as running,
        ):
            if service.station.description.simulated:
                note("simulated bench")
            for other, settings in wanted:
                other_address = running.enter_context(other.serve(service, settings, note))
                addresses += [] if other_address is None else [other_address]
            serve(service, address, ready)
        note("panel ended; the bench is without torque")

    panel.__annotations__["beside"] = _options(services)
    return panel


def _options(services: Sequence[PanelService]) -> type:
    """Return a group of options, one for each service."""
    fields = [
        (
            _field(service),
            Annotated[
                str | None,
                typer.Option(f"--{service.option}", metavar=service.value, help=service.help),
            ],
            None,
        )
        for service in services
    ]
    return make_dataclass("ServiceOptions", fields, frozen=True)


def _field(service: PanelService) -> str:
    return service.option.replace("-", "_")
