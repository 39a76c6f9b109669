"""What tests compute in a process of its own."""

import time
from collections.abc import Callable

from torquebench.errors import InputError


def doubled(value: float, progress: Callable[[float, str], None]) -> float:
    progress(0.5, "half")
    return 2.0 * value


def refusing(_progress: Callable[[float, str], None]) -> None:
    raise InputError("found", "allowed", "remedy")


def endless(_progress: Callable[[float, str], None]) -> None:
    time.sleep(600.0)
