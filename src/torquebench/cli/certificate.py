"""`torquebench certificate --check`: an option added to the operation that issues certificates."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from torquebench.cli.reports import present
from torquebench.cli.terminal.console import begin_output
from torquebench.errors import InputError
from torquebench.operations.place import data_directory, has_registry

CheckOption = Annotated[
    str | None,
    typer.Option(
        "--check",
        metavar="FILE",
        help="Check a PDF, XML or JSON file, or a QR code's text; a digital certificate of "
        "another laboratory (DCC) is shown and compared with its schema.",
    ),
]


def with_check(issue: Callable[..., None]) -> Callable[..., None]:
    """Return the command that issues a certificate, or checks one."""

    def command(check: str | None = None, **given: Any) -> None:
        if (given["calibration"] is None) == (check is None):
            raise InputError(
                "neither a calibration nor --check" if check is None else "both, and --check",
                "one of them",
                "name a calibration, or a file to check",
            )
        if check is None:
            issue(**given)
        else:
            begin_output("certificate", json=given["json"], quiet=given["quiet"])
            _check(given["data"], check)

    signature = inspect.signature(issue)
    asked = dict(signature.parameters)
    name = asked.pop("calibration")
    optional = Annotated[str | None, name.annotation.__metadata__[0]]
    asked["check"] = name.replace(name="check", annotation=CheckOption, default=None)
    parameters = [name.replace(annotation=optional, default=None), *asked.values()]
    # Typer reads a command's options from this attribute, which typing doesn't know.
    command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in parameters}
    command.__doc__ = issue.__doc__
    return command


def _check(data: Path, given: str) -> None:
    from torquebench.operations.certificates import checked_certificate
    from torquebench.records import Registry
    from torquebench.tables import is_dcc

    if has_registry(data) or not is_dcc(Path(given)):
        with Registry.open(data_directory(data)) as registry:
            found = checked_certificate(registry, given)
    else:
        found = checked_certificate(None, given)
    present(found)
