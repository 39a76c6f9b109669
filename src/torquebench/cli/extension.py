"""Interface for commands of plugins: options, output, progress and exit codes."""

from torquebench.cli.options import (
    DEFAULT_DATA,
    HELP_MARKUP,
    AddressOptions,
    DataOption,
    check_output,
    moment_in_utc,
)
from torquebench.cli.output_options import WITHOUT_RESULT
from torquebench.cli.reports import Told
from torquebench.cli.terminal.console import narrow_table, note, out, say, say_file, warn
from torquebench.cli.terminal.progress import TerminalProgress
from torquebench.operations.place import data_directory
from torquebench.operations.result import Result

__all__ = [
    "DEFAULT_DATA",
    "HELP_MARKUP",
    "WITHOUT_RESULT",
    "AddressOptions",
    "DataOption",
    "Result",
    "TerminalProgress",
    "Told",
    "check_output",
    "data_directory",
    "moment_in_utc",
    "narrow_table",
    "note",
    "out",
    "say",
    "say_file",
    "warn",
]
