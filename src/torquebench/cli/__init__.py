"""The command line: commands of operations and other commands, each loaded by its name.

Commands import what they need when they run, so that `torquebench --help` answers at once.
"""

import gc
import os
import sys
from collections.abc import Mapping
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from torquebench.cli.failure import guarded
from torquebench.cli.options import HELP_MARKUP
from torquebench.cli.output_options import (
    HELP_OPTIONS,
    add_output_options,
    leave_out_types_of_flags,
)
from torquebench.cli.terminal.console import warn
from torquebench.errors import TorquebenchError
from torquebench.operations.catalogue import OPERATIONS, OWN_FILES, summary_of
from torquebench.operations.place import REGISTRY_URL
from torquebench.plugins import COMMANDS as ADDED
from torquebench.plugins import SERVICES, entry_points, load

__all__ = ["app", "main", "whole_command"]

COMMANDS: Mapping[str, str] = {
    "demo": "demo:demo",
    "calibrate": "",
    "resume": "",
    "zero": "",
    "check": "",
    "certificate": "",
    "fit": "",
    "apply": "",
    "verify": "",
    "verification": "",
    "export": "",
    "budget": "",
    "measure": "measure:measure",
    "record": "",
    "turn": "",
    "run": "",
    "panel": "panel:",
    "papers": "",
    "papers-tables": "",
    "in-place": "",
    "doctor": "",
    "simulate": "simulate:simulate",
    "test": "",
    "standard-reducer": "",
    "mechanics": "",
    "records": "",
    "evaluate": "",
    "bench": "",
}
"""Module and attribute of each command, in the help's order; empty for operations."""
GROUPS: Mapping[str, str] = {
    "mechanics": "Additional torque of a design by the papers' equations, twist of supports.",
    "records": "List, show, check and keep the registry's contents.",
    "evaluate": "Evaluate tables that were measured on any bench.",
    "bench": "Describe a bench by its instruments.",
}
"""Help of each group of operations."""
WRAPPED: Mapping[str, str] = {"certificate": "certificate:with_check"}
"""Functions that add a command-line option to an operation's command."""


class _Commands(TyperGroup):
    """All commands; each is imported when it is needed."""

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002 - as the library calls it
        """Return the names of all commands."""
        own = (name.partition(" ")[0] for name in OPERATIONS)
        return list(dict.fromkeys([*COMMANDS, *own, *_added()]))

    def get_command(self, ctx: Any, name: str) -> Any:  # noqa: ARG002 - as the library calls it
        """Return a command with its summary only, or the whole command if it was loaded."""
        return self.commands.get(name) or _command(name, listed=True)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Load and return the command named in the command line."""
        self.load(args[0])
        return super().resolve_command(ctx, args)

    def load(self, name: str) -> Any:
        """Load a whole command; return None if there is none of this name."""
        if name not in self.commands and (found := _command(name)) is not None:
            leave_out_types_of_flags(found)
            self.commands[name] = found
        return self.commands.get(name)


class _Group(TyperGroup):
    """A group of commands; operations in it are imported when they are needed."""

    def _operations(self) -> dict[str, str]:
        below = (each for each in OPERATIONS if each.startswith(f"{self.name} "))
        return {each.rpartition(" ")[2]: each for each in below}

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        return list(dict.fromkeys([*super().list_commands(ctx), *self._operations()]))

    def get_command(self, ctx: Any, name: str) -> Any:  # noqa: ARG002 - as the library calls it
        """Return a command with its summary only, or the whole command if it was loaded."""
        if name in self.commands or name not in self._operations():
            return self.commands.get(name)
        return TyperCommand(name, help=summary_of(self._operations()[name]))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Load and return the command named in the command line."""
        self.load(args[0])
        return super().resolve_command(ctx, args)

    def load(self, name: str) -> None:
        """Load the command of an operation."""
        if name not in self.commands and name in self._operations():
            app = typer.Typer(add_completion=False, rich_markup_mode=HELP_MARKUP)
            app.command(name)(_operation(self._operations()[name]))
            self.commands[name] = typer.main.get_command(app)
            leave_out_types_of_flags(self.commands[name])


def _operation(name: str) -> Any:
    """Return the command of an operation."""
    from torquebench.cli.operations import operation_command

    command = operation_command(OPERATIONS[name])
    return _attribute(WRAPPED[name])(command) if name in WRAPPED else command


def _added() -> list[str]:
    return [point.name for point in entry_points(ADDED)]


def _command(name: str, *, listed: bool = False) -> Any:
    """Return a command, or a group with its operations; None if there is none.

    For lists, operations with known summaries aren't imported.
    """
    if listed and COMMANDS.get(name) == "" and name not in GROUPS:
        return TyperCommand(name, help=summary_of(name))
    app = typer.Typer(name=name, add_completion=False, rich_markup_mode=HELP_MARKUP)
    found = _found(name)
    if isinstance(found, typer.Typer):
        app = found
        app.info.cls = _Group
        add_output_options(app, f"{name} ")
    elif found is not None:
        app.command(name)(found)
        add_output_options(app)
    below: list[str] = []
    if found is None:
        one = name in OPERATIONS  # without a search for plugins if torquebench has it
        below = [name] if one else [each for each in OPERATIONS if each.startswith(f"{name} ")]
    for each in below:
        app.command(each.rpartition(" ")[2])(_operation(each))
    return typer.main.get_command(app) if found is not None or below else None


def _found(name: str) -> Any:
    """Return the function or group of a name that isn't an operation's; None if there is none."""
    if name == "panel":
        from torquebench.cli.panel import panel_command

        return panel_command([*_installed(SERVICES).values()])
    if name in GROUPS:
        group = typer.Typer(
            name=name,
            add_completion=False,
            help=GROUPS[name],
            rich_markup_mode=HELP_MARKUP,
            no_args_is_help=True,
        )
        group.callback()(lambda: None)
        return group
    if COMMANDS.get(name):
        return _attribute(COMMANDS[name])
    return None if name in COMMANDS else _installed(ADDED, name).get(name)


def _attribute(place: str) -> Any:
    module, _, attribute = place.partition(":")
    return getattr(import_module(f"torquebench.cli.{module}"), attribute)


def _installed(group: str, name: str = "") -> dict[str, Any]:
    """Load a group of entry points of installed packages, by name; warn of packages that fail."""
    added = {}
    for point in entry_points(group):
        if name in ("", point.name):
            try:
                added[point.name] = load(point)
            except TorquebenchError as error:
                warn(f"{error.found}; {error.remedy}")
    return added


app = typer.Typer(
    cls=_Commands,
    name="torquebench",
    help="Torque measurement for test benches of industrial-robot reducers: calibrate in "
    "place, compensate, state the uncertainty. The simulated bench is the default.",
    no_args_is_help=True,
    rich_markup_mode=HELP_MARKUP,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": HELP_OPTIONS},
)


def whole_command() -> Any:
    """Return the root command with every command loaded, for the documentation."""
    root: Any = typer.main.get_command(app)
    for name in root.list_commands(None):
        group = root.load(name)
        if isinstance(group, _Group):
            for each in group.list_commands(None):
                group.load(each)
    leave_out_types_of_flags(root)
    return root


def _print_version(wanted: bool) -> None:
    if wanted:
        from torquebench import __version__

        typer.echo(f"torquebench {__version__}")
        raise typer.Exit


def _add_operations(paths: str | None) -> str | None:
    """Add the files of the option `--operations` to the catalogue of operations."""
    if paths:
        os.environ[OWN_FILES] = paths
    return paths


@app.callback()
def options(
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
    operations: Annotated[  # noqa: ARG001 - its callback takes it
        str | None,
        typer.Option(
            metavar="FILE",
            envvar=OWN_FILES,
            help="Python file with additional operations; several are separated as in PATH.",
            callback=_add_operations,
            is_eager=True,
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
        command = typer.main.get_command(app)
        leave_out_types_of_flags(command)
        command(args=arguments, prog_name="torquebench")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def main() -> None:
    """Run the command line and exit with 0 (done), 1 (a check failed) or 2 (bad input)."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    # The search for Pydantic's plugins reads the description of every installed package.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # Without this, garbage collection during the imports takes a quarter of the imports' time in a
    # command that opens a bench.
    gc.set_threshold(50_000, 20, 50)
    code = guarded(lambda: _run(sys.argv[1:]), debug=lambda: _debug)
    gc.freeze()  # so that exiting doesn't finalise every object of every library
    sys.exit(code)
