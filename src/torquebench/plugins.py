"""Additions by installed packages, each named by an entry point.

========================  ========================================================================
group                     an entry point gives
========================  ========================================================================
torquebench.operations    a `torquebench.operations.Operation`, by its name
torquebench.commands      a command: a `typer.Typer` application or a function, by its name
torquebench.services      a `torquebench.panel.beside.PanelService`, an option of `panel`
torquebench.translations  a package with folders of texts, such as `translations/zh`
torquebench.drivers       a `torquebench.bench.drivers.plugins.DriverPlugin`, by its protocol
========================  ========================================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from torquebench.errors import TorquebenchError
from torquebench.message import Message

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

COMMANDS = "torquebench.commands"
OPERATIONS = "torquebench.operations"
SERVICES = "torquebench.services"
TRANSLATIONS = "torquebench.translations"
DRIVERS = "torquebench.drivers"


def entry_points(group: str) -> list[EntryPoint]:
    """Return the entry points of a group by their names."""
    from importlib import metadata  # imported late: only some commands look for plugins

    return sorted(metadata.entry_points(group=group), key=lambda point: point.name)


def load(point: EntryPoint) -> Any:
    """Load the object of an entry point.

    Raises
    ------
    TorquebenchError
        Its package fails; the message names the package.
    """
    try:
        return point.load()
    except Exception as error:  # a foreign package may raise anything
        package = point.dist.name if point.dist is not None else point.value
        raise TorquebenchError(
            Message("the plugin {package} can't be loaded: {error}", package, error),
            remedy=Message("pip install --upgrade {package}, or pip uninstall {package}", package),
        ) from error
