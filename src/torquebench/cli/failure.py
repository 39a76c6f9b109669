"""Convert errors to exit codes: 0 done, 1 a check or the bench failed, 2 unusable input.

130 means Ctrl-C. With `--json` a command prints its answer even after an error.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Callable

from torquebench.errors import (
    InputError,
    ModelMismatchError,
    TorquebenchError,
)
from torquebench.message import Message

OK = 0
CHECK_FAILED = 1
"""A verification out of tolerance, or a failure of the bench."""
UNUSABLE_INPUT = 2
"""Unusable input; also the option parser's code for an unknown option."""
DISK_FAILED = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
"""A full or broken disk isn't an input error."""
INTERRUPTED = 130
"""Ctrl-C, as in shells (128 + SIGINT)."""


_DISTRIBUTIONS = {
    "argon2": "argon2_cffi",
    "google": "protobuf",
    "paho": "paho_mqtt",
} | dict.fromkeys(("fastapi", "starlette", "uvicorn"), "nicegui")
"""Packages whose name differs from the module's, or that come with another package."""


def exit_code(error: TorquebenchError) -> int:
    """Return the exit code of an error: 2 for the user's input, 1 otherwise.

    Examples
    --------
    >>> exit_code(InputError("an empty table"))
    2
    """
    return UNUSABLE_INPUT if isinstance(error, InputError | ModelMismatchError) else CHECK_FAILED


def guarded(run: Callable[[], int | None], *, debug: Callable[[], bool]) -> int:
    """Run a command and turn every error into one message and an exit code.

    Parameters
    ----------
    run : callable
        Runs the command; its return value is the exit code (None counts as 0).
    debug : callable
        Called after an error; True lets the traceback through.

    Returns
    -------
    int
        The exit code of the process.
    """
    from torquebench.cli.terminal.console import end_output

    code = _coded(run, debug)
    end_output(code)
    return code


def _coded(run: Callable[[], int | None], debug: Callable[[], bool]) -> int:
    from torquebench.cli.terminal.console import stderr_console, write_error

    try:
        return run() or OK
    except KeyboardInterrupt:
        stderr_console().print("stopped by Ctrl-C")
        return INTERRUPTED
    except TorquebenchError as error:
        if debug():
            raise
        write_error(error)
        return exit_code(error)
    except OSError as error:
        if debug():
            raise
        write_error(_file_error(error))
        return CHECK_FAILED if error.errno in DISK_FAILED else UNUSABLE_INPUT
    except Exception as error:
        if debug():
            raise
        if isinstance(error, ModuleNotFoundError) and (extra := _extra_of(error.name or "")):
            write_error(_missing_extra(extra, error.name or ""))
            return UNUSABLE_INPUT
        write_error(
            TorquebenchError(
                Message("an unexpected {name}: {error}", type(error).__name__, error),
                remedy="run again as `torquebench --debug …` and report its output",
            )
        )
        return CHECK_FAILED


def _extra_of(module: str) -> str:
    """Return the smallest extra with a module; empty if there is none."""
    from importlib.metadata import requires

    name = _DISTRIBUTIONS.get(module.partition(".")[0], module.partition(".")[0])
    brought: dict[str, set[str]] = {}
    for line in requires("torquebench") or ():
        requirement, _, marker = line.partition(";")
        found = re.match(r"[A-Za-z0-9._-]+", requirement)
        extra = re.search(r"extra == ['\"]([^'\"]+)", marker)
        if found and extra:
            brought.setdefault(extra[1], set()).add(found[0].lower().replace("-", "_"))
    extras = [extra for extra, names in brought.items() if name.lower() in names]
    return min(extras, key=lambda extra: len(brought[extra]), default="")


def _missing_extra(extra: str, module: str) -> InputError:
    """Describe a library that isn't installed."""
    return InputError(
        Message("the library {partition} isn't installed", module.partition(".")[0]),
        Message("this command needs the extra {extra!r}", extra),
        Message("pip install 'torquebench[{extra}]'", extra),
    )


def _file_error(error: OSError) -> InputError:
    """Describe an error of the file system as found, allowed and remedy."""
    where = f"{error.filename}: " if error.filename else ""
    return InputError(
        Message("{where}{strerror}", where, error.strerror or error),
        remedy="check the path, its permissions and the space on the disk",
    )
