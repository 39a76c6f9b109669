"""Interface for commands of plugins: options, output, progress and exit codes."""

from torquebench.cli.answers import ANSWERS, WITHOUT_ANSWER, Record
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.options import (
    DEFAULT_DATA,
    HELP_MARKUP,
    AddressOptions,
    DataOption,
    check_output,
    data_directory,
    moment_in_utc,
)
from torquebench.cli.terminal.console import answer, narrow_table, note, out, say, say_file, warn
from torquebench.cli.terminal.progress import TerminalProgress

__all__ = [
    "ANSWERS",
    "CHECK_FAILED",
    "DEFAULT_DATA",
    "HELP_MARKUP",
    "WITHOUT_ANSWER",
    "AddressOptions",
    "DataOption",
    "Record",
    "TerminalProgress",
    "answer",
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
