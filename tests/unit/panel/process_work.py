"""What tests compute in a process of its own."""

import time

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.progress import Progress


def doubled(value: float, progress: Progress) -> float:
    progress.reach(50, Message("{share} %", 50))
    return 2.0 * value


def refusing(_progress: Progress) -> None:
    raise InputError(Message("{what} found", "nothing"), "allowed", "remedy")


def endless(_progress: Progress) -> None:
    time.sleep(600.0)
