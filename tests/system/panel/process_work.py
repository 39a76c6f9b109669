"""What tests compute in a process of its own."""

import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

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


def in_stages(progress: Progress) -> float:
    """Work in stages, one of them in further processes."""
    progress.start(Message("{count} parts", 2), 2)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as workers:
        found = workers.submit(abs, -3.0).result()
    progress.reach(2)
    progress.finish("done")
    return found
