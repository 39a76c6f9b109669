"""The command line: one file a group of commands, gathered by `main`; plugins add theirs.

Commands import what they need when they run, so that `torquebench --help` answers at once.
"""

import gc
import os
import sys
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer

from torquebench.cli.failure import guarded
from torquebench.cli.options import HELP_MARKUP, REGISTRY_URL
from torquebench.cli.output_options import (
    HELP_OPTIONS,
    add_output_options,
    leave_out_types_of_flags,
)
from torquebench.cli.records import commands as records
from torquebench.cli.terminal.console import warn
from torquebench.errors import TorquebenchError
from torquebench.plugins import COMMANDS, SERVICES, entry_points, load

__all__ = ["app", "main"]

_WANTED = sys.argv[1] if Path(sys.argv[0]).stem == "torquebench" and sys.argv[1:] else ""
"""The command that this process was started for; empty where it isn't known."""


def __getattr__(name: str) -> typer.Typer:
    """Return `app`, built on first use: plugins' commands import this package themselves."""
    if name == "app":
        return _application()
    raise AttributeError(name)


@cache
def _application() -> typer.Typer:
    app = typer.Typer(
        name="torquebench",
        help="Torque measurement for test benches of industrial-robot reducers: calibrate in "
        "place, compensate, state the uncertainty. The simulated bench is the default.",
        no_args_is_help=True,
        rich_markup_mode=HELP_MARKUP,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": HELP_OPTIONS},
    )
    app.callback()(_options)
    _add_commands(app, _WANTED)
    add_output_options(app)
    return app


def _add_commands(app: typer.Typer, wanted: str) -> None:
    """Add every command; only those on records where one of them is wanted.

    Commands on records are built alone, since building all others takes longer than listing
    records.
    """
    if wanted == "records":
        app.add_typer(records.app)
        return
    from torquebench.cli import demo, mechanics
    from torquebench.cli.calibrate import calibrate
    from torquebench.cli.certificate import certificate
    from torquebench.cli.check_standard import check
    from torquebench.cli.doctor.command import doctor
    from torquebench.cli.evaluate import commands as evaluate
    from torquebench.cli.in_place import in_place
    from torquebench.cli.measure import measure
    from torquebench.cli.models.commands import apply, fit, verify
    from torquebench.cli.models.files import budget, export
    from torquebench.cli.panel import panel_command
    from torquebench.cli.papers import papers
    from torquebench.cli.reducers import commands as reducer_test
    from torquebench.cli.simulate import simulate
    from torquebench.cli.turn import turn
    from torquebench.cli.verification import verification

    demo.register(app)
    commands = (
        calibrate,
        check,
        certificate,
        fit,
        apply,
        verify,
        verification,
        export,
        budget,
        measure,
        turn,
        papers,
        in_place,
        doctor,
        simulate,
    )
    groups = tuple(each.app for each in (reducer_test, mechanics, records, evaluate))
    for command in commands:
        app.command()(command)
    for group in groups:
        app.add_typer(group)
    known = {"demo", *(each.__name__ for each in commands), *(each.info.name for each in groups)}
    plugins = wanted.replace("-", "_") not in known  # looking for them takes time
    app.command("panel")(panel_command([*_installed(SERVICES).values()] if plugins else []))
    for name, added in _installed(COMMANDS).items() if plugins else ():
        if isinstance(added, typer.Typer):
            app.add_typer(added, name=name)
        else:
            app.command(name)(added)


def _installed(group: str) -> dict[str, Any]:
    """Return what installed packages add by name; a warning names a package that fails."""
    added = {}
    for point in entry_points(group):
        try:
            added[point.name] = load(point)
        except TorquebenchError as error:
            warn(f"{error.found}; {error.remedy}")
    return added


def _print_version(wanted: bool) -> None:
    if wanted:
        from torquebench import __version__

        typer.echo(f"torquebench {__version__}")
        raise typer.Exit


def _options(
    version: Annotated[  # noqa: ARG001 - its callback prints it
        bool,
        typer.Option(
            "--version",
            help="Print the version.",
            callback=_print_version,
            is_eager=True,
        ),
    ] = False,
    debug: Annotated[
        bool,
        typer.Option(
            "--debug",
            envvar="TORQUEBENCH_DEBUG",
            help="Show the traceback of an error.",
        ),
    ] = False,
    registry: Annotated[
        str | None,
        typer.Option(
            envvar=REGISTRY_URL,
            help="URL of a registry on a server, instead of the data folder's: postgresql://…",
        ),
    ] = None,
) -> None:
    """Store the options common to all commands."""
    global _debug
    if registry:
        os.environ[REGISTRY_URL] = registry
    _debug = debug


_debug = False


def _run(arguments: list[str]) -> int:
    try:
        command = typer.main.get_command(_application())
        leave_out_types_of_flags(command)
        command(args=arguments, prog_name="torquebench")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def main() -> None:
    """Run the command line and exit with 0 (done), 1 (a check failed) or 2 (bad input)."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    # Python would search all objects of all libraries for garbage again and again while it imports
    # them: a quarter of the imports of a command that opens a bench.
    gc.set_threshold(50_000, 20, 50)
    code = guarded(lambda: _run(sys.argv[1:]), debug=lambda: _debug)
    gc.freeze()  # a normal exit would finalise every object of every library
    sys.exit(code)
